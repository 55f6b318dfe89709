#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <optional>

#include "reconstruct/geometry/camera_model.h"
#include "reconstruct/vote/normal_view.h"
#include "reconstruct/vote/tiles.h"

namespace alhazen {

/// Where a camera sees balls about a point, with room for lens distortion.
struct Spot {
  Eigen::Vector2d centre_px;
  double away_mm = 0;   ///< along the camera's axis
  double scale_px = 0;  ///< pixels that a millimetre spans a millimetre away

  /// Whether balls of that radius lie well before the camera. The others REQUIRE it.
  [[nodiscard]] bool has_before_it(double radius_mm) const { return away_mm > 2 * radius_mm; }
  /// At most, anywhere in such a ball.
  [[nodiscard]] double pixels_per_mm(double radius_mm) const {
    return scale_px / (away_mm - radius_mm);
  }
  [[nodiscard]] double radius_px(double radius_mm) const {
    return pixels_per_mm(radius_mm) * radius_mm;
  }
  /// What such a ball covers, and the pixels nearest to and about every point in it.
  [[nodiscard]] PixelRange covered(double radius_mm) const {
    return PixelRange::about(centre_px.x(), centre_px.y(), radius_px(radius_mm) + 1);
  }
};

[[nodiscard]] inline std::optional<Spot> spot_of(const CameraModel& camera, const View& view,
                                                 const Eigen::Vector3d& centre_mm) {
  const Eigen::Vector3d p = view.camera_from_object * centre_mm;
  if (p.z() <= 0) return std::nullopt;
  const auto pixel = camera.project(p);
  if (!pixel) return std::nullopt;
  // A ball off the axis is drawn out by up to 1/cos² of the field angle; distortion adds a tenth.
  const double off2 = 1 + (p.x() * p.x() + p.y() * p.y()) / (p.z() * p.z());
  return Spot{*pixel, p.z(), std::max(camera.fx_px, camera.fy_px) * off2 * 1.1};
}

}  // namespace alhazen
