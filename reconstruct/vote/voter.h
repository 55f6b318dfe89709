#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/options.h"
#include "reconstruct/run.h"
#include "reconstruct/vote/gather.h"
#include "reconstruct/vote/normal_field.h"
#include "reconstruct/vote/observations.h"
#include "reconstruct/vote/octree.h"

namespace alhazen {

/// What was voted before, to be taken over where a leaf is the same.
struct VotedBefore {
  const Octree& octree;
  const NormalField& field;
};

/// Votes at the centre of each leaf: N(x) is the highest mode of the density of its hypotheses,
/// c(x) = max(0, s − lone_support) / (prior_votes + V) (method: reconstruct/README.md).
///
/// Leaves in free space hold no votes. Bandwidths come from the leaf's edge, so a leaf that
/// `before` holds too keeps its values. Only what `observations` hold now counts; they must not
/// change meanwhile. Reentrant; uses the caller's TBB arena; the result does not depend on the
/// number of threads.
class Voter {
 public:
  Voter(const Observations& observations, const VoteOptions& options);

  /// Fails: cancelled.
  [[nodiscard]] Result<NormalField> vote(const Octree& octree, const VotedBefore* before,
                                         const Run& run) const;

  /// Hypotheses looked up by vote() so far.
  [[nodiscard]] std::uint64_t hypotheses() const noexcept { return hypotheses_; }
  /// Standard deviation of a hypothesis: the median over the light maps, by their own sigmas.
  [[nodiscard]] double noise_rad() const noexcept { return noise_rad_; }
  /// Bandwidth for a leaf of that edge.
  [[nodiscard]] double bandwidth_rad(double edge_mm) const;

 private:
  const Observations& observations_;
  VoteOptions options_;
  double noise_rad_ = 0;
  mutable std::atomic<std::uint64_t> hypotheses_ = 0;
};

/// Points that belong together for gathering: consecutive leaves inside one octree node.
struct LeafGroup {
  Eigen::Vector3d centre_mm;
  double reach_mm = 0;             ///< of the farthest leaf centre possible
  std::size_t begin = 0, end = 0;  ///< run of the list of leaves
};

/// Groups a sorted list of leaves into nodes of at most 8³ leaves and `max_reach_mm`.
[[nodiscard]] std::vector<LeafGroup> groups_of(const Octree& octree,
                                               const std::vector<std::uint32_t>& leaves,
                                               double max_reach_mm);

}  // namespace alhazen
