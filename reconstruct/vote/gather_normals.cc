// The part of Gatherer that reads normal maps: a vote is what the map says at the point's pixel.
#include <algorithm>
#include <cmath>

#include "reconstruct/vote/gather.h"

namespace alhazen {

bool Gatherer::is_clear_of_object(const PointBlock& block, double radius_mm) const {
  const auto is_clear = [&](const NormalView& seen) {
    const CameraModel& camera = observations_.rig().cameras[seen.view.camera];
    const auto spot = spot_of(camera, seen.view, block.centre_mm_);
    return spot && spot->has_before_it(radius_mm) &&
           seen.clear.holds(static_cast<float>(spot->centre_px.x()),
                            static_cast<float>(spot->centre_px.y()),
                            static_cast<float>(spot->radius_px(radius_mm)));
  };
  return std::any_of(observations_.normal_views().begin(), observations_.normal_views().end(),
                     is_clear);
}

std::uint64_t Gatherer::gather_normals(const PointBlock& block, BlockVotes& votes,
                                       std::size_t& written) {
  const std::size_t count = block.count_;
  std::uint64_t looked_up = 0;
  const auto least2 = static_cast<float>(options_.min_cosine * options_.min_cosine);
  for (std::size_t k = 0; k < observations_.normal_views().size(); ++k) {
    const NormalView& seen = observations_.normal_views()[k];
    const CameraModel& camera = observations_.rig().cameras[seen.view.camera];
    const auto spot = spot_of(camera, seen.view, block.centre_mm_);
    if (!spot || !spot->has_before_it(block.reach_mm_)) continue;
    const PixelRange covered = spot->covered(block.reach_mm_);
    const auto pixels_per_mm = static_cast<float>(spot->pixels_per_mm(block.reach_mm_));
    const bool may_vote = seen.tiles.most(covered) != 0;
    const bool may_carve =
        block.may_be_free() && seen.clear.may_hold(covered, block.least_radius_mm_ * pixels_per_mm);
    if (!may_vote && !may_carve) continue;
    if (!project_block(seen.view, block)) continue;
    if (may_carve) look_for_sight(seen.clear, block, pixels_per_mm, votes);
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
