#pragma once

#include <Eigen/Core>
#include <cstddef>

#include "reconstruct/geometry/rig.h"
#include "reconstruct/options.h"

namespace alhazen {

/// A small motion of every device of a rig, as one vector: what a refinement of the calibration may
/// change. Order of its numbers:
///   camera i at camera(i):   shift of its centre (3, mm, rig frame), turn about it (3, rad, camera
///                            frame);
///   display j at display(j): shift of its middle (3, mm, frame of its mount), turn about it (3,
///                            rad, same frame);
///   turntable at axis():     shift of the axis along two directions across it (2, mm), tilt about
///                            the same two (2, rad).
/// Tilts leave the axis's point nearest to `near_mm` where it is, so that shift and tilt are
/// independent where the object stands. Reentrant.
class RigShift {
 public:
  static constexpr int kDevice = 6, kAxis = 4;  ///< numbers of a camera or display, of the axis

  RigShift(const Rig& rig, const Eigen::Vector3d& near_mm);

  [[nodiscard]] Eigen::Index camera(std::size_t i) const {
    return kDevice * static_cast<Eigen::Index>(i);
  }
  [[nodiscard]] Eigen::Index display(std::size_t j) const { return camera(cameras_ + j); }
  [[nodiscard]] Eigen::Index axis() const { return display(displays_); }
  [[nodiscard]] Eigen::Index size() const { return axis() + kAxis; }

  /// The axis's point that tilts leave in place.
  [[nodiscard]] const Eigen::Vector3d& pivot_mm() const { return pivot_mm_; }
  /// The two directions across the axis, as columns.
  [[nodiscard]] const Eigen::Matrix<double, 3, 2>& across() const { return across_; }

  /// The rig of the constructor, moved. REQUIRES: by.size() == size().
  [[nodiscard]] Rig applied(const Rig& rig, const Eigen::VectorXd& by) const;

  /// Standard deviations of the calibration that a refinement starts from, in the vector's order.
  [[nodiscard]] Eigen::VectorXd presumed_sigma(const Rig& rig, const RefineOptions& options) const;

  /// Orthonormal columns that span the motions whose rigid fit of all camera centres to `rig`'s is
  /// the identity: a motion of the whole rig together with the object changes no picture. (The fit
  /// of centres c + δ to c is the identity where Σ δ = 0 and Σ (c − c̄) × δ = 0.)
  [[nodiscard]] Eigen::MatrixXd gauge_free(const Rig& rig) const;

 private:
  std::size_t cameras_, displays_;
  Eigen::Vector3d pivot_mm_;
  Eigen::Matrix<double, 3, 2> across_;
};

/// The rigid motion (no scale) that takes the camera centres of `from` nearest to those of `to`
/// (least squares): how results with different calibrations of one rig are brought into one frame.
/// REQUIRES: the same cameras in the same order; three centres that are not on one line.
[[nodiscard]] Pose fit_of_centres(const Rig& from, const Rig& to);

}  // namespace alhazen
