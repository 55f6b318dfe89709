#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/options.h"
#include "reconstruct/run.h"
#include "reconstruct/surface/indicator.h"
#include "reconstruct/vote/octree.h"

namespace alhazen {

/// What was measured about the surface near each leaf. Lists run parallel to Octree::leaves();
/// object frame. A leaf may know a normal and no depth.
struct SurfaceSamples {
  std::vector<Eigen::Vector3f> normal;  ///< unit, outward, at the foot point; zero: not observed
  std::vector<float> offset_mm;         ///< signed distance of the leaf's centre along the normal,
                                        ///< positive outside; ignored where weight is 0
  std::vector<float> weight;            ///< 1/variance of offset_mm, 1/mm²; 0: no depth
};

/// A signed distance near the surface, on the finest leaves.
struct SignedDistance {
  /// Per leaf, mm, positive outside; beyond the band around the cut a constant of the right sign.
  std::vector<float> value_mm;
  std::vector<std::uint8_t> in_band;  ///< 1: solved for
  std::size_t unknowns = 0;
  std::size_t clipped = 0;  ///< leaves at the band's edge that had to be held to the cut's side
  int iterations = 0;       ///< of conjugate gradients, all rounds together
  double residual = 0;      ///< ‖b − A f‖ / ‖b‖ at the end, recomputed in double
};

/// Smooth signed distance f in a band of finest leaves around the cut u = ½, lengths in units s of
/// the finest leaf's edge:
///   min_f  Σ_edges ω_ab (f_b − f_a − t_ab)²  +  β Σ_i (w_i / w_median) (f_i − offset_i)²
///                                            +  α ω_0 Σ_unobserved (f_i − cut_i)²
/// ω_ab = mean of the two leaves' ω: 1 where a normal was observed, ω_0 = 0.03 elsewhere;
/// t_ab = the integral of N·e along the edge where observed (cubic through four leaves, or the mean
/// of two), the cut's own slope elsewhere;
/// cut_i = smoothed distance from the cut, so that unobserved parts close along the cut and blend
/// into what was measured; β = options.data_weight, α = options.cut_weight. Depths that contradict
/// their surroundings are down-weighted (Tukey's biweight, two rounds).
/// Solved by conjugate gradients preconditioned with a multigrid cycle over octree parents.
///
/// Fails: invalid (lists of another length, weight negative or not finite), conflict (the cut has
/// no surface: all inside or all outside; or no finest leaf touches it), cancelled.
/// Reentrant; uses the caller's TBB arena; the result is the same for any number of threads.
/// Source: after Calakli and Taubin, Computer Graphics Forum 2011.
[[nodiscard]] Result<SignedDistance> signed_distance(const Octree& octree,
                                                     const std::vector<Face>& faces,
                                                     const Indicator& cut,
                                                     const SurfaceSamples& samples,
                                                     const SurfaceOptions& options, const Run& run);

}  // namespace alhazen
