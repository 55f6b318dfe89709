#pragma once

#include <Eigen/Geometry>

#include "reconstruct/geometry/pose.h"

namespace alhazen {

/// The turntable's calibrated axis: a line of the rig frame. Reentrant.
struct TableModel {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();

  /// The object frame equals the rig frame at angle 0 and turns right-handed by +angle about the
  /// axis.
  [[nodiscard]] Pose rig_from_object(double angle_rad) const {
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(angle_rad, direction.normalized()).toRotationMatrix();
    return {turn, point_mm - turn * point_mm};
  }
};

}  // namespace alhazen
