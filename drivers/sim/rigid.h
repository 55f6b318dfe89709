#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace alhazen::sim {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;

/// Rigid transform, named by both ends (`camera_from_rig`). Millimetres. The simulation keeps its
/// own geometry so that an error in the reconstruction's is not repeated here. Reentrant.
struct Rigid {
  Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
  Vec3 shift_mm = Vec3::Zero();

  [[nodiscard]] Vec3 operator*(const Vec3& p) const { return turn * p + shift_mm; }
  [[nodiscard]] Rigid operator*(const Rigid& inner) const {
    return {turn * inner.turn, turn * inner.shift_mm + shift_mm};
  }
  [[nodiscard]] Rigid inverse() const { return {turn.transpose(), -(turn.transpose() * shift_mm)}; }
};

/// Axes (columns x right, y down, z away) of a viewer or screen that looks along `forward`, upright
/// with respect to the rig's z; looking straight up or down, the rig's y is up in the picture.
[[nodiscard]] inline Eigen::Matrix3d upright_axes(const Vec3& forward, double roll_rad) {
  const Vec3 z = forward.normalized();
  const Vec3 up = std::abs(z.z()) < 0.999999 ? Vec3::UnitZ() : Vec3::UnitY();
  const Vec3 x = z.cross(up).normalized();
  Eigen::Matrix3d axes;
  axes << x, z.cross(x), z;
  return axes * Eigen::AngleAxisd(roll_rad, Vec3::UnitZ()).toRotationMatrix();
}

}  // namespace alhazen::sim
