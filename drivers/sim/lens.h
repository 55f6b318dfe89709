#pragma once

#include <array>

#include "drivers/sim/rigid.h"

namespace alhazen::sim {

/// Central projection with lens distortion: r = x² + y² of the plane z = 1,
///   x' = x (1 + k1 r + k2 r² + k3 r³) / (1 + k4 r + k5 r² + k6 r³) + 2 p1 x y + p2 (r + 2x²), and
/// so for y; pixel = f x' + c, pixel centres at integers. `k` is ordered k1 k2 p1 p2 k3 k4 k5 k6.
/// Source: OpenCV 4 documentation, module calib3d (the rig's calibrated model is the same one).
/// Reentrant.
struct Lens {
  double fx_px = 1, fy_px = 1, cx_px = 0, cy_px = 0;
  std::array<double, 8> k{};

  /// REQUIRES: p_camera.z() > 0.
  [[nodiscard]] Vec2 project(const Vec3& p_camera_mm) const;

  /// The point of the plane z = 1 seen at `pixel`, to 1e-12. Newton's method from `start`: the
  /// answer for a neighbouring pixel saves steps.
  [[nodiscard]] Vec2 plane_point(const Vec2& pixel, const Vec2& start) const;
  [[nodiscard]] Vec2 plane_point(const Vec2& pixel) const {
    return plane_point(pixel, {(pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px});
  }
};

}  // namespace alhazen::sim
