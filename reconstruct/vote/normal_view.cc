#include "reconstruct/vote/normal_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include "reconstruct/scan/region.h"

namespace alhazen {
namespace {

/// The smallest box, in pixels of the map's region, around all that have a normal.
Region box_of(const NormalMap& map) {
  int low_x = map.region.width, high_x = -1, low_y = map.region.height, high_y = -1;
  for (int y = 0; y < map.region.height; ++y) {
    const NormalLabel* row = map.label.data() + static_cast<std::ptrdiff_t>(y) * map.region.width;
    for (int x = 0; x < map.region.width; ++x) {
      if (row[x] != NormalLabel::object) continue;
      low_x = std::min(low_x, x);
      high_x = std::max(high_x, x);
      low_y = std::min(low_y, y);
      high_y = y;
    }
  }
  if (high_x < 0) return {};
  return {low_x, low_y, high_x - low_x + 1, high_y - low_y + 1};
}

}  // namespace

std::size_t NormalView::bytes() const noexcept {
  return normal.size() * sizeof(float) + cells.size() + tiles.bytes() + clear.px.size() +
         clear.tiles.bytes() + sizeof(NormalView);
}

Result<NormalView> make_normal_view(const NormalMap& map, const Rig& rig,
                                    const VoteOptions& options) {
  const std::string name =
      "normal map of stop " + std::to_string(map.key.stop) + ", camera " + map.key.camera;
  const auto invalid = [&](const std::string& what) {
    return Error{Code::invalid, name + ": " + what};
  };
  const CameraModel* camera = rig.camera(map.key.camera);
  if (camera == nullptr) return invalid("the rig has no such camera");
  const Region& region = map.region;
  if (region.x < 0 || region.y < 0 || region.width < 1 || region.height < 1 ||
      region.width > camera->width_px - region.x || region.height > camera->height_px - region.y) {
    return invalid("its region " + std::to_string(region.width) + " x " +
                   std::to_string(region.height) + " px at (" + std::to_string(region.x) + ", " +
                   std::to_string(region.y) + ") is not within the sensor of " +
                   std::to_string(camera->width_px) + " x " + std::to_string(camera->height_px) +
                   " px");
  }
  if (map.normal.size() != map.size_px() || map.label.size() != map.size_px()) {
    return invalid("its lists hold " + std::to_string(map.normal.size()) + " and " +
                   std::to_string(map.label.size()) + " pixels, its region " +
                   std::to_string(map.size_px()));
  }
  if (!std::isfinite(map.angle_rad)) return invalid("its angle is not finite");
  if (!(map.noise_rad >= 0 && map.noise_rad <= 1)) {
    return invalid("its noise is " + std::to_string(map.noise_rad) + " rad, allowed 0 to 1");
  }
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    if (map.label[i] == NormalLabel::object && !(std::abs(map.normal[i].norm() - 1) < 1e-3F)) {
      return invalid("the normal of pixel " + std::to_string(i) + " is no unit vector");
    }
  }

  NormalView seen;
  seen.key = map.key;
  seen.angle_rad = map.angle_rad;
  seen.noise_rad = static_cast<float>(map.noise_rad);
  seen.view.camera = static_cast<std::size_t>(camera - rig.cameras.data());
  seen.view.camera_from_object =
      camera->camera_from_rig * rig.turntable.rig_from_object(map.angle_rad);
  const Pose object_from_camera = seen.view.camera_from_object.inverse();
  seen.view.eye_object_mm = object_from_camera.translation_mm;
  std::vector<std::uint8_t> is_background;
  is_background.reserve(map.size_px());
  for (const NormalLabel label : map.label)
    is_background.push_back(label == NormalLabel::background ? 1 : 0);
  seen.clear = Clearance(region, is_background);

  const Region box = box_of(map);
  if (pixel_count(box) == 0) return seen;
  seen.box = {region.x + box.x, region.y + box.y, box.width, box.height};
  const auto source = [&](int x, int y) {
    return static_cast<std::size_t>(box.y + y) * static_cast<std::size_t>(region.width) +
           static_cast<std::size_t>(box.x + x);
  };
  const auto target = [&](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(box.width) +
           static_cast<std::size_t>(x);
  };
  seen.normal.resize(3 * pixel_count(box));
  seen.cells.assign(pixel_count(box), 0);
  seen.tiles = Tiles(seen.box);
  const Eigen::Matrix3f turn = object_from_camera.rotation.cast<float>();
  for (int y = 0; y < box.height; ++y) {
    for (int x = 0; x < box.width; ++x) {
      const Eigen::Vector3f n = turn * map.normal[source(x, y)];
      std::copy_n(n.data(), 3, seen.normal.data() + 3 * target(x, y));
    }
  }
  const auto least_dot = static_cast<float>(std::cos(options.normal_jump_rad));
  for (int y = 0; y + 1 < box.height; ++y) {
    for (int x = 0; x + 1 < box.width; ++x) {
      const std::array<std::size_t, 4> corner{source(x, y), source(x + 1, y), source(x, y + 1),
                                              source(x + 1, y + 1)};
      bool is_whole = true;
      for (std::size_t k = 0; k < corner.size() && is_whole; ++k) {
        is_whole = map.label[corner[k]] == NormalLabel::object;
        for (std::size_t j = 0; j < k && is_whole; ++j) {
          is_whole = map.normal[corner[k]].dot(map.normal[corner[j]]) >= least_dot;
        }
      }
      if (!is_whole) continue;
      seen.cells[target(x, y)] = 1;
      seen.tiles.raise(x, y, 1);
    }
  }
  return seen;
}

}  // namespace alhazen
