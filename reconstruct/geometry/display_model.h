#pragma once

#include <cstdint>
#include <string>

#include "reconstruct/geometry/pose.h"

namespace alhazen {

/// What a display is fixed to: the light of one on the turntable turns with the object.
enum class Mount : std::uint8_t { rig, turntable };

/// A calibrated flat display. Its point for pixel (u, v), in the frame of its mount (rig frame, or
/// object frame for Mount::turntable), is origin + u·u_mm + v·v_mm. Reentrant.
struct DisplayModel {
  std::string name;
  int width_px = 0, height_px = 0;
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();  ///< centre of the top-left pixel
  Eigen::Vector3d u_mm =
      Eigen::Vector3d::UnitX();  ///< one pixel to the right, as the viewer sees it
  Eigen::Vector3d v_mm = -Eigen::Vector3d::UnitZ();  ///< one pixel down
  Mount mount = Mount::rig;
  double gamma = 2.2;  ///< light = value^gamma

  [[nodiscard]] Eigen::Vector3d point_mm(double u_px, double v_px) const {
    return origin_mm + u_px * u_mm + v_px * v_mm;
  }
  /// Unit normal into the screen, away from the viewer: u × v. The lit side is the other one.
  [[nodiscard]] Eigen::Vector3d inward() const { return u_mm.cross(v_mm).normalized(); }
};

}  // namespace alhazen
