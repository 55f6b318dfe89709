#include "reconstruct/vote/depth.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "alhazen/check.h"
#include "reconstruct/vote/gather.h"
#include "reconstruct/vote/parallel.h"
#include "reconstruct/vote/voter.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;

/// A step outward from the surface is in free space wherever a camera sees its outline; its votes
/// count all the same.
constexpr double kNeverFree_mm = std::numeric_limits<double>::infinity();

/// A foot point that moved by less than this share of its standard deviation stays where it is.
constexpr double kSettledShare = 0.1;

/// One observation's hypothesis at a point and how it turns along the normal.
struct Turning {
  Vector3d n, a;
  double weight = 1, residual = 0;
};

/// What the votes say at one point.
struct Agreement {
  double depth_mm = 0;     ///< d*
  double information = 0;  ///< A
  Vector3d normal = Vector3d::Zero();
  double median_residual = 0, weighted_residual2 = 0, weight = 0;
};

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Solves for depth and normal with Tukey's biweight. REQUIRES: votes not empty.
Agreement agree(std::vector<Turning>& votes, int rounds, double noise_rad,
                std::vector<double>& scratch) {
  Agreement result;
  for (int round = 0;; ++round) {
    Vector3d mean_n = Vector3d::Zero(), mean_a = Vector3d::Zero();
    double weight = 0;
    for (const Turning& vote : votes) {
      mean_n += vote.weight * vote.n;
      mean_a += vote.weight * vote.a;
      weight += vote.weight;
    }
    mean_n /= weight;
    mean_a /= weight;
    double cross = 0, information = 0;
    for (const Turning& vote : votes) {
      cross += vote.weight * (vote.n - mean_n).dot(vote.a - mean_a);
      information += vote.weight * (vote.a - mean_a).squaredNorm();
    }
    // Votes that do not turn against each other know nothing of the depth.
    result.depth_mm = information > 1e-12 ? -cross / information : 0;
    result.information = information;
    const Vector3d mode = mean_n + result.depth_mm * mean_a;
    result.normal = mode.normalized();
    result.weight = weight;
    result.weighted_residual2 = 0;
    scratch.clear();
    for (Turning& vote : votes) {
      vote.residual = (vote.n + result.depth_mm * vote.a - mode).norm();
      result.weighted_residual2 += vote.weight * vote.residual * vote.residual;
      scratch.push_back(vote.residual);
    }
    result.median_residual = median_of(scratch);
    if (round == rounds) return result;
    // The median of a two-dimensional normal error is 1.18 standard deviations of a component;
    // Tukey's constant for 95 % efficiency is 4.685.
    const double cut = 4.685 * std::max(result.median_residual / 1.18, noise_rad);
    for (Turning& vote : votes) {
      const double r = vote.residual / std::max(cut, 1e-9);
      vote.weight = r < 1 ? (1 - r * r) * (1 - r * r) : 0;
    }
  }
}

/// Of a hypothesis, by the residuals and what was presumed of them. rad².
double variance_of(const Agreement& found, double noise_rad) {
  // Two components a vote, three unknowns; the presumed noise weighs like four votes.
  constexpr double kPrior = 8;
  return (kPrior * noise_rad * noise_rad + found.weighted_residual2) /
         std::max(1.0, kPrior + 2 * found.weight - 3);
}

struct DepthWork {
  DepthWork(const Observations& observations, const VoteOptions& options)
      : gatherer(observations, options) {}
  Gatherer gatherer;
  PointBlock block;
  BlockVotes votes;
  std::vector<Turning> turning;
  std::vector<double> scratch;
  std::vector<Vector3d> at, normal;  ///< per leaf of the group
  std::vector<std::uint8_t> is_alive;
  /// Of each light map, whether it agreed with some leaf of the group in the first round: the later
  /// ones ask no others, most of which look past the surface there.
  std::vector<std::uint8_t> has_agreed;

  /// Fills `turning` with the observations that vote at all three points first − 1, first,
  /// first + 1 of the block.
  void match(std::size_t first, const Vector3d& about, double cone_rad, double step_mm) {
    turning.clear();
    const auto key = [&](std::size_t point, std::uint32_t k) {
      return votes.observation[votes.begin[point] + k];
    };
    const auto vector = [&](std::size_t point, std::uint32_t k) {
      const std::size_t i = votes.begin[point] + k;
      return Vector3d(votes.x[i], votes.y[i], votes.z[i]);
    };
    const double cone2 = cone_rad * cone_rad;
    std::uint32_t i = 0, j = 0, k = 0;
    while (i < votes.count[first] && j < votes.count[first + 1] && k < votes.count[first + 2]) {
      const auto a = key(first, i), b = key(first + 1, j), c = key(first + 2, k);
      const auto most = std::max({a, b, c});
      if (a == most && b == most && c == most) {
        const Vector3d n = vector(first + 1, j);
        if ((n - about).squaredNorm() < cone2) {
          turning.push_back({n, (vector(first + 2, k) - vector(first, i)) / (2 * step_mm), 1, 0});
          if (a < has_agreed.size()) has_agreed[a] = 1;
        }
        ++i, ++j, ++k;
        continue;
      }
      if (a < most) ++i;
      if (b < most) ++j;
      if (c < most) ++k;
    }
  }
};

}  // namespace

Result<std::vector<DepthSample>> refine_depth(
    const Observations& observations, const VoteOptions& vote_options, const DepthOptions& options,
    double noise_rad, const Octree& octree, const std::vector<std::uint32_t>& leaves,
    const std::vector<Eigen::Vector3f>& normals, const Run& run) {
  ALHAZEN_CHECK(leaves.size() == normals.size());
  std::vector<DepthSample> samples(leaves.size());
  const double max_reach_mm = Gatherer::max_reach_mm(observations, octree.volume().centre_mm);
  const std::vector<LeafGroup> groups = groups_of(octree, leaves, max_reach_mm);
  tbb::enumerable_thread_specific<DepthWork> working(
      [&] { return DepthWork(observations, vote_options); });
  const double residual_gate_rad =
      std::max(options.max_residual_rad, options.max_residual_noises * noise_rad);
  std::atomic<std::size_t> done = 0;
  for_each_index(groups.size(), [&](std::size_t g) {
    if (run.stopped()) return;
    DepthWork& mine = working.local();
    const LeafGroup& group = groups[g];
    const std::size_t count = group.end - group.begin;
    mine.at.resize(count);
    mine.normal.resize(count);
    mine.is_alive.assign(count, 1);
    mine.has_agreed.assign(observations.size(), 0);
    for (std::size_t i = 0; i < count; ++i) {
      mine.at[i] = octree.centre_mm(leaves[group.begin + i]);
      mine.normal[i] = normals[group.begin + i].cast<double>();
      if (mine.normal[i].squaredNorm() < 0.5) mine.is_alive[i] = 0;
    }
    for (int round = 0; round < options.rounds; ++round) {
      const bool is_first = round == 0, is_last = round + 1 == options.rounds;
      const double step_mm = is_first ? options.first_step_mm : options.step_mm;
      const double cone_rad = is_first ? options.first_cone_rad : options.cone_rad;
      // Foot points wander at most max_offset_edges from their leaves.
      const double stray_mm =
          step_mm + options.max_offset_edges * octree.edge_mm(leaves[group.begin]);
      mine.block.reset(group.centre_mm, group.reach_mm + stray_mm);
      for (std::size_t i = 0; i < count; ++i) {
        if (mine.is_alive[i] == 0) continue;
        for (const double t : {-step_mm, 0.0, step_mm}) {
          mine.block.add(mine.at[i] + t * mine.normal[i], kNeverFree_mm);
        }
      }
      if (mine.block.count() == 0) break;
      mine.gatherer.gather(mine.block, mine.votes, is_first ? nullptr : &mine.has_agreed);
      std::size_t point = 0;
      for (std::size_t i = 0; i < count; ++i) {
        if (mine.is_alive[i] == 0) continue;
        const std::size_t first = point;
        point += 3;
        mine.match(first, mine.normal[i], cone_rad, step_mm);
        if (mine.turning.size() < static_cast<std::size_t>(options.min_votes)) {
          mine.is_alive[i] = 0;
          continue;
        }
        const Agreement found = agree(mine.turning, options.tukey_rounds, noise_rad, mine.scratch);
        const std::size_t leaf = leaves[group.begin + i];
        const double edge_mm = octree.edge_mm(leaf);
        const double limit_mm = options.max_offset_edges * edge_mm;
        mine.at[i] += std::clamp(found.depth_mm, -limit_mm, limit_mm) * mine.normal[i];
        mine.normal[i] = found.normal;
        const Vector3d centre = octree.centre_mm(leaf);
        if ((mine.at[i] - centre).norm() > limit_mm) {
          mine.is_alive[i] = 0;
          continue;
        }
        const double variance_mm2 =
            variance_of(found, noise_rad) / std::max(found.information, 1e-12);
        const bool has_settled = !is_first && found.depth_mm * found.depth_mm <
                                                  kSettledShare * kSettledShare * variance_mm2;
        if (!is_last && !has_settled) continue;
        mine.is_alive[i] = 0;
        const auto agreeing = std::count_if(mine.turning.begin(), mine.turning.end(),
                                            [](const Turning& t) { return t.weight > 0; });
        DepthSample& sample = samples[group.begin + i];
        sample.normal = found.normal.cast<float>();
        sample.offset_mm = static_cast<float>((centre - mine.at[i]).dot(found.normal));
        sample.variance_mm2 = static_cast<float>(variance_mm2);
        sample.votes = static_cast<std::uint16_t>(agreeing);
        sample.is_accepted = agreeing >= options.min_votes &&
                             found.median_residual <= residual_gate_rad &&
                             std::abs(found.depth_mm) <= options.max_last_step_mm &&
                             std::sqrt(sample.variance_mm2) <= options.max_sigma_edges * edge_mm;
      }
    }
    if (const std::size_t n = ++done; n % 64 == 0) {
      run.tell("depth", static_cast<double>(n) / static_cast<double>(groups.size()));
    }
  });
  if (run.stopped()) return Error{Code::cancelled, "depth refinement was stopped"};
  return samples;
}

}  // namespace alhazen
