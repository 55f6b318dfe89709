#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/options.h"
#include "reconstruct/run.h"

namespace alhazen {

class Observations;

/// A place on the surface as a first reconstruction found it, object frame.
struct SurfacePoint {
  Eigen::Vector3d p_mm;
  Eigen::Vector3d normal;  ///< unit, outward
};

/// How far the votes at points disagree once each point has the normal and depth that suit them
/// best.
struct VoteResidual {
  std::size_t points = 0, votes = 0;
  double median_rad = 0;  ///< of all votes
};

/// What a refinement did to one device.
struct DeviceShift {
  std::string name;                    ///< as in the rig; "turntable" for the axis
  double shift_mm = 0, turn_rad = 0;   ///< lengths
  double sigma_mm = 0, sigma_rad = 0;  ///< what is left uncertain: RMS over the coordinates
};

/// A calibration refined from a scan's own reflections.
/// How a refinement went.
struct Refinement {
  bool is_accepted = false;
  std::string refusal;  ///< why not; empty where accepted
  int iterations = 0;
  VoteResidual used_before, used_after;
  VoteResidual held_out_before, held_out_after;  ///< at points that had no part in it
  std::vector<DeviceShift> shifts;  ///< cameras, displays, turntable; empty where not accepted
};

struct RefinedRig {
  Rig rig;  ///< the previous one where the refinement was not accepted
  Refinement how;
};

/// Refines all poses of `observations.rig()` so that the votes at points of a surface agree better:
/// minimises
///   Σ_points min_{N, t} Σ_votes w |n_v(x + tN; θ) − N|² / σ²  +  Σ θ² / σ_θ²
/// over the motion θ of every camera, display and the axis (RigShift) by Gauss-Newton, each point's
/// normal N and depth t eliminated; w is Tukey's biweight, σ the votes' own scale, σ_θ what the
/// options presume of the previous calibration. No shape is presumed. The whole rig's motion is
/// fixed by the rigid fit of all camera centres to the previous ones.
///
/// It judges itself on points that it did not use: where the median residual of their votes did not
/// fall, or where there are too few points, the previous rig comes back with the reason (refusal).
///
/// REQUIRES: options within their ranges (Options::is_valid()).
/// Fails: cancelled. Reentrant; uses the caller's TBB arena; the result does not
/// depend on the number of threads.
/// Source: derived in reconstruct/README.md; variable projection: Golub and Pereyra 1973.
[[nodiscard]] Result<RefinedRig> refine_rig(const Observations& observations,
                                            const std::vector<SurfacePoint>& surface,
                                            const VoteOptions& vote_options,
                                            const RefineOptions& options, const Run& run);

}  // namespace alhazen
