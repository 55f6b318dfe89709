#include "reconstruct/vote/voter.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <cmath>

#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

/// Leaves that share a block span at most 2^kGroupLevels leaf edges.
constexpr int kGroupLevels = 3;

}  // namespace

std::vector<LeafGroup> groups_of(const Octree& octree, const std::vector<std::uint32_t>& leaves,
                                 double max_reach_mm) {
  std::vector<LeafGroup> groups;
  const double edge_mm = octree.volume().edge_mm;
  // The coarsest node whose half diagonal is within reach.
  int coarsest = 0;
  while (coarsest < Octree::kMaxLevel &&
         std::sqrt(3.0) / 2 * edge_mm / (1 << coarsest) > max_reach_mm) {
    ++coarsest;
  }
  Leaf node;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    const Leaf& leaf = octree.leaves()[leaves[i]];
    const int level = std::min<int>(leaf.level, std::max(coarsest, int{leaf.level} - kGroupLevels));
    const int shift = leaf.level - level;
    const Leaf at{static_cast<std::uint16_t>(leaf.x >> shift),
                  static_cast<std::uint16_t>(leaf.y >> shift),
                  static_cast<std::uint16_t>(leaf.z >> shift), static_cast<std::uint8_t>(level)};
    if (groups.empty() || !(at == node)) {
      node = at;
      const double side = edge_mm / (1 << level);
      groups.push_back(
          {octree.low_corner_mm() + side * Eigen::Vector3d(at.x + 0.5, at.y + 0.5, at.z + 0.5),
           shift == 0 ? 0.0 : std::sqrt(3.0) / 2 * side, i, i});
    }
    groups.back().end = i + 1;
  }
  return groups;
}

Voter::Voter(const Observations& observations, const VoteOptions& options)
    : observations_(observations), options_(options) {
  std::vector<float> noise;
  for (const Observation& seen : observations.all()) {
    if (seen.noise_rad > 0) noise.push_back(seen.noise_rad);
  }
  for (const NormalView& seen : observations.normal_views()) {
    if (seen.noise_rad > 0) noise.push_back(seen.noise_rad);
  }
  if (!noise.empty()) {
    const auto middle = noise.begin() + static_cast<std::ptrdiff_t>(noise.size() / 2);
    std::nth_element(noise.begin(), middle, noise.end());
    noise_rad_ = *middle;
  }
}

double Voter::bandwidth_rad(double edge_mm) const {
  const double halvings = std::log2(options_.bandwidth_edge_mm / edge_mm);
  return std::clamp(options_.bandwidth_rad * std::pow(options_.bandwidth_ratio, halvings),
                    std::min(options_.bandwidth_noises * noise_rad_, 0.5), 0.5);
}

Result<NormalField> Voter::vote(const Octree& octree, const VotedBefore* before,
                                const Run& run) const {
  const std::size_t size = octree.size();
  NormalField field;
  field.normal.assign(size, Eigen::Vector3f::Zero());
  field.consistency.assign(size, 0);
  field.support.assign(size, 0);
  field.votes.assign(size, 0);
  field.free_space.assign(size, 0);
  field.no_surface.assign(size, 0);

  std::vector<std::uint32_t> leaves;
  if (before != nullptr) {
    const std::vector<std::uint32_t> old = octree.leaf_in(before->octree);
    for (std::size_t i = 0; i < size; ++i) {
      const std::size_t from = old[i];
      // A part of free space is free, and so on. Of leaves that were merged the one in the middle
      // speaks for all: it knew better than a vote with a larger leaf's bandwidth.
      field.free_space[i] = before->field.free_space[from];
      field.no_surface[i] = before->field.no_surface[from];
      if (field.free_space[i] != 0 || field.no_surface[i] != 0) continue;
      if (before->octree.leaves()[from].level < octree.leaves()[i].level) {
        leaves.push_back(static_cast<std::uint32_t>(i));
        continue;
      }
      field.normal[i] = before->field.normal[from];
      field.consistency[i] = before->field.consistency[from];
      field.support[i] = before->field.support[from];
      field.votes[i] = before->field.votes[from];
    }
  } else {
    leaves.resize(size);
    for (std::size_t i = 0; i < size; ++i) leaves[i] = static_cast<std::uint32_t>(i);
  }

  struct Working {
    Working(const Observations& observations, const VoteOptions& vote_options)
        : options(vote_options), gatherer(observations, vote_options) {}
    /// Of `count` votes from `at` on.
    kernels::Mode mode_of(std::size_t at, std::size_t count, double bandwidth_rad) {
      float *x = votes.x.data() + at, *y = votes.y.data() + at, *z = votes.z.data() + at;
      const auto h = static_cast<float>(bandwidth_rad);
      const auto lone = static_cast<float>(options.lone_support);
      switch (options.density) {
        case Density::gaussian:
          return kernels::mean_shift(x, y, z, count, h, lone);
        case Density::epanechnikov:
          return kernels::mean_shift_epanechnikov(x, y, z, count, h, lone);
        case Density::histogram:
          break;
      }
      scratch.resize(std::max(scratch.size(), count));
      return kernels::histogram_mode(x, y, z, count, h, scratch.data());
    }
    VoteOptions options;
    Gatherer gatherer;
    PointBlock block;
    BlockVotes votes;
    std::vector<std::uint64_t> scratch;
  };
  tbb::enumerable_thread_specific<Working> working(
      [&] { return Working(observations_, options_); });
  const std::vector<LeafGroup> groups =
      groups_of(octree, leaves, Gatherer::max_reach_mm(observations_, octree.volume().centre_mm));
  std::atomic<std::size_t> done = 0;
  for_each_index(groups.size(), [&](std::size_t g) {
    if (run.stopped()) return;
    Working& mine = working.local();
    const LeafGroup& group = groups[g];
    mine.block.reset(group.centre_mm, group.reach_mm);
    for (std::size_t k = group.begin; k < group.end; ++k) {
      mine.block.add(octree.centre_mm(leaves[k]), octree.edge_mm(leaves[k]) * std::sqrt(3.0) / 2);
    }
    hypotheses_ += mine.gatherer.gather(mine.block, mine.votes);
    for (std::size_t k = group.begin; k < group.end; ++k) {
      const std::size_t leaf = leaves[k], point = k - group.begin;
      const std::size_t count = mine.votes.count[point];
      field.free_space[leaf] = mine.votes.free_space[point];
      field.votes[leaf] = static_cast<std::uint16_t>(std::min<std::size_t>(count, 65535));
      if (count < 2) continue;
      const std::size_t at = mine.votes.begin[point];
      const kernels::Mode mode = mine.mode_of(at, count, bandwidth_rad(octree.edge_mm(leaf)));
      field.support[leaf] = mode.support;
      const double agreeing = std::max(0.0, mode.support - options_.lone_support);
      if (agreeing <= 0) continue;
      field.normal[leaf] = Eigen::Vector3f(mode.x, mode.y, mode.z);
      field.consistency[leaf] =
          static_cast<float>(agreeing / (options_.prior_votes + static_cast<double>(count)));
    }
    if (const std::size_t n = ++done; n % 256 == 0) {
      run.tell("vote", static_cast<double>(n) / static_cast<double>(groups.size()));
    }
  });
  if (run.stopped()) return Error{Code::cancelled, "voting was stopped"};
  return field;
}

}  // namespace alhazen
