#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "reconstruct/refine/rig_shift.h"
#include "reconstruct/vote/observations.h"

namespace alhazen {

/// One observation's hypothesis at a point and how it turns when the point or a device moves.
/// Normals in the object frame.
struct SightVote {
  std::size_t observation = 0;  ///< of Observations::all()
  std::size_t camera = 0, display = 0;
  Eigen::Vector3d normal;    ///< unit
  Eigen::Matrix3d by_point;  ///< of the object frame, 1/mm
  Eigen::Matrix<double, 3, RigShift::kDevice> by_camera, by_display;
  Eigen::Matrix<double, 3, RigShift::kAxis> by_axis;
};

/// Looks hypotheses up with any rig, in double and with derivatives: for thousands of points, where
/// vote/gather.h is for millions and one rig. Holds references; reentrant.
class Sight {
 public:
  /// The maps of `observations`, as seen by `rig`: the same devices in the same order, elsewhere.
  /// `shift`: whose numbers derivatives are taken by.
  Sight(const Observations& observations, const Rig& rig, const RigShift& shift, double min_cosine);

  /// The votes at `p` (object frame) within `cone_rad` of the unit vector `about`, in the order of
  /// the observations.
  void look(const Eigen::Vector3d& p, const Eigen::Vector3d& about, double cone_rad,
            std::vector<SightVote>& votes) const;

 private:
  /// The table at one stop.
  struct Turned {
    Pose rig_from_object;
    Pose camera_from_object;
    Eigen::Matrix<double, 3, 2> slip;  ///< motion of the object per shift or tilt of the axis
  };
  const Observations& observations_;
  const Rig& rig_;
  double min_cosine_;
  Eigen::Vector3d pivot_mm_;
  std::vector<Turned> turned_;         ///< per view
  std::vector<std::size_t> display_;   ///< per observation
  std::vector<Eigen::Vector3d> eyes_;  ///< per camera, rig frame
};

}  // namespace alhazen
