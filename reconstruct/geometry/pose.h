#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace alhazen {

/// Rigid transform, named by both ends: `camera_from_rig * p_rig` is a point of the camera frame.
/// Millimetres. Reentrant.
struct Pose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation_mm = Eigen::Vector3d::Zero();

  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& p) const {
    return rotation * p + translation_mm;
  }
  [[nodiscard]] Pose operator*(const Pose& inner) const {
    return {rotation * inner.rotation, rotation * inner.translation_mm + translation_mm};
  }
  [[nodiscard]] Pose inverse() const {
    return {rotation.transpose(), -(rotation.transpose() * translation_mm)};
  }
};

/// [v]: the matrix with [v] w = v × w.
[[nodiscard]] inline Eigen::Matrix3d cross_of(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

/// A half line: unit direction, same frame as its origin.
struct Ray {
  Eigen::Vector3d origin_mm, direction;
};

}  // namespace alhazen
