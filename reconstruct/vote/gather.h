#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "reconstruct/options.h"
#include "reconstruct/vote/kernels.h"
#include "reconstruct/vote/observations.h"
#include "reconstruct/vote/spot.h"

namespace alhazen {

/// Room for `size` elements and more: a list that is filled again and again seldom grows.
template <class T>
void grow_to(std::vector<T>& list, std::size_t size) {
  if (list.size() < size) list.resize(size + size / 2);
}

/// Points near each other, as offsets from a centre; object frame. add() keeps the lists padded.
class PointBlock {
 public:
  /// Every offset will be at most `reach_mm` long.
  void reset(const Eigen::Vector3d& centre_mm, double reach_mm);
  /// `radius_mm`: of the ball around the point that must be free for the point to be; infinite for
  /// one that never is, which saves looking.
  void add(const Eigen::Vector3d& p_object_mm, double radius_mm);
  [[nodiscard]] std::size_t count() const noexcept { return count_; }

 private:
  friend class Gatherer;
  /// Some point may.
  [[nodiscard]] bool may_be_free() const { return std::isfinite(least_radius_mm_); }

  Eigen::Vector3d centre_mm_;
  double reach_mm_ = 0;
  std::size_t count_ = 0;
  float least_radius_mm_ = 0;
  std::vector<float> x_mm_, y_mm_, z_mm_, radius_mm_;
};

/// The votes at the points of a block. Those of point i are [begin[i], begin[i] + count[i]) of the
/// lists, in the order of the observations; behind them is room for kernels::kPadding more.
struct BlockVotes {
  std::vector<std::uint32_t> begin, count;
  std::vector<float> x, y, z;  ///< unit normals, object frame
  /// Index into Observations::all(), or beyond it into normal_views().
  std::vector<std::uint16_t> observation;
  std::vector<std::uint8_t> free_space;  ///< per point: a camera sees a display through its ball
};

/// Gathers the hypotheses at points. Holds its working memory: one a thread.
class Gatherer {
 public:
  /// The farthest that points of one block may be from its centre, so that the local projection is
  /// exact to 1e-3 px: its third order term is f/Z · (reach/Z)² · reach.
  [[nodiscard]] static double max_reach_mm(const Observations& observations,
                                           const Eigen::Vector3d& centre_mm);

  Gatherer(const Observations& observations, const VoteOptions& options)
      : observations_(observations), options_(options) {}

  /// Votes in free space are left out. `is_asked`: whether to look into each of
  /// Observations::all(); into each one where it is null. Returns the number of hypotheses looked
  /// up.
  std::uint64_t gather(const PointBlock& block, BlockVotes& votes,
                       const std::vector<std::uint8_t>* is_asked = nullptr);

 private:
  struct Run {
    std::size_t observation, begin, end;
  };
  /// What one view needs of the block: false where it does not see it.
  bool project_block(const View& view, const PointBlock& block);
  [[nodiscard]] bool is_free(const PointBlock& block) const;
  void look_for_sight(const Clearance& sight, const PointBlock& block, float pixels_per_mm,
                      BlockVotes& votes) const;
  /// Whether some normal map sees nothing but background through the whole block.
  [[nodiscard]] bool is_clear_of_object(const PointBlock& block, double radius_mm) const;
  /// Appends the votes of the normal maps and marks free space; returns the look-ups.
  std::uint64_t gather_normals(const PointBlock& block, BlockVotes& votes, std::size_t& written);

  const Observations& observations_;
  VoteOptions options_;
  std::vector<std::optional<Spot>> spots_;  ///< of the block's centre, by view
  std::vector<float> x_px_, y_px_, scratch_;
  std::vector<std::uint32_t> point_;
  std::vector<float> x_, y_, z_;
  std::vector<Run> runs_;
};

}  // namespace alhazen
