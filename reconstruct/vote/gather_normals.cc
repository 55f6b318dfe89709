// The part of Gatherer that reads normal maps: a vote is what the map says at the point's pixel.
#include <algorithm>
#include <cmath>
#include <optional>

#include "reconstruct/vote/gather.h"
#include "reconstruct/vote/spot.h"

namespace alhazen {
namespace {

/// Chessboard distance to the nearest pixel that is not background, around a position.
int clear_at(const NormalView& seen, double x_px, double y_px) {
  const double x = x_px - seen.clear_box.x + 0.5, y = y_px - seen.clear_box.y + 0.5;
  if (!(x >= 0 && y >= 0 && x < seen.clear_box.width && y < seen.clear_box.height)) return 0;
  return seen
      .clear_px[static_cast<std::size_t>(y) * static_cast<std::size_t>(seen.clear_box.width) +
                static_cast<std::size_t>(x)];
}

/// Whether a ball of that radius in pixels, seen there, lies on background with all it covers. One
/// pixel is left for rounding and for pixels that the outline cuts.
bool is_clear(const NormalView& seen, double x_px, double y_px, double radius_px) {
  return clear_at(seen, x_px, y_px) > std::ceil(radius_px) + 1;
}

}  // namespace

bool Gatherer::is_clear_of_object(const PointBlock& block, double radius_mm) const {
  return std::any_of(observations_.normal_views().begin(), observations_.normal_views().end(),
                     [&](const NormalView& seen) {
                       const auto spot = spot_of(observations_.rig().cameras[seen.view.camera],
                                                 seen.view, block.centre_mm_, radius_mm);
                       return spot && is_clear(seen, spot->centre_px.x(), spot->centre_px.y(),
                                               spot->radius_px);
                     });
}

std::uint64_t Gatherer::gather_normals(const PointBlock& block, BlockVotes& votes,
                                       std::size_t& written) {
  const std::size_t count = block.count_;
  std::uint64_t looked_up = 0;
  const auto least2 = static_cast<float>(options_.min_cosine * options_.min_cosine);
  for (std::size_t k = 0; k < observations_.normal_views().size(); ++k) {
    const NormalView& seen = observations_.normal_views()[k];
    const CameraModel& camera = observations_.rig().cameras[seen.view.camera];
    const auto spot = spot_of(camera, seen.view, block.centre_mm_, block.reach_mm_);
    if (!spot) continue;
    const Eigen::Vector2d& at = spot->centre_px;
    const double reach = spot->radius_px + 1;
    const bool may_vote =
        seen.may_see(at.x() - reach, at.y() - reach, at.x() + reach, at.y() + reach);
    if (!may_vote && !overlaps(seen.clear_box, *spot)) continue;
    if (!project_block(seen.view, block)) continue;
    for (std::size_t i = 0; i < count; ++i) {
      if (votes.free_space[i] != 0) continue;
      const double radius_px = double{block.radius_mm_[i]} * spot->pixels_per_mm;
      if (is_clear(seen, double{x_px_[i]}, double{y_px_[i]}, radius_px)) votes.free_space[i] = 1;
    }
    if (!may_vote) continue;

    grow_to(point_, written + count + kernels::kPadding);
    for (std::vector<float>* list : {&x_, &y_, &z_}) {
      grow_to(*list, written + count + kernels::kPadding);
    }
    const std::size_t begin = written;
    const Eigen::Vector3f eye = (seen.view.eye_object_mm - block.centre_mm_).cast<float>();
    const auto box_x = static_cast<float>(seen.box.x), box_y = static_cast<float>(seen.box.y);
    const auto end_x = static_cast<float>(seen.box.width - 1);
    const auto end_y = static_cast<float>(seen.box.height - 1);
    const auto width = static_cast<std::size_t>(seen.box.width);
    looked_up += count;
    for (std::size_t i = 0; i < count; ++i) {
      const float x = x_px_[i] - box_x, y = y_px_[i] - box_y;
      if (votes.free_space[i] != 0 || !(x >= 0 && x < end_x && y >= 0 && y < end_y)) continue;
      const auto column = static_cast<std::size_t>(x), row = static_cast<std::size_t>(y);
      const std::size_t cell = row * width + column;
      if (seen.cells[cell] == 0) continue;
      const float fx = x - static_cast<float>(column), fy = y - static_cast<float>(row);
      using Corner = Eigen::Map<const Eigen::Vector3f>;
      const float* const first = seen.normal.data() + 3 * cell;
      const Eigen::Vector3f n =
          (1 - fy) * ((1 - fx) * Corner(first) + fx * Corner(first + 3)) +
          fy * ((1 - fx) * Corner(first + 3 * width) + fx * Corner(first + 3 * width + 3));
      const Eigen::Vector3f v =
          eye - Eigen::Vector3f(block.x_mm_[i], block.y_mm_[i], block.z_mm_[i]);
      const float along = n.dot(v), length2 = n.squaredNorm();
      // A surface that is seen faces its camera.
      if (!(along > 0 && along * along > least2 * length2 * v.squaredNorm())) continue;
      const float scale = 1 / std::sqrt(length2);
      point_[written] = static_cast<std::uint32_t>(i);
      x_[written] = n.x() * scale;
      y_[written] = n.y() * scale;
      z_[written] = n.z() * scale;
      ++written;
    }
    if (written > begin) runs_.push_back({observations_.size() + k, begin, written});
  }
  return looked_up;
}

}  // namespace alhazen
