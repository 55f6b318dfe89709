#include "drivers/sim/shape.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <string>
#include <tuple>
#include <utility>

#include "drivers/sim/subdivide.h"
#include "reconstruct/mesh_io/mesh_file.h"

namespace alhazen::sim {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Distance along the line at which it enters the ball about `centre` (0 inside); infinite: never.
double enter(const SightLine& line, const Vec3& centre, double radius) {
  const Vec3 to = line.origin_mm - centre;
  const double b = to.dot(line.direction), c = to.squaredNorm() - radius * radius;
  if (c <= 0) return 0;
  const double root = b * b - c;
  if (root < 0 || b > 0) return kInfinity;
  return -b - std::sqrt(root);
}

/// The roots of a polynomial of degree `degree` in [from, to], ascending: between neighbouring
/// extrema (the roots of its derivative) there is at most one.
void real_roots(const std::array<double, 5>& k, int degree, double from, double to,
                std::array<double, 4>& roots, int& count) {
  count = 0;
  const auto value = [&](double t) {
    double sum = 0;
    for (int i = degree; i >= 0; --i) sum = sum * t + k[static_cast<std::size_t>(i)];
    return sum;
  };
  if (degree == 1) {
    const double t = -k[0] / k[1];
    if (t >= from && t <= to) roots[static_cast<std::size_t>(count++)] = t;
    return;
  }
  std::array<double, 5> slope{};
  for (int i = 1; i <= degree; ++i)
    slope[static_cast<std::size_t>(i - 1)] = i * k[static_cast<std::size_t>(i)];
  std::array<double, 4> turns{};
  int turn_count = 0;
  real_roots(slope, degree - 1, from, to, turns, turn_count);
  const auto slope_at = [&](double t) {
    double sum = 0;
    for (int i = degree - 1; i >= 0; --i) sum = sum * t + slope[static_cast<std::size_t>(i)];
    return sum;
  };
  double low = from, low_value = value(from);
  for (int piece = 0; piece <= turn_count; ++piece) {
    const double high = piece < turn_count ? turns[static_cast<std::size_t>(piece)] : to;
    const double high_value = value(high);
    if ((low_value < 0) != (high_value < 0)) {
      double a = low, b = high, t = 0.5 * (a + b);
      constexpr int kMostSteps = 60;  // bisection alone would need 50
      for (int step = 0; step < kMostSteps; ++step) {
        const double now = value(t);
        ((now < 0) == (low_value < 0) ? a : b) = t;
        const double newton = t - now / slope_at(t);
        const double next = newton >= a && newton <= b ? newton : 0.5 * (a + b);
        const double moved = std::abs(next - t);
        t = next;
        if (moved <= 1e-14 * (1 + std::abs(t))) break;
      }
      roots[static_cast<std::size_t>(count++)] = t;
    }
    low = high;
    low_value = high_value;
  }
}

/// A closed block: bottom and sides, and a top with a row of round pits
/// z = height − depth (1 − (ρ/radius)²)², whose depths grow evenly to the largest.
Mesh block_with_pits(const ObjectTruth& object) {
  const Vec3 size = object.block_mm;
  // Fine enough for the steepest wall to bend by less than the crease angle from cell to cell.
  const double cell = object.pit_radius_mm / 24;
  const auto nx = static_cast<std::uint32_t>(std::ceil(size.x() / cell));
  const auto ny = static_cast<std::uint32_t>(std::ceil(size.y() / cell));
  const auto height = [&](double x, double y) {
    const double spacing = size.x() / object.pit_count;
    for (int i = 0; i < object.pit_count; ++i) {
      const double dx = x + size.x() / 2 - (i + 0.5) * spacing;
      const double share = (dx * dx + y * y) / (object.pit_radius_mm * object.pit_radius_mm);
      if (share < 1)
        return size.z() -
               object.pit_depth_max_mm * (i + 1) / object.pit_count * (1 - share) * (1 - share);
    }
    return size.z();
  };
  Mesh mesh;
  const auto add_grid = [&](bool top) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
    for (std::uint32_t j = 0; j <= ny; ++j)
      for (std::uint32_t i = 0; i <= nx; ++i) {
        const double x = size.x() * (static_cast<double>(i) / nx - 0.5),
                     y = size.y() * (static_cast<double>(j) / ny - 0.5);
        mesh.vertices_mm.emplace_back(x, y, top ? height(x, y) : 0.0);
      }
    return first;
  };
  const std::uint32_t top = add_grid(true), bottom = add_grid(false);
  const auto quad = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    mesh.triangles.push_back({a, b, c});
    mesh.triangles.push_back({a, c, d});
  };
  const auto at = [&](std::uint32_t first, std::uint32_t i, std::uint32_t j) {
    return first + j * (nx + 1) + i;
  };
  for (std::uint32_t j = 0; j < ny; ++j)
    for (std::uint32_t i = 0; i < nx; ++i) {
      quad(at(top, i, j), at(top, i + 1, j), at(top, i + 1, j + 1), at(top, i, j + 1));
      quad(at(bottom, i, j), at(bottom, i, j + 1), at(bottom, i + 1, j + 1), at(bottom, i + 1, j));
    }
  for (std::uint32_t i = 0; i < nx; ++i) {
    quad(at(bottom, i, 0), at(bottom, i + 1, 0), at(top, i + 1, 0), at(top, i, 0));
    quad(at(bottom, i + 1, ny), at(bottom, i, ny), at(top, i, ny), at(top, i + 1, ny));
  }
  for (std::uint32_t j = 0; j < ny; ++j) {
    quad(at(bottom, nx, j), at(bottom, nx, j + 1), at(top, nx, j + 1), at(top, nx, j));
    quad(at(bottom, 0, j + 1), at(bottom, 0, j), at(top, 0, j), at(top, 0, j + 1));
  }
  return mesh;
}

/// The turn that puts the file's axis `up` along z.
Eigen::Matrix3d z_from(const std::string& up) {
  const double sign = up.front() == '-' ? -1 : 1;
  const Vec3 axis = sign * (up.back() == 'x'   ? Vec3::UnitX()
                            : up.back() == 'y' ? Vec3::UnitY()
                                               : Vec3::UnitZ());
  return Eigen::Quaterniond::FromTwoVectors(axis, Vec3::UnitZ()).toRotationMatrix();
}

/// Puts the surface on the plate, centred on the axis, scaled to its longest edge where wanted.
void stand(SmoothMesh& mesh, double size_mm, const Eigen::Matrix3d& turn) {
  Vec3 low = Vec3::Constant(kInfinity), high = -low;
  for (Vec3& p : mesh.vertices) {
    p = turn * p;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double scale = size_mm > 0 ? size_mm / (high - low).maxCoeff() : 1;
  const Vec3 foot(0.5 * (low.x() + high.x()), 0.5 * (low.y() + high.y()), low.z());
  for (Vec3& p : mesh.vertices) p = scale * (p - foot);
  for (Eigen::Vector3f& n : mesh.normals) n = turn.cast<float>() * n;
}

/// Balls about the cells of a grid that the surface passes through.
std::vector<Ball> cover_of(const SmoothMesh& mesh) {
  Vec3 low = Vec3::Constant(kInfinity), high = -low;
  for (const Vec3& p : mesh.vertices) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  constexpr int kCells = 64;  // across: some thousand balls, a few pixels each
  const double cell = (high - low).maxCoeff() / kCells;
  std::set<std::array<int, 3>> seen;
  std::array<int, 3> last{-1, -1, -1};
  for (const auto& [a, b, c] : mesh.triangles) {
    const Vec3 &p = mesh.vertices[a], along = mesh.vertices[b] - p, across = mesh.vertices[c] - p;
    const int steps = 1 + static_cast<int>(2 * std::max(along.norm(), across.norm()) / cell);
    for (int i = 0; i <= steps; ++i)
      for (int j = 0; j + i <= steps; ++j) {
        const Vec3 q = (p + (along * i + across * j) / steps - low) / cell;
        const std::array<int, 3> key{static_cast<int>(q.x()), static_cast<int>(q.y()),
                                     static_cast<int>(q.z())};
        if (key == last) continue;  // most neighbours share a cell
        last = key;
        seen.insert(key);
      }
  }
  std::vector<Ball> out;
  out.reserve(seen.size());
  // Half the diagonal of a cell, and what lies between two samples.
  const double radius = cell * (std::sqrt(3.0) / 2 + 0.5);
  for (const auto& [i, j, k] : seen)
    out.push_back({low + cell * Vec3(i + 0.5, j + 0.5, k + 0.5), radius});
  return out;
}

}  // namespace

/// The mesh with its search tree.
struct Shape::Triangles {
  SmoothMesh mesh;
  Vec3 centre_mm;
  double radius_mm = 0;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;

  Triangles() = default;
  Triangles(const Triangles&) = delete;
  Triangles& operator=(const Triangles&) = delete;
  ~Triangles() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }

  Status build();
  void intersect(std::span<const SightLine> lines, std::span<SurfaceHit> hits) const;
};

Status Shape::Triangles::build() {
  Vec3 low = Vec3::Constant(kInfinity), high = -low;
  for (const Vec3& p : mesh.vertices) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  centre_mm = 0.5 * (low + high);
  radius_mm = 0.5 * (high - low).norm() * 1.0001;
  device = rtcNewDevice("verbose=0");
  if (device == nullptr) return Error{Code::internal, "Embree gives no device"};
  scene = rtcNewScene(device);
  // Robust: no ray slips through the edge between two triangles.
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
  const RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0,
                                                               RTC_FORMAT_FLOAT3, 3 * sizeof(float),
                                                               mesh.vertices.size()));
  auto* triangles = static_cast<std::uint32_t*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(std::uint32_t), mesh.triangles.size()));
  if (vertices == nullptr || triangles == nullptr) {
    rtcReleaseGeometry(geometry);
    return Error{Code::exhausted,
                 "no memory for " + std::to_string(mesh.triangles.size()) + " triangles"};
  }
  // About the centre: a float then resolves 4 nm on an 80 mm object.
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i)
    for (int axis = 0; axis < 3; ++axis)
      vertices[3 * i + static_cast<std::size_t>(axis)] =
          static_cast<float>(mesh.vertices[i][axis] - centre_mm[axis]);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    std::copy(mesh.triangles[t].begin(), mesh.triangles[t].end(), triangles + 3 * t);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene);
  if (const RTCError error = rtcGetDeviceError(device); error != RTC_ERROR_NONE)
    return Error{error == RTC_ERROR_OUT_OF_MEMORY ? Code::exhausted : Code::internal,
                 "Embree failed to build the mesh's search tree (error " +
                     std::to_string(static_cast<int>(error)) + ")"};
  return {};
}

void Shape::Triangles::intersect(std::span<const SightLine> lines,
                                 std::span<SurfaceHit> hits) const {
  constexpr std::size_t kPacket = 16;
  for (std::size_t first = 0; first < lines.size(); first += kPacket) {
    const std::size_t count = std::min(kPacket, lines.size() - first);
    alignas(64) RTCRayHit16 packet;
    alignas(64) std::array<int, kPacket> valid{};
    std::array<double, kPacket> skipped{};  // from the line's own origin to the packet's
    for (std::size_t i = 0; i < count; ++i) {
      const SightLine& line = lines[first + i];
      hits[first + i].distance_mm = kInfinity;
      skipped[i] = enter(line, centre_mm, radius_mm);
      if (skipped[i] == kInfinity) continue;
      valid[i] = -1;
      const Vec3 origin = line.origin_mm + skipped[i] * line.direction - centre_mm;
      packet.ray.org_x[i] = static_cast<float>(origin.x());
      packet.ray.org_y[i] = static_cast<float>(origin.y());
      packet.ray.org_z[i] = static_cast<float>(origin.z());
      packet.ray.dir_x[i] = static_cast<float>(line.direction.x());
      packet.ray.dir_y[i] = static_cast<float>(line.direction.y());
      packet.ray.dir_z[i] = static_cast<float>(line.direction.z());
      packet.ray.tnear[i] = skipped[i] > 0 ? 0.0F : static_cast<float>(kSkinMm);
      packet.ray.tfar[i] = std::numeric_limits<float>::infinity();
      packet.ray.time[i] = 0;
      packet.ray.mask[i] = ~0U;
      packet.ray.id[i] = 0;
      packet.ray.flags[i] = 0;
      packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      packet.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcIntersect16(valid.data(), scene, &context, &packet);
    for (std::size_t i = 0; i < count; ++i) {
      if (valid[i] == 0 || packet.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
      SurfaceHit& hit = hits[first + i];
      const std::uint32_t t = packet.hit.primID[i];
      const double b = packet.hit.u[i], c = packet.hit.v[i], a = 1 - b - c;
      const auto& [va, vb, vc] = mesh.triangles[t];
      const auto& [na, nb, nc] = mesh.corner_normals[t];
      const Vec3 &pa = mesh.vertices[va], &pb = mesh.vertices[vb], &pc = mesh.vertices[vc];
      hit.point_mm = a * pa + b * pb + c * pc;
      hit.normal = (a * mesh.normals[na].cast<double>() + b * mesh.normals[nb].cast<double>() +
                    c * mesh.normals[nc].cast<double>())
                       .normalized();
      hit.face = (pb - pa).cross(pc - pa);
      hit.distance_mm = (hit.point_mm - lines[first + i].origin_mm).dot(lines[first + i].direction);
    }
  }
}

void Shape::Sphere::intersect(const SightLine& line, SurfaceHit& hit) const {
  hit.distance_mm = kInfinity;
  const Vec3 to = line.origin_mm - Vec3(0, 0, radius_mm);
  const double b = to.dot(line.direction), c = to.squaredNorm() - radius_mm * radius_mm;
  const double square = b * b - c;
  if (square < 0) return;
  const double root = std::sqrt(square);
  const double t = -b - root > kSkinMm ? -b - root : -b + root;
  if (t <= kSkinMm) return;
  hit.distance_mm = t;
  hit.point_mm = line.origin_mm + t * line.direction;
  hit.normal = hit.face = (to + t * line.direction) / radius_mm;
}

void Shape::Torus::intersect(const SightLine& line, SurfaceHit& hit) const {
  hit.distance_mm = kInfinity;
  const Vec3 centre(0, 0, tube_mm);
  const double reach = ring_mm + tube_mm;
  const double near = enter(line, centre, reach * 1.0001);
  if (near == kInfinity) return;
  // (|p|² + R² − r²)² = 4R² (x² + y²) along p = o + t d, a quartic in t.
  const Vec3 o = line.origin_mm + near * line.direction - centre, &d = line.direction;
  const double ring_square = ring_mm * ring_mm;
  const double b = o.dot(d), k = o.squaredNorm() + ring_square - tube_mm * tube_mm;
  const double flat_dd = d.head<2>().squaredNorm(), flat_od = o.head<2>().dot(d.head<2>()),
               flat_oo = o.head<2>().squaredNorm();
  const std::array<double, 5> polynomial{k * k - 4 * ring_square * flat_oo,
                                         4 * b * k - 8 * ring_square * flat_od,
                                         4 * b * b + 2 * k - 4 * ring_square * flat_dd, 4 * b, 1};
  std::array<double, 4> roots{};
  int count = 0;
  real_roots(polynomial, 4, near > 0 ? 0 : kSkinMm, 2.1 * reach, roots, count);
  if (count == 0) return;
  const double t = near + roots[0];
  hit.distance_mm = t;
  hit.point_mm = line.origin_mm + t * line.direction;
  const Vec3 p = hit.point_mm - centre;
  const double flat = p.head<2>().norm();
  hit.normal = (p - Vec3(p.x(), p.y(), 0) * (ring_mm / flat)).normalized();
  hit.face = hit.normal;
}

Result<Shape> Shape::make(const ObjectTruth& object) {
  Shape out;
  out.form_ = object.form;
  if (object.form == Form::sphere) {
    out.sphere_ = {object.radius_mm};
    out.cover_ = {{Vec3(0, 0, object.radius_mm), object.radius_mm}};
    return out;
  }
  if (object.form == Form::torus) {
    out.torus_ = {object.ring_radius_mm, object.tube_radius_mm};
    constexpr int kBalls = 48;
    for (int i = 0; i < kBalls; ++i) {
      const double angle = 2 * std::numbers::pi * i / kBalls;
      out.cover_.push_back(
          {Vec3(object.ring_radius_mm * std::cos(angle), object.ring_radius_mm * std::sin(angle),
                object.tube_radius_mm),
           object.tube_radius_mm + object.ring_radius_mm * std::numbers::pi / kBalls});
    }
    return out;
  }
  const bool from_file = object.form == Form::mesh;
  if (from_file && object.mesh.empty())
    return Error{
        Code::invalid,
        "no mesh is given: a closed one is needed, as object.mesh in the world file or as the "
        "driver's key object_mesh"};
  if (from_file && !(object.size_mm > 0))
    return Error{
        Code::invalid,
        "no size is given: mesh files carry no unit, so the longest edge in mm is needed, as "
        "object.size_mm in the world file or as the driver's key object_size_mm"};
  const Mesh coarse = from_file ? ALHAZEN_TRY(read_mesh(object.mesh)) : block_with_pits(object);
  const std::string name = from_file ? object.mesh.string() : "block with pits";
  auto triangles = std::make_shared<Triangles>();
  triangles->mesh =
      ALHAZEN_TRY(subdivide(coarse, object.min_triangles, object.crease_rad).in(name));
  stand(triangles->mesh, from_file ? object.size_mm : 0,
        from_file ? z_from(object.up) : Eigen::Matrix3d::Identity());
  ALHAZEN_TRY(triangles->build());
  out.cover_ = cover_of(triangles->mesh);
  out.triangles_ = std::move(triangles);
  return out;
}

void Shape::intersect(std::span<const SightLine> lines, std::span<SurfaceHit> hits) const {
  ALHAZEN_CHECK(lines.size() == hits.size());
  if (triangles_) {
    triangles_->intersect(lines, hits);
  } else if (form_ == Form::sphere) {
    for (std::size_t i = 0; i < lines.size(); ++i) sphere_.intersect(lines[i], hits[i]);
  } else {
    for (std::size_t i = 0; i < lines.size(); ++i) torus_.intersect(lines[i], hits[i]);
  }
}

Mesh Shape::truth() const {
  Mesh out;
  if (triangles_) {
    out.vertices_mm = triangles_->mesh.vertices;
    out.triangles = triangles_->mesh.triangles;
    out.normals.assign(
        triangles_->mesh.normals.begin(),
        triangles_->mesh.normals.begin() + static_cast<std::ptrdiff_t>(out.vertices_mm.size()));
    return out;
  }
  // Rings of points; a sphere's first and last ring are its poles.
  const bool is_torus = form_ == Form::torus;
  constexpr std::uint32_t kAround = 1440, kAlong = 720;
  const auto point = [&](double round, double along) {
    const Vec3 outward(std::cos(round), std::sin(round), 0);
    const Vec3 normal = std::cos(along) * outward + std::sin(along) * Vec3::UnitZ();
    out.normals.emplace_back(normal.cast<float>());
    out.vertices_mm.emplace_back(
        is_torus ? Vec3(torus_.ring_mm * outward + torus_.tube_mm * (normal + Vec3::UnitZ()))
                 : Vec3(sphere_.radius_mm * (normal + Vec3::UnitZ())));
  };
  const double pi = std::numbers::pi;
  const std::uint32_t first = is_torus ? 0 : 1, last = kAlong - 1;
  for (std::uint32_t j = first; j <= last; ++j)
    for (std::uint32_t i = 0; i < kAround; ++i)
      point(2 * pi * i / kAround,
            is_torus ? 2 * pi * j / kAlong : pi * (static_cast<double>(j) / kAlong - 0.5));
  const std::uint32_t rows = last - first + 1;
  const auto at = [&](std::uint32_t i, std::uint32_t j) {
    return (j % rows) * kAround + i % kAround;
  };
  for (std::uint32_t j = 0; j < (is_torus ? rows : rows - 1); ++j)
    for (std::uint32_t i = 0; i < kAround; ++i) {
      out.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      out.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  if (!is_torus) {
    const auto south = static_cast<std::uint32_t>(out.vertices_mm.size());
    point(0, -pi / 2);
    point(0, pi / 2);
    for (std::uint32_t i = 0; i < kAround; ++i) {
      out.triangles.push_back({south, at(i + 1, 0), at(i, 0)});
      out.triangles.push_back({south + 1, at(i, rows - 1), at(i + 1, rows - 1)});
    }
  }
  return out;
}

}  // namespace alhazen::sim
