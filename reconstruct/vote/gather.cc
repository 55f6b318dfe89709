#include "reconstruct/vote/gather.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "alhazen/check.h"

namespace alhazen {
namespace {

using kernels::kPadding;

/// Whether the point lies on the lit side of the display, `margin_mm` away from its plane.
bool is_before(const Observation& seen, const Eigen::Vector3d& p_mm, double margin_mm) {
  return (seen.origin_object_mm - p_mm).dot(seen.inward_object) > margin_mm;
}

}  // namespace

void PointBlock::reset(const Eigen::Vector3d& centre_mm, double reach_mm) {
  centre_mm_ = centre_mm;
  reach_mm_ = reach_mm;
  count_ = 0;
  least_radius_mm_ = std::numeric_limits<float>::infinity();
}

void PointBlock::add(const Eigen::Vector3d& p_object_mm, double radius_mm) {
  const std::size_t needed = count_ + 1 + kPadding;
  if (x_mm_.size() < needed) {
    for (std::vector<float>* list : {&x_mm_, &y_mm_, &z_mm_, &radius_mm_}) list->resize(2 * needed);
  }
  const Eigen::Vector3d offset = p_object_mm - centre_mm_;
  x_mm_[count_] = static_cast<float>(offset.x());
  y_mm_[count_] = static_cast<float>(offset.y());
  z_mm_[count_] = static_cast<float>(offset.z());
  radius_mm_[count_] = static_cast<float>(radius_mm);
  least_radius_mm_ = std::min(least_radius_mm_, radius_mm_[count_]);
  ++count_;
}

double Gatherer::max_reach_mm(const Observations& observations, const Eigen::Vector3d& centre_mm) {
  constexpr double kErrorPx = 1e-3;
  double reach = std::numeric_limits<double>::infinity();
  const auto limit = [&](const View& view) {
    const CameraModel& camera = observations.rig().cameras[view.camera];
    const double away = (view.eye_object_mm - centre_mm).norm();
    reach = std::min(reach, std::cbrt(kErrorPx * away * away * away / camera.fx_px));
  };
  for (const View& view : observations.views()) limit(view);
  for (const NormalView& seen : observations.normal_views()) limit(seen.view);
  return reach;
}

bool Gatherer::project_block(const View& view, const PointBlock& block) {
  const CameraModel& camera = observations_.rig().cameras[view.camera];
  const double step = std::max(block.reach_mm_ / std::sqrt(3.0), 1e-3);
  std::array<Eigen::Vector2d, 10> sample;
  // Order: centre; +x −x +y −y +z −z; xy xz yz.
  constexpr double kAt[10][3] = {{0, 0, 0}, {1, 0, 0},  {-1, 0, 0}, {0, 1, 0}, {0, -1, 0},
                                 {0, 0, 1}, {0, 0, -1}, {1, 1, 0},  {1, 0, 1}, {0, 1, 1}};
  const Eigen::Vector3d centre = view.camera_from_object * block.centre_mm_;
  for (std::size_t i = 0; i < sample.size(); ++i) {
    const Eigen::Vector3d offset = step * Eigen::Vector3d(kAt[i][0], kAt[i][1], kAt[i][2]);
    const auto pixel = camera.project(centre + view.camera_from_object.rotation * offset);
    if (!pixel) return false;
    sample[i] = *pixel;
  }
  kernels::LocalProjection projection;
  for (int axis = 0; axis < 2; ++axis) {
    const auto at = [&](std::size_t i) { return sample[i][axis]; };
    float* const c = axis == 0 ? projection.x_px : projection.y_px;
    std::array<double, 10> term{};
    term[0] = at(0);
    for (std::size_t k = 0; k < 3; ++k) {
      term[1 + k] = (at(1 + 2 * k) - at(2 + 2 * k)) / (2 * step);
      term[4 + k] = (at(1 + 2 * k) + at(2 + 2 * k) - 2 * at(0)) / (2 * step * step);
    }
    constexpr std::size_t kPair[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [i, j] = kPair[k];
      term[7 + k] = (at(7 + k) - at(0) - step * (term[1 + i] + term[1 + j]) -
                     step * step * (term[4 + i] + term[4 + j])) /
                    (step * step);
    }
    for (std::size_t k = 0; k < 10; ++k) c[k] = static_cast<float>(term[k]);
  }
  kernels::project(projection, block.x_mm_.data(), block.y_mm_.data(), block.z_mm_.data(),
                   block.count_, x_px_.data(), y_px_.data());
  return true;
}

bool Gatherer::is_free(const PointBlock& block) const {
  // A block that a camera looks through as a whole needs no closer look.
  float ball = 0;
  for (std::size_t i = 0; i < block.count_; ++i) ball = std::max(ball, block.radius_mm_[i]);
  const double radius = block.reach_mm_ + ball;
  for (std::size_t v = 0; v < spots_.size(); ++v) {
    const auto& spot = spots_[v];
    if (!spot || !spot->has_before_it(radius)) continue;
    const View& view = observations_.views()[v];
    const auto radius_px = static_cast<float>(spot->radius_px(radius));
    for (std::size_t i = view.begin; i < view.end; ++i) {
      const Observation& seen = observations_.all()[i];
      if (!seen.sight.px.empty() &&
          seen.sight.holds(static_cast<float>(spot->centre_px.x()),
                           static_cast<float>(spot->centre_px.y()), radius_px) &&
          is_before(seen, block.centre_mm_, radius)) {
        return true;
      }
    }
  }
  return is_clear_of_object(block, radius);
}

void Gatherer::look_for_sight(const Clearance& sight, const PointBlock& block, float pixels_per_mm,
                              BlockVotes& votes) const {
  for (std::size_t i = 0; i < block.count_; ++i) {
    if (votes.free_space[i] == 0 &&
        sight.holds(x_px_[i], y_px_[i], block.radius_mm_[i] * pixels_per_mm)) {
      votes.free_space[i] = 1;
    }
  }
}

std::uint64_t Gatherer::gather(const PointBlock& block, BlockVotes& votes,
                               const std::vector<std::uint8_t>* is_asked) {
  const std::size_t count = block.count_;
  ALHAZEN_CHECK(is_asked == nullptr || is_asked->size() == observations_.size());
  const auto is_any_asked = [&](const View& view) {
    const auto at = [&](std::size_t i) {
      return is_asked->begin() + static_cast<std::ptrdiff_t>(i);
    };
    return is_asked == nullptr || std::find(at(view.begin), at(view.end), 1) != at(view.end);
  };
  votes.begin.assign(count, 0);
  votes.count.assign(count, 0);
  votes.free_space.assign(count, 0);
  if (count == 0) return 0;
  spots_.clear();
  for (const View& view : observations_.views()) {
    const CameraModel& camera = observations_.rig().cameras[view.camera];
    spots_.push_back(is_any_asked(view) ? spot_of(camera, view, block.centre_mm_) : std::nullopt);
  }
  if (block.may_be_free() && is_free(block)) {
    votes.free_space.assign(count, 1);
    return 0;
  }
  grow_to(x_px_, count + kPadding);
  grow_to(y_px_, count + kPadding);
  grow_to(scratch_, 3 * (count + kPadding));
  runs_.clear();
  std::size_t written = 0;
  std::uint64_t looked_up = 0;
  for (std::size_t v = 0; v < spots_.size(); ++v) {
    const auto& spot = spots_[v];
    if (!spot || !spot->has_before_it(block.reach_mm_)) continue;
    const View& view = observations_.views()[v];
    const PixelRange covered = spot->covered(block.reach_mm_);
    const auto pixels_per_mm = static_cast<float>(spot->pixels_per_mm(block.reach_mm_));
    bool is_projected = false;
    for (std::size_t i = view.begin; i < view.end; ++i) {
      if (is_asked != nullptr && (*is_asked)[i] == 0) continue;
      const Observation& seen = observations_.all()[i];
      const bool may_vote = !seen.cells.empty() && seen.tiles.most(covered) != 0 &&
                            is_before(seen, block.centre_mm_, block.reach_mm_);
      const bool may_carve = block.may_be_free() && !seen.sight.px.empty() &&
                             seen.sight.may_hold(covered, block.least_radius_mm_ * pixels_per_mm) &&
                             is_before(seen, block.centre_mm_, block.reach_mm_);
      if (!may_vote && !may_carve) continue;
      if (!is_projected) {
        if (!project_block(view, block)) break;
        is_projected = true;
      }
      if (may_carve) look_for_sight(seen.sight, block, pixels_per_mm, votes);
      if (!may_vote) continue;
      grow_to(point_, written + count + kPadding);
      grow_to(x_, written + count + kPadding);
      grow_to(y_, written + count + kPadding);
      grow_to(z_, written + count + kPadding);
      kernels::MapView map;
      map.uv_px = seen.uv_px.data();
      map.row_pair = seen.row_pair.data();
      map.cells = seen.cells.data();
      map.box_x = static_cast<float>(seen.box.x);
      map.box_y = static_cast<float>(seen.box.y);
      map.width = seen.box.width;
      map.height = seen.box.height;
      map.min_cosine = static_cast<float>(options_.min_cosine);
      const Eigen::Vector3f origin = (seen.origin_object_mm - block.centre_mm_).cast<float>();
      const Eigen::Vector3f eye = (view.eye_object_mm - block.centre_mm_).cast<float>();
      for (int axis = 0; axis < 3; ++axis) {
        map.origin_mm[axis] = origin[axis];
        map.u_mm[axis] = static_cast<float>(seen.u_object_mm[axis]);
        map.v_mm[axis] = static_cast<float>(seen.v_object_mm[axis]);
        map.eye_mm[axis] = eye[axis];
      }
      const std::size_t found = kernels::look_up(
          map, block.x_mm_.data(), block.y_mm_.data(), block.z_mm_.data(), x_px_.data(),
          y_px_.data(), count, scratch_.data(),
          {point_.data() + written, x_.data() + written, y_.data() + written, z_.data() + written});
      looked_up += count;
      if (found > 0) runs_.push_back({i, written, written + found});
      written += found;
    }
  }
  looked_up += gather_normals(block, votes, written);

  // By point instead of by observation: a stable counting sort.
  for (std::size_t k = 0; k < written; ++k) ++votes.count[point_[k]];
  std::uint32_t total = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (votes.free_space[i] != 0) votes.count[i] = 0;
    votes.begin[i] = total;
    if (votes.count[i] > 0) total += votes.count[i] + static_cast<std::uint32_t>(kPadding);
    votes.count[i] = 0;
  }
  grow_to(votes.x, total);
  grow_to(votes.y, total);
  grow_to(votes.z, total);
  grow_to(votes.observation, total);
  for (const Run& run : runs_) {
    for (std::size_t k = run.begin; k < run.end; ++k) {
      const std::uint32_t point = point_[k];
      if (votes.free_space[point] != 0) continue;
      const std::uint32_t to = votes.begin[point] + votes.count[point]++;
      votes.x[to] = x_[k];
      votes.y[to] = y_[k];
      votes.z[to] = z_[k];
      votes.observation[to] = static_cast<std::uint16_t>(run.observation);
    }
  }
  return looked_up;
}

}  // namespace alhazen
