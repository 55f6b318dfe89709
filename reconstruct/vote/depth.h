#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/options.h"
#include "reconstruct/run.h"
#include "reconstruct/vote/observations.h"
#include "reconstruct/vote/octree.h"

namespace alhazen {

/// Where the votes near a leaf place the surface.
struct DepthSample {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  ///< unit, outward, at the foot point
  float offset_mm = 0;      ///< signed distance of the leaf's centre, positive outside
  float variance_mm2 = 0;   ///< of offset_mm, from the votes' spread and their geometry
  std::uint16_t votes = 0;  ///< that agreed
  bool is_accepted = false;
};

/// Vote-variance depth: at a point x near the surface with normal N the hypotheses n_v(x + tN) run
/// apart linearly, n_v + t a_v; the surface is where they agree best:
///   d* = − Σ w (n_v − n̄)·(a_v − ā) / A,   A = Σ w |a_v − ā|²,   N* = n̄ + d* ā
/// with a_v by central difference over the step, votes of one observation at the three points
/// matched, only those within a cone about N, Tukey weights w. x ← x + d*N*, and again with the
/// next step and cone. Accepted with enough votes, a median residual as small as the vote noise
/// allows, a small last step and a foot point near the leaf. The variance is σ²/A.
///
/// `leaves`: sorted indices; `normals`: a first guess for each. The result runs parallel to them.
/// Fails: cancelled. Reentrant; uses the caller's TBB arena; the result does not depend on the
/// number of threads.
/// Source: the condition that hypotheses agree on the surface is the thesis's (M. Weinmann,
/// chapter 5); solving it for the depth is derived in reconstruct/README.md.
[[nodiscard]] Result<std::vector<DepthSample>> refine_depth(
    const Observations& observations, const VoteOptions& vote_options, const DepthOptions& options,
    double noise_rad, const Octree& octree, const std::vector<std::uint32_t>& leaves,
    const std::vector<Eigen::Vector3f>& normals, const Run& run);

}  // namespace alhazen
