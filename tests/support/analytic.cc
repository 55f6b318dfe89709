#include "tests/support/analytic.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <thread>

namespace alhazen::analytic {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

/// Turns v about the unit axis (Rodrigues).
Vector3d turned(const Vector3d& v, const Vector3d& axis, double angle) {
  return v * std::cos(angle) + axis.cross(v) * std::sin(angle) +
         axis * axis.dot(v) * (1 - std::cos(angle));
}

/// Distance along the unit ray to the mirror, or infinity.
double hit_mm(const Shape& shape, const Vector3d& origin, const Vector3d& direction) {
  constexpr double kNone = std::numeric_limits<double>::infinity();
  if (const auto* sphere = std::get_if<Sphere>(&shape)) {
    const Vector3d m = origin - sphere->centre_mm;
    const double b = m.dot(direction);
    const double discriminant = b * b - m.squaredNorm() + sphere->radius_mm * sphere->radius_mm;
    if (discriminant < 0) return kNone;
    const double t = -b - std::sqrt(discriminant);
    return t > 1e-9 ? t : kNone;
  }
  if (const auto* plane = std::get_if<Plane>(&shape)) {
    const double fall = direction.dot(plane->normal);
    if (fall >= 0) return kNone;
    const double t = (plane->point_mm - origin).dot(plane->normal) / fall;
    return t > 1e-9 ? t : kNone;
  }
  // Torus: walk by the exact distance, then finish with Newton along the ray.
  const auto& torus = std::get<Torus>(shape);
  const double reach = torus.ring_mm + torus.tube_mm;
  const double middle = (torus.centre_mm - origin).dot(direction);
  if ((origin + middle * direction - torus.centre_mm).norm() > reach) return kNone;
  double t = std::max(0.0, middle - reach);
  for (int step = 0; step < 400; ++step) {
    const Vector3d p = origin + t * direction;
    const double d = distance_mm(shape, p);
    if (d < 1e-7) {
      for (int newton = 0; newton < 4; ++newton) {
        const Vector3d q = origin + t * direction;
        const double slope = normal(shape, q).dot(direction);
        if (std::abs(slope) < 1e-6) break;
        t -= distance_mm(shape, q) / slope;
      }
      return t > 1e-6 ? t : kNone;
    }
    t += d;
    if (t > middle + reach) return kNone;
  }
  return kNone;
}

/// Direction (rig frame) that `camera` sees at a pixel: OpenCV's model, inverted by Newton steps.
Vector3d sight(const CameraModel& camera, double x_px, double y_px) {
  const auto& k = camera.distortion;
  const Vector2d wanted((x_px - camera.cx_px) / camera.fx_px, (y_px - camera.cy_px) / camera.fy_px);
  const auto distorted = [&](const Vector2d& p) {
    const double r2 = p.squaredNorm();
    const double radial =
        (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
    return Vector2d(p.x() * radial + 2 * k[2] * p.x() * p.y() + k[3] * (r2 + 2 * p.x() * p.x()),
                    p.y() * radial + k[2] * (r2 + 2 * p.y() * p.y()) + 2 * k[3] * p.x() * p.y());
  };
  Vector2d p = wanted;
  for (int i = 0; i < 8; ++i) {
    constexpr double kStep = 1e-6;
    const Vector2d f = distorted(p);
    if ((f - wanted).norm() < 1e-14) break;
    Eigen::Matrix2d jacobian;
    jacobian.col(0) = (distorted(p + Vector2d(kStep, 0)) - f) / kStep;
    jacobian.col(1) = (distorted(p + Vector2d(0, kStep)) - f) / kStep;
    p += jacobian.inverse() * (wanted - f);
  }
  return camera.camera_from_rig.rotation.transpose() * Vector3d(p.x(), p.y(), 1).normalized();
}

/// Camera, display and mirror in the object frame at one angle.
class View {
 public:
  View(const Rig& rig, const Shape& shape, const CameraModel& camera, const DisplayModel& display,
       double angle_rad)
      : shape_(shape),
        display_(display),
        axis_(rig.turntable.direction.normalized()),
        point_(rig.turntable.point_mm),
        angle_(angle_rad) {
    eye_ =
        place(-camera.camera_from_rig.rotation.transpose() * camera.camera_from_rig.translation_mm);
    if (display.mount == Mount::rig) {
      display_.origin_mm = place(display.origin_mm);
      display_.u_mm = turn(display.u_mm);
      display_.v_mm = turn(display.v_mm);
    }
    inward_ = display_.u_mm.cross(display_.v_mm).normalized();
  }

  struct Seen {
    Label label = Label::none;
    double u_px = 0, v_px = 0;
  };

  /// What is seen along a direction of the rig frame.
  [[nodiscard]] Seen see(const Vector3d& direction_rig) const {
    const Vector3d direction = turn(direction_rig);
    const double t = hit_mm(shape_, eye_, direction);
    Seen direct = on_display(eye_, direction, t);
    if (direct.label != Label::none) {
      direct.label = Label::direct_sight;
      return direct;
    }
    if (!std::isfinite(t)) return {};
    const Vector3d p = eye_ + t * direction;
    const Vector3d n = normal(shape_, p);
    const Vector3d mirrored = direction - 2 * direction.dot(n) * n;
    if (std::holds_alternative<Torus>(shape_) &&
        std::isfinite(hit_mm(shape_, p + 1e-3 * n, mirrored))) {
      return {Label::second_bounce, 0, 0};
    }
    Seen seen = on_display(p, mirrored, std::numeric_limits<double>::infinity());
    // Distinguishes "mirror, but not this display" from background at silhouettes.
    if (seen.label == Label::none) return {Label::saturated, 0, 0};
    return seen;
  }

 private:
  [[nodiscard]] Vector3d turn(const Vector3d& v) const { return turned(v, axis_, -angle_); }
  [[nodiscard]] Vector3d place(const Vector3d& p) const { return point_ + turn(p - point_); }

  /// Where a ray meets the lit side of the display before `limit`.
  [[nodiscard]] Seen on_display(const Vector3d& origin, const Vector3d& direction,
                                double limit) const {
    const double fall = direction.dot(inward_);
    if (fall <= 1e-9) return {};
    const double t = (display_.origin_mm - origin).dot(inward_) / fall;
    if (t <= 0 || t >= limit) return {};
    const Vector3d q = origin + t * direction - display_.origin_mm;
    const double u = q.dot(display_.u_mm) / display_.u_mm.squaredNorm();
    const double v = q.dot(display_.v_mm) / display_.v_mm.squaredNorm();
    if (u < -0.5 || v < -0.5 || u >= display_.width_px - 0.5 || v >= display_.height_px - 0.5) {
      return {};
    }
    return {Label::mirror, u, v};
  }

  const Shape& shape_;
  DisplayModel display_;
  Vector3d eye_, inward_, axis_, point_;
  double angle_;
};

/// The sights of a region: pixel centres and corners, so that they are computed once a camera.
struct Sights {
  Region region;
  std::vector<Vector3d> centres, corners;  ///< width × height; (width + 1) × (height + 1)
};

Sights sights_of(const CameraModel& camera, const Region& region) {
  Sights sights{region, {}, {}};
  for (int y = 0; y <= region.height; ++y) {
    for (int x = 0; x <= region.width; ++x) {
      sights.corners.push_back(sight(camera, region.x + x - 0.5, region.y + y - 0.5));
      if (x < region.width && y < region.height) {
        sights.centres.push_back(sight(camera, region.x + x, region.y + y));
      }
    }
  }
  return sights;
}

LightMap render(const View& view, const Sights& sights, const DisplayModel& display,
                const StackKey& key, double angle_rad, const Coding& coding) {
  const Region& region = sights.region;
  const auto width = static_cast<std::size_t>(region.width);
  const auto height = static_cast<std::size_t>(region.height);
  LightMap map;
  map.key = key;
  map.angle_rad = angle_rad;
  map.region = region;
  const std::size_t count = width * height;
  map.u_px.assign(count, kNan);
  map.v_px.assign(count, kNan);
  map.sigma_u_px.assign(count, std::numeric_limits<Imath::half>::quiet_NaN());
  map.sigma_v_px.assign(count, std::numeric_limits<Imath::half>::quiet_NaN());
  map.contrast.assign(count, 0);
  map.label.assign(count, Label::none);
  map.bit_u.assign(count, 0);
  map.bit_v.assign(count, 0);

  std::size_t name_hash = 0;
  for (const char c : key.display + "/" + key.camera) {
    name_hash = name_hash * 131 + static_cast<unsigned char>(c);
  }
  std::mt19937 random(coding.seed + static_cast<std::uint32_t>(key.stop) * 7919u +
                      static_cast<std::uint32_t>(name_hash));
  std::normal_distribution<double> normal_noise(0, 1);
  std::uniform_real_distribution<double> uniform(0, 1);

  std::vector<View::Seen> above(width + 1), below(width + 1);
  for (std::size_t x = 0; x <= width; ++x) above[x] = view.see(sights.corners[x]);
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x <= width; ++x) {
      below[x] = view.see(sights.corners[(y + 1) * (width + 1) + x]);
    }
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t i = y * width + x;
      View::Seen seen = view.see(sights.centres[i]);
      const std::array<View::Seen, 4> corners{above[x], above[x + 1], below[x], below[x + 1]};
      const bool is_same = std::all_of(corners.begin(), corners.end(),
                                       [&](const View::Seen& c) { return c.label == seen.label; });
      if (!is_same) seen.label = Label::mixed;
      if (seen.label == Label::saturated) seen.label = Label::none;
      map.label[i] = seen.label;
      if (seen.label != Label::mirror && seen.label != Label::direct_sight) continue;
      const auto code = [&](double position, double View::Seen::*axis, int size, float& value,
                            Imath::half& sigma, std::uint8_t& bit) {
        double low = corners[0].*axis, high = low;
        for (const View::Seen& c : corners) {
          low = std::min(low, c.*axis);
          high = std::max(high, c.*axis);
        }
        double spread = 0;
        if (coding.gray) {
          while ((2 << bit) <= (high - low) / 3.2) ++bit;
          const double cell = 1 << bit;
          position = (std::floor((position + 0.5) / cell) + 0.5) * cell - 0.5;
          spread = cell / std::sqrt(12.0);
        }
        if (coding.noise_px > 0) position += coding.noise_px * normal_noise(random);
        if (coding.outlier_share > 0 && uniform(random) < coding.outlier_share) {
          position = uniform(random) * (size - 1);
        }
        value = static_cast<float>(position);
        sigma = static_cast<float>(std::hypot(spread, std::max(coding.noise_px, 1e-3)));
      };
      code(seen.u_px, &View::Seen::u_px, display.width_px, map.u_px[i], map.sigma_u_px[i],
           map.bit_u[i]);
      code(seen.v_px, &View::Seen::v_px, display.height_px, map.v_px[i], map.sigma_v_px[i],
           map.bit_v[i]);
      map.contrast[i] = 204;
    }
    std::swap(above, below);
  }
  return map;
}

/// Axes of something at `from` that looks at `to`: x right, y down, z forward, as columns.
Matrix3d looking(const Vector3d& from, const Vector3d& to) {
  const Vector3d forward = (to - from).normalized();
  const Vector3d right = forward.cross(Vector3d::UnitZ()).normalized();
  Matrix3d axes;
  axes << right, forward.cross(right), forward;
  return axes;
}

Vector3d on_ball(const Vector3d& centre, double radius, double azimuth_deg, double elevation_deg) {
  const double azimuth = azimuth_deg * std::numbers::pi / 180;
  const double elevation = elevation_deg * std::numbers::pi / 180;
  return centre + radius * Vector3d(std::cos(elevation) * std::cos(azimuth),
                                    std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
}

}  // namespace

double distance_mm(const Shape& shape, const Vector3d& p_mm) {
  if (const auto* sphere = std::get_if<Sphere>(&shape)) {
    return (p_mm - sphere->centre_mm).norm() - sphere->radius_mm;
  }
  if (const auto* plane = std::get_if<Plane>(&shape)) {
    return (p_mm - plane->point_mm).dot(plane->normal);
  }
  const auto& torus = std::get<Torus>(shape);
  const Vector3d d = p_mm - torus.centre_mm;
  return std::hypot(std::hypot(d.x(), d.y()) - torus.ring_mm, d.z()) - torus.tube_mm;
}

Vector3d normal(const Shape& shape, const Vector3d& p_mm) {
  if (const auto* sphere = std::get_if<Sphere>(&shape)) {
    return (p_mm - sphere->centre_mm).normalized();
  }
  if (const auto* plane = std::get_if<Plane>(&shape)) return plane->normal;
  const auto& torus = std::get<Torus>(shape);
  const Vector3d d = p_mm - torus.centre_mm;
  const double across = std::hypot(d.x(), d.y());
  const double scale = (across - torus.ring_mm) / across;
  return Vector3d(d.x() * scale, d.y() * scale, d.z()).normalized();
}

Rig make_rig(const RigSize& size) {
  const Vector3d middle(0, 0, 51.2);
  Rig rig;
  rig.turntable.point_mm = {0.3, -0.2, 0};
  rig.turntable.direction = Vector3d(0.002, -0.001, 1).normalized();
  constexpr double kDistanceMm = 650;
  for (int i = 0; i < size.cameras; ++i) {
    CameraModel camera;
    camera.name = "c" + std::string(i < 9 ? "0" : "") + std::to_string(i + 1);
    camera.width_px = camera.height_px = size.sensor_px;
    camera.fx_px = kDistanceMm / size.pixel_mm;
    camera.fy_px = camera.fx_px * 1.001;
    camera.cx_px = size.sensor_px / 2.0 - 3.2;
    camera.cy_px = size.sensor_px / 2.0 + 2.7;
    if (size.has_distortion) camera.distortion = {-0.12, 0.05, 4e-4, -3e-4, 0.01, 0, 0, 0};
    const double elevation =
        size.cameras == 1 ? 45 : 5 + 80.0 * i / static_cast<double>(size.cameras - 1);
    const Vector3d eye = on_ball(middle, kDistanceMm, 1.5 * (i % 2), elevation);
    camera.camera_from_rig.rotation = looking(eye, middle + Vector3d(1, -2, 0.5)).transpose();
    camera.camera_from_rig.translation_mm = -camera.camera_from_rig.rotation * eye;
    rig.cameras.push_back(camera);
  }
  const auto add_display = [&](const char* name, double azimuth_deg, double elevation_deg,
                               double away_mm, int width, int height, double pitch_mm) {
    DisplayModel display;
    display.name = name;
    display.width_px = width;
    display.height_px = height;
    const Vector3d at = on_ball(middle, away_mm, azimuth_deg, elevation_deg);
    const Matrix3d axes = looking(at, middle);
    // The viewer stands in front: what is right for the display's own gaze is left for the viewer.
    display.u_mm = -axes.col(0) * pitch_mm;
    display.v_mm = axes.col(1) * pitch_mm;
    display.origin_mm =
        at - display.u_mm * ((width - 1) / 2.0) - display.v_mm * ((height - 1) / 2.0);
    rig.displays.push_back(display);
  };
  add_display("side", 90, 15, 450, 1920, 1080, 0.27);
  add_display("below", 50, -35, 300, 2048, 1536, 0.1);
  if (size.tablet_turns) rig.displays.back().mount = Mount::turntable;
  if (size.has_above) add_display("above", 200, 65, 450, 1920, 1080, 0.27);
  return rig;
}

Rig with_error(const Rig& rig, const RigError& error) {
  std::mt19937 random(error.seed);
  std::normal_distribution<double> normal_noise(0, 1);
  const auto draw = [&](double deviation) {
    const double x = normal_noise(random), y = normal_noise(random), z = normal_noise(random);
    return Vector3d(deviation * Vector3d(x, y, z));
  };
  Rig wrong = rig;
  for (CameraModel& camera : wrong.cameras) {
    const Vector3d by = draw(error.camera_px / camera.fx_px);
    for (int axis = 0; axis < 3; ++axis) {
      camera.camera_from_rig.rotation.col(axis) =
          turned(camera.camera_from_rig.rotation.col(axis), by.normalized(), by.norm());
    }
    camera.camera_from_rig.translation_mm =
        turned(camera.camera_from_rig.translation_mm, by.normalized(), by.norm());
  }
  for (DisplayModel& display : wrong.displays) {
    const Vector3d to_middle = display.u_mm * ((display.width_px - 1) / 2.0) +
                               display.v_mm * ((display.height_px - 1) / 2.0);
    const Vector3d middle = display.origin_mm + to_middle + draw(error.display_mm);
    const Vector3d by = draw(error.display_rad);
    display.u_mm = turned(display.u_mm, by.normalized(), by.norm());
    display.v_mm = turned(display.v_mm, by.normalized(), by.norm());
    display.origin_mm = middle - turned(to_middle, by.normalized(), by.norm());
  }
  const Vector3d along = rig.turntable.direction.normalized(), slip = draw(error.axis_mm);
  wrong.turntable.point_mm += slip - slip.dot(along) * along;
  return wrong;
}

Region region_of(const Rig& rig, const CameraModel& camera, const Vector3d& centre_mm,
                 double radius_mm) {
  double low_x = camera.width_px, high_x = 0, low_y = camera.height_px, high_y = 0;
  for (int step = 0; step < 24; ++step) {
    const Vector3d axis = rig.turntable.direction.normalized();
    const Vector3d centre = rig.turntable.point_mm + turned(centre_mm - rig.turntable.point_mm,
                                                            axis, step * std::numbers::pi / 12);
    const Vector3d c =
        camera.camera_from_rig.rotation * centre + camera.camera_from_rig.translation_mm;
    // Three pixels more than the ball without distortion, which moves the edge less than that.
    const double reach = radius_mm / c.z() * std::max(camera.fx_px, camera.fy_px) * 1.02 + 3;
    const double x = camera.cx_px + camera.fx_px * c.x() / c.z();
    const double y = camera.cy_px + camera.fy_px * c.y() / c.z();
    low_x = std::min(low_x, x - reach);
    high_x = std::max(high_x, x + reach);
    low_y = std::min(low_y, y - reach);
    high_y = std::max(high_y, y + reach);
  }
  Region region;
  region.x = static_cast<int>(std::clamp(std::floor(low_x), 0.0, camera.width_px - 1.0));
  region.y = static_cast<int>(std::clamp(std::floor(low_y), 0.0, camera.height_px - 1.0));
  region.width =
      static_cast<int>(std::clamp(std::ceil(high_x), 1.0, camera.width_px - 0.0)) - region.x;
  region.height =
      static_cast<int>(std::clamp(std::ceil(high_y), 1.0, camera.height_px - 0.0)) - region.y;
  return region;
}

LightMap light_map(const Rig& rig, const Shape& shape, const StackKey& key, double angle_rad,
                   const Coding& coding, Region region) {
  const auto is_named = [](const std::string& name) {
    return [&name](const auto& device) { return device.name == name; };
  };
  const CameraModel& camera =
      *std::find_if(rig.cameras.begin(), rig.cameras.end(), is_named(key.camera));
  const DisplayModel& display =
      *std::find_if(rig.displays.begin(), rig.displays.end(), is_named(key.display));
  if (region.width == 0) region = {0, 0, camera.width_px, camera.height_px};
  const View view(rig, shape, camera, display, angle_rad);
  return render(view, sights_of(camera, region), display, key, angle_rad, coding);
}

void scan(const Rig& rig, const Shape& shape, int stops, const Coding& coding,
          const Vector3d& ball_centre_mm, double ball_radius_mm,
          const std::function<void(LightMap)>& sink) {
  std::vector<Sights> sights;
  for (const CameraModel& camera : rig.cameras) {
    sights.push_back(sights_of(camera, region_of(rig, camera, ball_centre_mm, ball_radius_mm)));
  }
  for (int stop = 0; stop < stops; ++stop) {
    const double angle_rad = 2 * std::numbers::pi * stop / stops;
    const std::size_t cameras = rig.cameras.size();
    std::vector<LightMap> maps(rig.displays.size() * cameras);
    const auto work = [&](std::size_t first) {
      for (std::size_t i = first; i < maps.size(); i += 2) {
        const DisplayModel& display = rig.displays[i / cameras];
        const CameraModel& camera = rig.cameras[i % cameras];
        const View view(rig, shape, camera, display, angle_rad);
        maps[i] = render(view, sights[i % cameras], display, {stop, display.name, camera.name},
                         angle_rad, coding);
      }
    };
    {
      const std::jthread other(work, 1);
      work(0);
    }
    for (LightMap& map : maps) sink(std::move(map));
  }
}

}  // namespace alhazen::analytic
