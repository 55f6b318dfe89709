#include "drivers/sim/lens.h"

#include <cmath>

namespace alhazen::sim {
namespace {

struct Distorted {
  Vec2 point;
  Eigen::Matrix2d slope;  // of `point` by the undistorted one
};

Distorted distort(const Vec2& p, const std::array<double, 8>& k) {
  const double x = p.x(), y = p.y(), r = x * x + y * y;
  const double above = 1 + r * (k[0] + r * (k[1] + r * k[4]));
  const double below = 1 + r * (k[5] + r * (k[6] + r * k[7]));
  const double above_slope = k[0] + r * (2 * k[1] + r * 3 * k[4]);
  const double below_slope = k[5] + r * (2 * k[6] + r * 3 * k[7]);
  const double radial = above / below;
  const double radial_slope = (above_slope - radial * below_slope) / below;  // by r
  const double p1 = k[2], p2 = k[3];
  Distorted out;
  out.point = {x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x),
               y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y};
  out.slope(0, 0) = radial + 2 * x * x * radial_slope + 2 * p1 * y + 6 * p2 * x;
  out.slope(0, 1) = 2 * x * y * radial_slope + 2 * p1 * x + 2 * p2 * y;
  out.slope(1, 0) = out.slope(0, 1);
  out.slope(1, 1) = radial + 2 * y * y * radial_slope + 6 * p1 * y + 2 * p2 * x;
  return out;
}

}  // namespace

Vec2 Lens::project(const Vec3& p_camera_mm) const {
  const Vec2 p =
      distort({p_camera_mm.x() / p_camera_mm.z(), p_camera_mm.y() / p_camera_mm.z()}, k).point;
  return {fx_px * p.x() + cx_px, fy_px * p.y() + cy_px};
}

Vec2 Lens::plane_point(const Vec2& pixel, const Vec2& start) const {
  const Vec2 wanted((pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px);
  Vec2 p = start;
  constexpr int kMostSteps = 20;  // real lenses need 2 to 4; a folded one would never end
  for (int step = 0; step < kMostSteps; ++step) {
    const Distorted now = distort(p, k);
    const Vec2 miss = wanted - now.point;
    const double det = now.slope(0, 0) * now.slope(1, 1) - now.slope(0, 1) * now.slope(1, 0);
    p.x() += (miss.x() * now.slope(1, 1) - miss.y() * now.slope(0, 1)) / det;
    p.y() += (miss.y() * now.slope(0, 0) - miss.x() * now.slope(1, 0)) / det;
    // Quadratic convergence: a miss of 1e-7 was mended to 1e-14 by the step just made.
    if (std::abs(miss.x()) + std::abs(miss.y()) < 1e-7) break;
  }
  return p;
}

}  // namespace alhazen::sim
