#include "reconstruct/vote/rivals.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <vector>

#include "reconstruct/vote/gather.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

/// Two leaves this many edges apart along a line of sight are two surfaces.
constexpr double kApart = 4;
/// Claims are kept for squares of so many pixels: leaves of the start level are larger.
constexpr int kSquare_px = 4;
/// A claim counts against a leaf from this ratio of consistencies on.
constexpr float kRatio = 2;

/// Who claims the pixels of one view: consistency in the high half of a word, distance from the eye
/// in the low half, so that the greatest word is the most consistent claim.
class Claims {
 public:
  Claims(const CameraModel& camera, double reach_mm)
      : columns_((camera.width_px + kSquare_px - 1) / kSquare_px),
        rows_((camera.height_px + kSquare_px - 1) / kSquare_px),
        unit_mm_(reach_mm / 65535),
        words_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_)) {}

  void claim(const Eigen::Vector2d& at_px, double radius_px, double distance_mm,
             float consistency) {
    const auto word = static_cast<std::uint32_t>(std::min(consistency, 1.0F) * 65535) << 16 |
                      static_cast<std::uint32_t>(std::clamp(distance_mm / unit_mm_, 0.0, 65535.0));
    const auto square = [](double px) { return static_cast<int>(std::floor(px / kSquare_px)); };
    const int x0 = std::max(square(at_px.x() - radius_px), 0),
              x1 = std::min(square(at_px.x() + radius_px), columns_ - 1),
              y0 = std::max(square(at_px.y() - radius_px), 0),
              y1 = std::min(square(at_px.y() + radius_px), rows_ - 1);
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        std::atomic<std::uint32_t>& place = words_[index(x, y)];
        std::uint32_t old = place.load(std::memory_order_relaxed);
        while (old < word && !place.compare_exchange_weak(old, word, std::memory_order_relaxed)) {
        }
      }
    }
  }

  [[nodiscard]] bool is_lost(const Eigen::Vector2d& at_px, double distance_mm, float consistency,
                             double apart_mm) const {
    const int x = static_cast<int>(at_px.x()) / kSquare_px,
              y = static_cast<int>(at_px.y()) / kSquare_px;
    if (at_px.x() < 0 || at_px.y() < 0 || x >= columns_ || y >= rows_) return false;
    const std::uint32_t word = words_[index(x, y)].load(std::memory_order_relaxed);
    const float claimed = static_cast<float>(word >> 16) / 65535;
    return claimed >= kRatio * consistency &&
           std::abs((word & 0xFFFFU) * unit_mm_ - distance_mm) > apart_mm;
  }

 private:
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(x);
  }
  int columns_, rows_;
  double unit_mm_;
  std::vector<std::atomic<std::uint32_t>> words_;
};

struct RivalWork {
  RivalWork(const Observations& observations, const VoteOptions& options)
      : gatherer(observations, options) {}
  Gatherer gatherer;
  PointBlock block;
  BlockVotes votes;
};

}  // namespace

Status remove_rivals(const Observations& observations, const VoteOptions& options,
                     const Voter& voter, double min_consistency, const Octree& octree,
                     NormalField& field, const Run& run) {
  const double edge_mm = octree.volume().edge_mm / (1 << octree.finest_level());
  const double bandwidth_rad = voter.bandwidth_rad(edge_mm);
  const double max_reach_mm = Gatherer::max_reach_mm(observations, octree.volume().centre_mm);
  std::vector<const View*> views;
  std::vector<std::size_t> view_of(observations.map_count());  // by the number that votes name
  for (const View& view : observations.views()) {
    for (std::size_t i = view.begin; i < view.end; ++i) view_of[i] = views.size();
    views.push_back(&view);
  }
  for (std::size_t k = 0; k < observations.normal_views().size(); ++k) {
    view_of[observations.size() + k] = views.size();
    views.push_back(&observations.normal_views()[k].view);
  }
  std::vector<Claims> claims;
  claims.reserve(views.size());
  for (const View* seen : views) {
    const View& view = *seen;
    claims.emplace_back(
        observations.rig().cameras[view.camera],
        (view.eye_object_mm - octree.volume().centre_mm).norm() + octree.volume().edge_mm);
  }
  tbb::enumerable_thread_specific<RivalWork> working(
      [&] { return RivalWork(observations, options); });

  // Calls body(leaf, view, weight, pixel, distance) for each vote near the leaf's normal, and
  // after(leaf) behind its last.
  const auto for_votes = [&](const std::vector<std::uint32_t>& leaves, const auto& body,
                             const auto& after) {
    const std::vector<LeafGroup> groups = groups_of(octree, leaves, max_reach_mm);
    for_each_index(groups.size(), [&](std::size_t g) {
      if (run.stopped()) return;
      RivalWork& mine = working.local();
      const LeafGroup& group = groups[g];
      mine.block.reset(group.centre_mm, group.reach_mm);
      for (std::size_t k = group.begin; k < group.end; ++k) {
        mine.block.add(octree.centre_mm(leaves[k]), 0);
      }
      mine.gatherer.gather(mine.block, mine.votes);
      for (std::size_t k = group.begin; k < group.end; ++k) {
        const std::size_t leaf = leaves[k], point = k - group.begin;
        const Eigen::Vector3d centre = octree.centre_mm(leaf);
        for (std::uint32_t v = 0; v < mine.votes.count[point]; ++v) {
          const std::size_t at = mine.votes.begin[point] + v;
          const Eigen::Vector3f vote(mine.votes.x[at], mine.votes.y[at], mine.votes.z[at]);
          const double off2 = static_cast<double>((vote - field.normal[leaf]).squaredNorm());
          const double weight = std::exp(-0.5 * off2 / (bandwidth_rad * bandwidth_rad));
          if (weight < 0.1) continue;
          const std::size_t index = view_of[mine.votes.observation[at]];
          const View& view = *views[index];
          const Eigen::Vector3d in_camera = view.camera_from_object * centre;
          const CameraModel& camera = observations.rig().cameras[view.camera];
          const auto pixel = camera.project(in_camera);
          if (!pixel) continue;
          body(leaf, claims[index], weight, *pixel, in_camera.norm(),
               edge_mm * camera.fx_px / in_camera.z());
        }
        after(leaf);
      }
    });
  };

  std::vector<std::uint32_t> surface, all;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (field.consistency[i] <= 0) continue;
    all.push_back(static_cast<std::uint32_t>(i));
    if (field.consistency[i] >= static_cast<float>(min_consistency)) surface.push_back(all.back());
  }
  for_votes(
      surface,
      [&](std::size_t leaf, Claims& view, double /*weight*/, const Eigen::Vector2d& pixel,
          double distance_mm,
          double radius_px) { view.claim(pixel, radius_px, distance_mm, field.consistency[leaf]); },
      [](std::size_t) {});

  std::vector<std::uint8_t> is_rival(octree.size(), 0);
  {
    struct Sum {
      double all = 0, lost = 0;
    };
    tbb::enumerable_thread_specific<Sum> sums;
    for_votes(
        all,
        [&](std::size_t leaf, Claims& view, double weight, const Eigen::Vector2d& pixel,
            double distance_mm, double /*radius_px*/) {
          Sum& sum = sums.local();
          sum.all += weight;
          if (view.is_lost(pixel, distance_mm, field.consistency[leaf], kApart * edge_mm)) {
            sum.lost += weight;
          }
        },
        [&](std::size_t leaf) {
          Sum& sum = sums.local();
          is_rival[leaf] = sum.lost >= 0.5 * sum.all ? 1 : 0;
          sum = {};
        });
  }
  if (run.stopped()) return Error{Code::cancelled, "voting was stopped"};
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (is_rival[i] == 0) continue;
    field.no_surface[i] = 1;
    field.normal[i].setZero();
    field.consistency[i] = field.support[i] = 0;
  }
  return {};
}

}  // namespace alhazen
