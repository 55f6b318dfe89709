#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <optional>

#include "alhazen/image.h"
#include "reconstruct/geometry/camera_model.h"
#include "reconstruct/vote/normal_view.h"

namespace alhazen {

/// Where a ball is seen by a camera, with room for lens distortion.
struct Spot {
  Eigen::Vector2d centre_px;
  double radius_px = 0;
  double pixels_per_mm = 0;
};

[[nodiscard]] inline std::optional<Spot> spot_of(const CameraModel& camera, const View& view,
                                                 const Eigen::Vector3d& centre_mm,
                                                 double radius_mm) {
  const Eigen::Vector3d p = view.camera_from_object * centre_mm;
  if (p.z() <= 2 * radius_mm) return std::nullopt;
  const auto pixel = camera.project(p);
  if (!pixel) return std::nullopt;
  // A ball off the axis is drawn out by up to 1/cos² of the field angle; distortion adds a tenth.
  const double off2 = 1 + (p.x() * p.x() + p.y() * p.y()) / (p.z() * p.z());
  const double scale = std::max(camera.fx_px, camera.fy_px) / (p.z() - radius_mm) * off2 * 1.1;
  return Spot{*pixel, scale * radius_mm, scale};
}

[[nodiscard]] inline bool overlaps(const Region& box, const Spot& spot) {
  return spot.centre_px.x() + spot.radius_px >= box.x &&
         spot.centre_px.x() - spot.radius_px <= box.x + box.width &&
         spot.centre_px.y() + spot.radius_px >= box.y &&
         spot.centre_px.y() - spot.radius_px <= box.y + box.height;
}

}  // namespace alhazen
