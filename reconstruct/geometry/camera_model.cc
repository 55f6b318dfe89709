#include "reconstruct/geometry/camera_model.h"

#include <Eigen/LU>
#include <cmath>

namespace alhazen {
namespace {

/// Distorted normalised coordinates of undistorted ones. OpenCV's model: x' = x·s + 2p₁xy +
/// p₂(r² + 2x²), s = (1 + k₁r² + k₂r⁴ + k₃r⁶)/(1 + k₄r² + k₅r⁴ + k₆r⁶).
inline Eigen::Vector2d distort(const std::array<double, 8>& d, const Eigen::Vector2d& p) {
  const auto [k1, k2, p1, p2, k3, k4, k5, k6] = d;
  const double x = p.x(), y = p.y(), x2 = x * x, y2 = y * y, xy2 = 2 * x * y, r2 = x2 + y2;
  const double above = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6));
  const double scale = above / below;
  return {x * scale + p1 * xy2 + p2 * (r2 + 2 * x2), y * scale + p1 * (r2 + 2 * y2) + p2 * xy2};
}

struct Distorted {
  Eigen::Vector2d point;
  Eigen::Matrix2d jacobian;
};

/// distort() with its 2×2 derivative.
Distorted distort_with_slope(const std::array<double, 8>& d, const Eigen::Vector2d& p) {
  const auto [k1, k2, p1, p2, k3, k4, k5, k6] = d;
  const double x = p.x(), y = p.y(), r2 = p.squaredNorm();
  const double above = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6));
  const double above_slope = k1 + r2 * (2 * k2 + r2 * 3 * k3);  // d/d(r²)
  const double below_slope = k4 + r2 * (2 * k5 + r2 * 3 * k6);
  const double scale = above / below;
  const double slope = (above_slope - scale * below_slope) / below;
  Distorted out;
  out.point = distort(d, p);
  out.jacobian << scale + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
      2 * x * y * slope + 2 * p1 * x + 2 * p2 * y, 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y,
      scale + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x;
  return out;
}

}  // namespace

std::optional<Eigen::Vector2d> CameraModel::project(const Eigen::Vector3d& p_camera_mm) const {
  if (!(p_camera_mm.z() > 0)) return std::nullopt;
  const Eigen::Vector2d point = distort(distortion, p_camera_mm.hnormalized());
  return Eigen::Vector2d(fx_px * point.x() + cx_px, fy_px * point.y() + cy_px);
}

std::optional<CameraModel::Projection> CameraModel::project_with_slope(
    const Eigen::Vector3d& p_camera_mm) const {
  if (!(p_camera_mm.z() > 0)) return std::nullopt;
  const Eigen::Vector2d flat = p_camera_mm.hnormalized();
  const Distorted seen = distort_with_slope(distortion, flat);
  Eigen::Matrix<double, 2, 3> flat_slope;  // of (x/z, y/z)
  flat_slope << 1, 0, -flat.x(), 0, 1, -flat.y();
  flat_slope /= p_camera_mm.z();
  const Eigen::Vector2d focal_px(fx_px, fy_px);
  return Projection{focal_px.cwiseProduct(seen.point) + Eigen::Vector2d(cx_px, cy_px),
                    focal_px.asDiagonal() * seen.jacobian * flat_slope};
}

Eigen::Vector3d CameraModel::direction(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d wanted((pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px);
  // Newton from the distorted point: quadratic, so that ten steps leave only rounding wherever the
  // model can be inverted at all.
  Eigen::Vector2d point = wanted;
  for (int step = 0; step < 10; ++step) {
    const Distorted now = distort_with_slope(distortion, point);
    const Eigen::Vector2d residual = now.point - wanted;
    if (residual.squaredNorm() < 1e-30) break;
    const double determinant = now.jacobian.determinant();
    if (std::abs(determinant) < 1e-12) break;
    point -= now.jacobian.inverse() * residual;
  }
  return Eigen::Vector3d(point.x(), point.y(), 1).normalized();
}

}  // namespace alhazen
