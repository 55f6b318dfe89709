#include "reconstruct/vote/observations.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <tuple>
#include <utility>

#include "reconstruct/scan/region.h"
#include "reconstruct/vote/smooth_positions.h"

namespace alhazen {
namespace {

/// A position this near to the pixel's own line of sight onto the display is that, within what
/// calibration and coding leave uncertain: half a millimetre to a millimetre on the display.
constexpr float kSightPx = 3;
/// Votes name their map in 16 bits.
constexpr std::size_t kMostMaps = 65535;

template <class Devices>
std::size_t index_of(const Devices& devices, const std::string& name) {
  const auto found = std::find_if(devices.begin(), devices.end(),
                                  [&](const auto& device) { return device.name == name; });
  return static_cast<std::size_t>(found - devices.begin());
}

/// Where each pixel of the region would see the display itself, were nothing between: on a grid of
/// every kStepPx-th pixel, linear between, which lens distortion leaves exact to far less than
/// a display pixel. NaN where it would not.
class DirectSight {
 public:
  DirectSight(const CameraModel& camera, const DisplayModel& display, const Pose& camera_from_mount,
              const Region& region)
      : columns_((region.width + kStepPx - 1) / kStepPx + 1) {
    const Pose mount_from_camera = camera_from_mount.inverse();
    const Eigen::Vector3d eye = mount_from_camera.translation_mm;
    const Eigen::Vector3d inward = display.inward();
    const double away_mm = (display.origin_mm - eye).dot(inward);
    const int rows = (region.height + kStepPx - 1) / kStepPx + 1;
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns_; ++column) {
        const Eigen::Vector3d direction =
            mount_from_camera.rotation *
            camera.direction(
                Eigen::Vector2d(region.x + column * kStepPx, region.y + row * kStepPx));
        const double fall = direction.dot(inward);
        Eigen::Vector2f uv = Eigen::Vector2f::Constant(std::numeric_limits<float>::quiet_NaN());
        if (away_mm > 0 && fall > 1e-3) {
          const Eigen::Vector3d q = eye + direction * (away_mm / fall) - display.origin_mm;
          uv = {static_cast<float>(q.dot(display.u_mm) / display.u_mm.squaredNorm()),
                static_cast<float>(q.dot(display.v_mm) / display.v_mm.squaredNorm())};
        }
        uv_px_.push_back(uv);
      }
    }
  }

  [[nodiscard]] Eigen::Vector2f at(int x, int y) const {
    const auto corner = static_cast<std::size_t>(y / kStepPx) * static_cast<std::size_t>(columns_) +
                        static_cast<std::size_t>(x / kStepPx);
    const auto next = corner + static_cast<std::size_t>(columns_);
    const float fx = static_cast<float>(x % kStepPx) / kStepPx;
    const float fy = static_cast<float>(y % kStepPx) / kStepPx;
    return (1 - fy) * ((1 - fx) * uv_px_[corner] + fx * uv_px_[corner + 1]) +
           fy * ((1 - fx) * uv_px_[next] + fx * uv_px_[next + 1]);
  }

 private:
  static constexpr int kStepPx = 16;
  int columns_;
  std::vector<Eigen::Vector2f> uv_px_;
};

/// The smallest box around all pixels of the map's region with that label; empty without any.
Region box_of(const LightMap& map, const std::vector<Label>& labels, Label label) {
  int low_x = map.region.width, high_x = -1, low_y = map.region.height, high_y = -1;
  for (int y = 0; y < map.region.height; ++y) {
    const Label* row = labels.data() + static_cast<std::ptrdiff_t>(y) * map.region.width;
    int first = 0, last = map.region.width - 1;
    while (first <= last && row[first] != label) ++first;
    if (first > last) continue;
    while (row[last] != label) --last;
    low_x = std::min(low_x, first);
    high_x = std::max(high_x, last);
    low_y = std::min(low_y, y);
    high_y = y;
  }
  if (high_x < 0) return {};
  return {low_x, low_y, high_x - low_x + 1, high_y - low_y + 1};
}

/// Median over the mirror pixels in `box`; every 7th will do. Counted from the box, so that it does
/// not matter how much around it was kept.
float median_sigma(const LightMap& map, const PixelList<Imath::half>& sigma_px,
                   const std::vector<Label>& labels, const Region& box) {
  std::vector<float> list;
  for (std::size_t k = 0; k < pixel_count(box); k += 7) {
    const int x = box.x + static_cast<int>(k % static_cast<std::size_t>(box.width));
    const int y = box.y + static_cast<int>(k / static_cast<std::size_t>(box.width));
    const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(map.region.width) +
                   static_cast<std::size_t>(x);
    const float sigma = sigma_px[i];
    if (labels[i] == Label::mirror && std::isfinite(sigma)) list.push_back(sigma);
  }
  if (list.empty()) return 0;
  const auto middle = list.begin() + static_cast<std::ptrdiff_t>(list.size() / 2);
  std::nth_element(list.begin(), middle, list.end());
  return *middle;
}

/// Puts an observation where the rig has its camera and display. REQUIRES: the rig has both.
void place(const Rig& rig, Observation& seen) {
  seen.camera = index_of(rig.cameras, seen.key.camera);
  const DisplayModel& display = rig.displays[index_of(rig.displays, seen.key.display)];
  if (display.mount == Mount::rig) {
    const Pose object_from_rig = rig.turntable.rig_from_object(seen.angle_rad).inverse();
    seen.origin_object_mm = object_from_rig * display.origin_mm;
    seen.u_object_mm = object_from_rig.rotation * display.u_mm;
    seen.v_object_mm = object_from_rig.rotation * display.v_mm;
  } else {
    seen.origin_object_mm = display.origin_mm;
    seen.u_object_mm = display.u_mm;
    seen.v_object_mm = display.v_mm;
  }
  seen.inward_object = seen.u_object_mm.cross(seen.v_object_mm).normalized();
}

}  // namespace

std::size_t Observation::bytes() const noexcept {
  return uv_px.size() * sizeof(float) + (row_pair.size() + cells.size()) * sizeof(std::uint32_t) +
         tiles.bytes() + sight.px.size() + sight.tiles.bytes() + sizeof(Observation);
}

namespace {

/// Fills the lists of positions from those of the whole box: what the cells use of each row.
void keep_rows(const Positions& positions, Observation& seen) {
  const auto is_cell = [&](int x, int y) {
    const auto cell = static_cast<std::size_t>(y) * static_cast<std::size_t>(seen.box.width) +
                      static_cast<std::size_t>(x);
    return (seen.cells[cell / 32] >> (cell % 32) & 1U) != 0;
  };
  // A cell uses its row and the next.
  std::vector<std::pair<int, int>> used(static_cast<std::size_t>(seen.box.height),
                                        {seen.box.width, 0});
  std::size_t pairs = 0;
  for (int y = 0; y < seen.box.height; ++y) {
    auto& [begin, end] = used[static_cast<std::size_t>(y)];
    for (int x = 0; y + 1 < seen.box.height && x + 1 < seen.box.width; ++x) {
      if (!is_cell(x, y)) continue;
      begin = std::min(begin, x);
      end = std::max(end, x + 2);
      auto& [next_begin, next_end] = used[static_cast<std::size_t>(y) + 1];
      next_begin = std::min(next_begin, x);
      next_end = std::max(next_end, x + 2);
    }
    pairs += static_cast<std::size_t>(std::max(0, end - begin));
  }
  seen.uv_px.reserve(2 * pairs);
  seen.row_pair.reserve(used.size());
  for (int y = 0; y < seen.box.height; ++y) {
    const auto [begin, end] = used[static_cast<std::size_t>(y)];
    seen.row_pair.push_back(static_cast<std::int32_t>(seen.uv_px.size() / 2) - begin);
    if (begin >= end) continue;
    const auto row = positions.uv_px.begin() + 2 * static_cast<std::ptrdiff_t>(y) *
                                                   static_cast<std::ptrdiff_t>(seen.box.width);
    seen.uv_px.insert(seen.uv_px.end(), row + 2 * begin, row + 2 * end);
  }
}

}  // namespace

Observations::Observations(Rig rig, const VoteOptions& options,
                           const Eigen::Vector3d& centre_object_mm)
    : rig_(std::move(rig)), options_(options), centre_object_mm_(centre_object_mm) {}

Status Observations::add(const LightMap& map) {
  const std::string name = "light map of stop " + std::to_string(map.key.stop) + ", display " +
                           map.key.display + ", camera " + map.key.camera;
  const auto invalid = [&](const std::string& what) {
    return Error{Code::invalid, name + ": " + what};
  };
  const std::size_t camera_index = index_of(rig_.cameras, map.key.camera);
  const std::size_t display_index = index_of(rig_.displays, map.key.display);
  if (camera_index == rig_.cameras.size()) return invalid("the rig has no such camera");
  if (display_index == rig_.displays.size()) return invalid("the rig has no such display");
  const CameraModel& camera = rig_.cameras[camera_index];
  const DisplayModel& display = rig_.displays[display_index];
  const Region& region = map.region;
  if (region.x < 0 || region.y < 0 || region.width < 1 || region.height < 1 ||
      region.width > camera.width_px - region.x || region.height > camera.height_px - region.y) {
    return invalid("its region " + std::to_string(region.width) + " x " +
                   std::to_string(region.height) + " px at (" + std::to_string(region.x) + ", " +
                   std::to_string(region.y) + ") is not within the sensor of " +
                   std::to_string(camera.width_px) + " x " + std::to_string(camera.height_px) +
                   " px");
  }
  const std::size_t count = map.size_px();
  if (map.label.size() != count || map.u_px.size() != count || map.v_px.size() != count) {
    return invalid("its lists hold " + std::to_string(map.label.size()) + ", " +
                   std::to_string(map.u_px.size()) + " and " + std::to_string(map.v_px.size()) +
                   " pixels, its region " + std::to_string(count));
  }
  if (!std::isfinite(map.angle_rad)) return invalid("its angle is not finite");
  for (std::size_t i = 0; i < count; ++i) {
    if (!map.is_position(i)) continue;
    // Half a pixel beyond the display's edge is still its light; a pixel more is rounding.
    if (!(map.u_px[i] >= -2 && map.u_px[i] <= static_cast<float>(display.width_px) + 1 &&
          map.v_px[i] >= -2 && map.v_px[i] <= static_cast<float>(display.height_px) + 1)) {
      return invalid("pixel " + std::to_string(i) + " has position (" +
                     std::to_string(map.u_px[i]) + ", " + std::to_string(map.v_px[i]) +
                     "), not on the display of " + std::to_string(display.width_px) + " x " +
                     std::to_string(display.height_px) + " px: is it the rig of this scan, " +
                     "and are no displays exchanged?");
    }
  }

  Observation seen;
  seen.key = map.key;
  seen.angle_rad = map.angle_rad;
  place(rig_, seen);

  // A position that is the pixel's own line of sight onto the display is no reflection.
  std::vector<Label> labels(map.label.begin(), map.label.end());
  const Pose camera_from_mount =
      display.mount == Mount::rig
          ? camera.camera_from_rig
          : camera.camera_from_rig * rig_.turntable.rig_from_object(map.angle_rad);
  const DirectSight direct(camera, display, camera_from_mount, region);
  const bool has_sigma = map.sigma_u_px.size() == count && map.sigma_v_px.size() == count;
  for (int y = 0; y < region.height; ++y) {
    for (int x = 0; x < region.width; ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(region.width) +
                     static_cast<std::size_t>(x);
      if (labels[i] != Label::mirror) continue;
      const Eigen::Vector2f uv = direct.at(x, y);
      const auto near = [&](float position, float sight, float sigma) {
        return std::abs(position - sight) <= std::max(kSightPx, 3 * sigma);
      };
      if (near(map.u_px[i], uv.x(), has_sigma ? float{map.sigma_u_px[i]} : 0) &&
          near(map.v_px[i], uv.y(), has_sigma ? float{map.sigma_v_px[i]} : 0)) {
        labels[i] = Label::direct_sight;
      }
    }
  }

  const Region box = box_of(map, labels, Label::mirror);
  if (pixel_count(box) > 0) {
    seen.box = {region.x + box.x, region.y + box.y, box.width, box.height};
    Positions positions{box.width, box.height, {}, {}};
    positions.uv_px.resize(2 * pixel_count(box));
    positions.is_valid.resize(pixel_count(box));
    const auto source = [&](int x, int y) {
      return static_cast<std::size_t>(box.y + y) * static_cast<std::size_t>(region.width) +
             static_cast<std::size_t>(box.x + x);
    };
    const auto target = [&](int x, int y) {
      return static_cast<std::size_t>(y) * static_cast<std::size_t>(box.width) +
             static_cast<std::size_t>(x);
    };
    for (int y = 0; y < box.height; ++y) {
      for (int x = 0; x < box.width; ++x) {
        const std::size_t from = source(x, y), to = target(x, y);
        const bool is_mirror = labels[from] == Label::mirror;
        positions.is_valid[to] = is_mirror ? 1 : 0;
        positions.uv_px[2 * to] = is_mirror ? map.u_px[from] : 0;
        positions.uv_px[2 * to + 1] = is_mirror ? map.v_px[from] : 0;
      }
    }
    const double away_mm = (seen.origin_object_mm + seen.u_object_mm * (display.width_px / 2.0) +
                            seen.v_object_mm * (display.height_px / 2.0) - centre_object_mm_)
                               .norm();
    const auto jump_u_px =
        static_cast<float>(options_.jump_rad * away_mm / seen.u_object_mm.norm());
    const auto jump_v_px =
        static_cast<float>(options_.jump_rad * away_mm / seen.v_object_mm.norm());
    if (has_sigma) {
      positions.sigma_u_px = median_sigma(map, map.sigma_u_px, labels, box);
      positions.sigma_v_px = median_sigma(map, map.sigma_v_px, labels, box);
    }
    smooth_positions(positions, jump_u_px, jump_v_px);
    // A display error e seen from D away tilts the hypothesis by e / 2D. As large as before it was
    // averaged: errors of coarse codes and of the calibration go together over many pixels.
    seen.noise_rad = static_cast<float>(std::hypot(positions.sigma_u_px * seen.u_object_mm.norm(),
                                                   positions.sigma_v_px * seen.v_object_mm.norm()) /
                                        (2 * std::sqrt(2.0) * away_mm));
    seen.cells.assign((pixel_count(box) + 31) / 32, 0);
    seen.tiles = Tiles(seen.box);
    const auto is_smooth = [&](const std::size_t(&corner)[4], std::size_t axis, float bound) {
      float low = positions.uv_px[2 * corner[0] + axis], high = low;
      for (const std::size_t c : corner) {
        low = std::min(low, positions.uv_px[2 * c + axis]);
        high = std::max(high, positions.uv_px[2 * c + axis]);
      }
      return high - low <= bound;
    };
    for (int y = 0; y + 1 < box.height; ++y) {
      for (int x = 0; x + 1 < box.width; ++x) {
        const std::size_t corner[4] = {target(x, y), target(x + 1, y), target(x, y + 1),
                                       target(x + 1, y + 1)};
        if (std::any_of(std::begin(corner), std::end(corner),
                        [&](std::size_t c) { return positions.is_valid[c] == 0; })) {
          continue;
        }
        if (!is_smooth(corner, 0, jump_u_px) || !is_smooth(corner, 1, jump_v_px)) continue;
        seen.cells[corner[0] / 32] |= 1u << (corner[0] % 32);
        seen.tiles.raise(x, y, 1);
      }
    }
    keep_rows(positions, seen);
  }
  const Region sight = box_of(map, labels, Label::direct_sight);
  if (pixel_count(sight) > 0) {
    std::vector<std::uint8_t> is_sight;
    is_sight.reserve(pixel_count(sight));
    for (int y = sight.y; y < sight.y + sight.height; ++y) {
      const Label* row = labels.data() + static_cast<std::ptrdiff_t>(y) * region.width;
      for (int x = sight.x; x < sight.x + sight.width; ++x)
        is_sight.push_back(row[x] == Label::direct_sight ? 1 : 0);
    }
    seen.sight =
        Clearance({region.x + sight.x, region.y + sight.y, sight.width, sight.height}, is_sight);
  }

  if (map_count() >= kMostMaps) {
    return Error{Code::exhausted, name + ": a scan has at most 65535 maps"};
  }
  const auto order = [](const Observation& o) {
    return std::tie(o.key.stop, o.key.camera, o.angle_rad, o.key.display);
  };
  if (std::any_of(observations_.begin(), observations_.end(),
                  [&](const Observation& o) { return o.key == map.key; })) {
    return Error{Code::conflict, name + ": came before"};
  }
  const auto at = std::lower_bound(
      observations_.begin(), observations_.end(), seen,
      [&](const Observation& a, const Observation& b) { return order(a) < order(b); });
  observations_.insert(at, std::move(seen));
  make_views();
  return {};
}

Status Observations::assume(Rig rig) {
  for (const Observation& seen : observations_) {
    const CameraModel* camera = rig.camera(seen.key.camera);
    const bool has_both = camera != nullptr && rig.display(seen.key.display) != nullptr;
    const auto is_within = [](const Region& box, const CameraModel& of) {
      return box.x + box.width <= of.width_px && box.y + box.height <= of.height_px;
    };
    if (!has_both || !is_within(seen.box, *camera) || !is_within(seen.sight.box, *camera)) {
      return Error{Code::invalid, "the light map of display " + seen.key.display + ", camera " +
                                      seen.key.camera + " does not fit the rig"};
    }
  }
  rig_ = std::move(rig);
  for (Observation& seen : observations_) place(rig_, seen);
  make_views();
  return {};
}

void Observations::make_views() {
  views_.clear();
  for (std::size_t i = 0; i < observations_.size(); ++i) {
    const Observation& o = observations_[i];
    if (i > 0) {
      const Observation& last = observations_[i - 1];
      if (std::tie(o.key.stop, o.key.camera, o.angle_rad) ==
          std::tie(last.key.stop, last.key.camera, last.angle_rad)) {
        views_.back().end = i + 1;
        continue;
      }
    }
    View view;
    view.camera = o.camera;
    view.camera_from_object =
        rig_.cameras[o.camera].camera_from_rig * rig_.turntable.rig_from_object(o.angle_rad);
    view.eye_object_mm = view.camera_from_object.inverse().translation_mm;
    view.begin = i;
    view.end = i + 1;
    views_.push_back(view);
  }
}

Status Observations::add(const NormalMap& map) {
  NormalView seen = ALHAZEN_TRY(make_normal_view(map, rig_, options_));
  const std::string name =
      "normal map of stop " + std::to_string(map.key.stop) + ", camera " + map.key.camera;
  if (map_count() >= kMostMaps) {
    return Error{Code::exhausted, name + ": a scan has at most 65535 maps"};
  }
  const auto place =
      std::lower_bound(normal_views_.begin(), normal_views_.end(), seen,
                       [](const NormalView& a, const NormalView& b) { return a.key < b.key; });
  if (place != normal_views_.end() && place->key == seen.key) {
    return Error{Code::conflict, name + ": came before"};
  }
  normal_views_.insert(place, std::move(seen));
  return {};
}

std::size_t Observations::bytes() const noexcept {
  std::size_t sum = 0;
  for (const Observation& o : observations_) sum += o.bytes();
  for (const NormalView& seen : normal_views_) sum += seen.bytes();
  return sum;
}

}  // namespace alhazen
