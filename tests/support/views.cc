#include "tests/support/views.h"

#include <embree3/rtcore.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <utility>

#include "alhazen/check.h"

namespace alhazen::views {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// Rays that leave the surface start this far from it.
constexpr double kSkin_mm = 0.02;

RTCRay ray_of(const Vector3d& origin, const Vector3d& direction, double near, double far) {
  RTCRay ray{};
  ray.org_x = static_cast<float>(origin.x());
  ray.org_y = static_cast<float>(origin.y());
  ray.org_z = static_cast<float>(origin.z());
  ray.dir_x = static_cast<float>(direction.x());
  ray.dir_y = static_cast<float>(direction.y());
  ray.dir_z = static_cast<float>(direction.z());
  ray.tnear = static_cast<float>(near);
  ray.tfar = static_cast<float>(far);
  ray.mask = 0xffffffffU;
  return ray;
}

/// Object seen by a camera at one stop.
struct Eye {
  const CameraModel& camera;
  Pose object_from_camera;
  [[nodiscard]] Vector3d direction(double x_px, double y_px) const {
    return object_from_camera.rotation * camera.direction(Vector2d(x_px, y_px));
  }
};

Eye eye_of(const Rig& rig, const NormalMapKey& key, double angle_rad) {
  const CameraModel* camera = rig.camera(key.camera);
  ALHAZEN_CHECK(camera != nullptr);
  return {*camera, (camera->camera_from_rig * rig.turntable.rig_from_object(angle_rad)).inverse()};
}

/// The sensor region that can see the mesh, four pixels more on each side.
Region region_of(const Mesh& mesh, const Eye& eye) {
  const Pose camera_from_object = eye.object_from_camera.inverse();
  double low_x = 1e9, high_x = -1e9, low_y = 1e9, high_y = -1e9;
  for (const Vector3d& p : mesh.vertices_mm) {
    const auto pixel = eye.camera.project(camera_from_object * p);
    if (!pixel) continue;
    low_x = std::min(low_x, pixel->x());
    high_x = std::max(high_x, pixel->x());
    low_y = std::min(low_y, pixel->y());
    high_y = std::max(high_y, pixel->y());
  }
  constexpr int kMargin_px = 4;
  const int x0 = std::max(0, static_cast<int>(low_x) - kMargin_px);
  const int y0 = std::max(0, static_cast<int>(low_y) - kMargin_px);
  const int x1 = std::min(eye.camera.width_px - 1, static_cast<int>(high_x) + kMargin_px);
  const int y1 = std::min(eye.camera.height_px - 1, static_cast<int>(high_y) + kMargin_px);
  ALHAZEN_CHECK(x1 > x0 && y1 > y0);
  return {x0, y0, x1 - x0 + 1, y1 - y0 + 1};
}

/// Hits at the pixel centres of a region, and what each pixel is.
struct Rendered {
  NormalMap map;
  std::vector<std::optional<Hit>> hits;
};

Rendered render(const Target& target, const Rig& rig, NormalMapKey key, double angle_rad) {
  const Eye eye = eye_of(rig, key, angle_rad);
  Rendered made;
  NormalMap& map = made.map;
  map.region = region_of(target.mesh(), eye);
  map.key = std::move(key);
  map.angle_rad = angle_rad;
  map.normal.assign(map.size_px(), Eigen::Vector3f::Zero());
  map.label.assign(map.size_px(), NormalLabel::background);
  made.hits.resize(map.size_px());
  const auto width = static_cast<std::size_t>(map.region.width);
  const Vector3d origin = eye.object_from_camera.translation_mm;
  // Corners of pixels, one more each way.
  std::vector<std::uint8_t> corner((width + 1) * static_cast<std::size_t>(map.region.height + 1));
  tbb::parallel_for(0, map.region.height + 1, [&](int y) {
    for (std::size_t x = 0; x <= width; ++x) {
      const Vector3d direction =
          eye.direction(map.region.x + static_cast<double>(x) - 0.5, map.region.y + y - 0.5);
      corner[static_cast<std::size_t>(y) * (width + 1) + x] =
          target.first_hit(origin, direction) ? 1 : 0;
    }
  });
  const Eigen::Matrix3d camera_from_object = eye.object_from_camera.rotation.transpose();
  tbb::parallel_for(0, map.region.height, [&](int y) {
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * width + x;
      const Vector3d direction =
          eye.direction(map.region.x + static_cast<double>(x), map.region.y + y);
      made.hits[i] = target.first_hit(origin, direction);
      const std::size_t c = static_cast<std::size_t>(y) * (width + 1) + x;
      const int sum = corner[c] + corner[c + 1] + corner[c + width + 1] + corner[c + width + 2] +
                      (made.hits[i] ? 1 : 0);
      if (sum == 0) continue;
      if (sum < 5 || made.hits[i]->normal.dot(direction) >= 0) {
        map.label[i] = NormalLabel::unknown;
        continue;
      }
      map.label[i] = NormalLabel::object;
      map.normal[i] = (camera_from_object * made.hits[i]->normal).cast<float>().normalized();
    }
  });
  return made;
}

}  // namespace

struct Target::Scene {
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
};

Target::Target(const Mesh& mesh) : mesh_(mesh), scene_(std::make_unique<Scene>()) {
  scene_->device = rtcNewDevice(nullptr);
  ALHAZEN_CHECK(scene_->device != nullptr);
  scene_->scene = rtcNewScene(scene_->device);
  rtcSetSceneFlags(scene_->scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(scene_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                               RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                                               mesh.vertices_mm.size()));
  auto* triangles = static_cast<std::uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(std::uint32_t), mesh.triangles.size()));
  ALHAZEN_CHECK(vertices != nullptr && triangles != nullptr);
  for (const Vector3d& p : mesh.vertices_mm) {
    for (int k = 0; k < 3; ++k) *vertices++ = static_cast<float>(p[k]);
  }
  for (const auto& triangle : mesh.triangles)
    triangles = std::copy_n(triangle.data(), 3, triangles);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene_->scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene_->scene);
}

Target::~Target() {
  rtcReleaseScene(scene_->scene);
  rtcReleaseDevice(scene_->device);
}

std::optional<Hit> Target::first_hit(const Vector3d& origin_mm, const Vector3d& direction) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRayHit query{};
  query.ray = ray_of(origin_mm, direction, 0, std::numeric_limits<float>::infinity());
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  Hit hit;
  hit.triangle = query.hit.primID;
  hit.weights = {1.0 - query.hit.u - query.hit.v, query.hit.u, query.hit.v};
  const auto& [a, b, c] = mesh_.triangles[hit.triangle];
  hit.point_mm = hit.weights[0] * mesh_.vertices_mm[a] + hit.weights[1] * mesh_.vertices_mm[b] +
                 hit.weights[2] * mesh_.vertices_mm[c];
  if (mesh_.normals.empty()) {
    hit.normal = (mesh_.vertices_mm[b] - mesh_.vertices_mm[a])
                     .cross(mesh_.vertices_mm[c] - mesh_.vertices_mm[a])
                     .normalized();
  } else {
    hit.normal = (hit.weights[0] * mesh_.normals[a].cast<double>() +
                  hit.weights[1] * mesh_.normals[b].cast<double>() +
                  hit.weights[2] * mesh_.normals[c].cast<double>())
                     .normalized();
  }
  return hit;
}

bool Target::is_blocked(const Vector3d& origin_mm, const Vector3d& direction,
                        double reach_mm) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  RTCRay ray = ray_of(origin_mm, direction, kSkin_mm, reach_mm);
  rtcOccluded1(scene_->scene, &context, &ray);
  return ray.tfar < 0;  // Embree's way to say so
}

Rig ring_of_cameras(const std::vector<double>& elevations_rad, double distance_mm, double pixel_mm,
                    int sensor_px, const Vector3d& centre_mm) {
  Rig rig;
  for (std::size_t i = 0; i < elevations_rad.size(); ++i) {
    const double e = elevations_rad[i];
    const Vector3d eye = centre_mm + distance_mm * Vector3d(std::cos(e), 0, std::sin(e));
    CameraModel camera;
    camera.name = "c" + std::to_string(i);
    camera.width_px = camera.height_px = sensor_px;
    camera.fx_px = camera.fy_px = distance_mm / pixel_mm;
    camera.cx_px = camera.cy_px = (sensor_px - 1) / 2.0;
    const Vector3d z = (centre_mm - eye).normalized();
    // Straight up where the camera looks along the axis, any direction is as good as another.
    const Vector3d up = std::abs(z.z()) > 0.999 ? Vector3d::UnitX() : Vector3d::UnitZ();
    const Vector3d x = z.cross(up).normalized(), y = z.cross(x);
    camera.camera_from_rig.rotation << x.transpose(), y.transpose(), z.transpose();
    camera.camera_from_rig.translation_mm = -(camera.camera_from_rig.rotation * eye);
    rig.cameras.push_back(camera);
  }
  return rig;
}

NormalMap render_normals(const Target& target, const Rig& rig, NormalMapKey key, double angle_rad) {
  return render(target, rig, std::move(key), angle_rad).map;
}

ShadedView render_shaded(const Target& target, const Rig& rig, NormalMapKey key, double angle_rad,
                         const std::vector<Vector3d>& lights_rig, PaintAt paint,
                         const ShadingOptions& options) {
  const Eye eye = eye_of(rig, key, angle_rad);
  Rendered seen = render(target, rig, std::move(key), angle_rad);
  ShadedView view;
  view.truth = std::move(seen.map);
  LightStack& stack = view.stack;
  stack.width = view.truth.region.width;
  stack.height = view.truth.region.height;
  stack.mask.resize(view.truth.size_px());
  for (std::size_t i = 0; i < stack.mask.size(); ++i) {
    stack.mask[i] = view.truth.label[i] == NormalLabel::object ? 1 : 0;
  }
  const Eigen::Matrix3d object_from_rig =
      rig.turntable.rig_from_object(angle_rad).rotation.transpose();
  const Vector3d origin = eye.object_from_camera.translation_mm;
  const double full = (1 << options.bits) - 1;
  stack.intensity.resize(lights_rig.size());
  for (const Vector3d& light : lights_rig) {
    stack.lights.push_back({eye.camera.camera_from_rig.rotation * light, false, 1});
  }
  tbb::parallel_for(std::size_t{0}, lights_rig.size(), [&](std::size_t k) {
    std::vector<float>& picture = stack.intensity[k];
    picture.assign(stack.mask.size(), 0);
    const Vector3d l = object_from_rig * lights_rig[k];
    std::mt19937 random(options.seed * 7919U + static_cast<std::uint32_t>(k) * 104729U +
                        static_cast<std::uint32_t>(view.truth.key.stop));
    std::normal_distribution<double> noise(0, options.noise);
    for (std::size_t i = 0; i < picture.size(); ++i) {
      if (stack.mask[i] == 0) continue;
      const Hit& hit = *seen.hits[i];
      double radiance = 0;
      const double cosine = hit.normal.dot(l);
      if (cosine > 0 && !target.is_blocked(hit.point_mm + kSkin_mm * hit.normal, l, 1e4)) {
        const Paint p = paint(hit.point_mm);
        const Vector3d v = (origin - hit.point_mm).normalized();
        const double half = std::max(0.0, hit.normal.dot((l + v).normalized()));
        radiance =
            cosine * (p.albedo + p.gloss * (p.exponent + 8) / 8 * std::pow(half, p.exponent));
      }
      const double value = std::clamp(options.exposure * radiance + noise(random), 0.0, 1.0);
      picture[i] = static_cast<float>(std::round(value * full) / full);
    }
  });
  return view;
}

}  // namespace alhazen::views
