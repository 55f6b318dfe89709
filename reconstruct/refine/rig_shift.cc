#include "reconstruct/refine/rig_shift.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>

#include "alhazen/check.h"
#include "reconstruct/geometry/pose.h"

namespace alhazen {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Matrix3d turn_of(const Vector3d& rad) {
  const double angle = rad.norm();
  return angle > 0 ? Eigen::AngleAxisd(angle, rad / angle).toRotationMatrix()
                   : Matrix3d(Matrix3d::Identity());
}

Vector3d middle_mm(const DisplayModel& display) {
  return display.point_mm((display.width_px - 1) / 2.0, (display.height_px - 1) / 2.0);
}

Vector3d mean_centre(const Rig& rig) {
  Vector3d sum = Vector3d::Zero();
  for (const CameraModel& camera : rig.cameras) sum += camera.centre_rig_mm();
  return sum / static_cast<double>(rig.cameras.size());
}

}  // namespace

RigShift::RigShift(const Rig& rig, const Vector3d& near_mm)
    : cameras_(rig.cameras.size()), displays_(rig.displays.size()) {
  const Vector3d along = rig.turntable.direction.normalized();
  pivot_mm_ = rig.turntable.point_mm + along.dot(near_mm - rig.turntable.point_mm) * along;
  across_.col(0) = along.unitOrthogonal();
  across_.col(1) = along.cross(across_.col(0));
}

Rig RigShift::applied(const Rig& rig, const Eigen::VectorXd& by) const {
  ALHAZEN_CHECK(by.size() == size());
  Rig moved = rig;
  for (std::size_t i = 0; i < cameras_; ++i) {
    Pose& pose = moved.cameras[i].camera_from_rig;
    const Vector3d centre = rig.cameras[i].centre_rig_mm() + by.segment<3>(camera(i));
    pose.rotation = turn_of(by.segment<3>(camera(i) + 3)) * pose.rotation;
    pose.translation_mm = -(pose.rotation * centre);
  }
  for (std::size_t j = 0; j < displays_; ++j) {
    DisplayModel& screen = moved.displays[j];
    const Matrix3d turn = turn_of(by.segment<3>(display(j) + 3));
    const Vector3d middle = middle_mm(screen);
    screen.origin_mm = middle + by.segment<3>(display(j)) + turn * (screen.origin_mm - middle);
    screen.u_mm = turn * screen.u_mm;
    screen.v_mm = turn * screen.v_mm;
  }
  moved.turntable.point_mm = pivot_mm_ + across_ * by.segment<2>(axis());
  moved.turntable.direction =
      turn_of(across_ * by.segment<2>(axis() + 2)) * rig.turntable.direction.normalized();
  return moved;
}

Eigen::VectorXd RigShift::presumed_sigma(const Rig& rig, const RefineOptions& options) const {
  Eigen::VectorXd sigma(size());
  for (std::size_t i = 0; i < cameras_; ++i) {
    const CameraModel& model = rig.cameras[i];
    sigma.segment<3>(camera(i)).setConstant(options.camera_mm);
    sigma[camera(i) + 3] = options.camera_px / model.fy_px;
    sigma[camera(i) + 4] = options.camera_px / model.fx_px;
    // About the line of sight: as far at the picture's edge.
    sigma[camera(i) + 5] = options.camera_px / (std::max(model.width_px, model.height_px) / 2.0);
  }
  for (std::size_t j = 0; j < displays_; ++j) {
    sigma.segment<3>(display(j)).setConstant(options.display_mm);
    sigma.segment<3>(display(j) + 3).setConstant(options.display_rad);
  }
  sigma.segment<2>(axis()).setConstant(options.axis_mm);
  sigma.segment<2>(axis() + 2).setConstant(options.axis_rad);
  return sigma;
}

Eigen::MatrixXd RigShift::gauge_free(const Rig& rig) const {
  const Vector3d mean = mean_centre(rig);
  // Lengths in units of the rig's own, so that both kinds of rows weigh alike.
  double reach_mm = 1;
  for (const CameraModel& model : rig.cameras)
    reach_mm = std::max(reach_mm, (model.centre_rig_mm() - mean).norm());
  Eigen::MatrixXd fixed = Eigen::MatrixXd::Zero(size(), 6);  // transposed constraints
  for (std::size_t i = 0; i < cameras_; ++i) {
    fixed.block<3, 3>(camera(i), 0).setIdentity();
    fixed.block<3, 3>(camera(i), 3) =
        cross_of((rig.cameras[i].centre_rig_mm() - mean) / reach_mm).transpose();
  }
  // One camera, or all on a line, fix fewer than six: rotations that move no centre stay free.
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(fixed);
  const Eigen::MatrixXd q = qr.householderQ();
  return q.rightCols(size() - qr.rank());
}

Pose fit_of_centres(const Rig& from, const Rig& to) {
  ALHAZEN_CHECK(!from.cameras.empty() && from.cameras.size() == to.cameras.size());
  const Vector3d from_mean = mean_centre(from), to_mean = mean_centre(to);
  Matrix3d product = Matrix3d::Zero();
  for (std::size_t i = 0; i < from.cameras.size(); ++i) {
    product += (to.cameras[i].centre_rig_mm() - to_mean) *
               (from.cameras[i].centre_rig_mm() - from_mean).transpose();
  }
  // Kabsch 1976.
  const Eigen::JacobiSVD<Matrix3d> svd(product, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double sign = svd.matrixU().determinant() * svd.matrixV().determinant();
  Pose fit;
  fit.rotation = svd.matrixU() * Vector3d(1, 1, sign).asDiagonal() * svd.matrixV().transpose();
  fit.translation_mm = to_mean - fit.rotation * from_mean;
  return fit;
}

}  // namespace alhazen
