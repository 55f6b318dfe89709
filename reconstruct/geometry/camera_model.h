#pragma once

#include <array>
#include <optional>
#include <string>

#include "reconstruct/geometry/pose.h"

namespace alhazen {

/// A calibrated pinhole camera with OpenCV's distortion (k1 k2 p1 p2 k3 k4 k5 k6; the rational
/// model where k4 … k6 are not zero). Camera frame: x right, y down, z forward. Pixel centres are
/// integers. Source: OpenCV 4 documentation, module calib3d. Reentrant.
struct CameraModel {
  std::string name;
  int width_px = 0, height_px = 0;
  double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
  std::array<double, 8> distortion{};
  Pose camera_from_rig;

  /// Pixel of a point of the camera frame; nothing behind the camera (z ≤ 0) has one. The pixel may
  /// lie outside the picture.
  [[nodiscard]] std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& p_camera_mm) const;

  /// A pixel and how it moves with the point: d pixel / d point, px/mm.
  struct Projection {
    Eigen::Vector2d pixel;
    Eigen::Matrix<double, 2, 3> slope;
  };
  /// project() with its derivative.
  [[nodiscard]] std::optional<Projection> project_with_slope(
      const Eigen::Vector3d& p_camera_mm) const;

  /// Unit direction (camera frame) that is seen at `pixel`: the inverse of project(), to 1e-9 px.
  [[nodiscard]] Eigen::Vector3d direction(const Eigen::Vector2d& pixel) const;

  [[nodiscard]] Eigen::Vector3d centre_rig_mm() const {
    return camera_from_rig.inverse().translation_mm;
  }
};

}  // namespace alhazen
