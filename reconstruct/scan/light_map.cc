#include "reconstruct/scan/light_map.h"

#include <algorithm>

namespace alhazen {
namespace {

/// The smallest box, in pixels of the lists, that holds every label but none; of one pixel where
/// there is no other.
Region labelled(const LightMap& map) {
  const auto is_none = [](Label label) { return label == Label::none; };
  const int width = map.region.width;
  int low_x = width, high_x = -1, low_y = map.region.height, high_y = -1;
  for (int y = 0; y < map.region.height; ++y) {
    const Label* row = map.label.data() + static_cast<std::ptrdiff_t>(y) * width;
    const auto first = static_cast<int>(std::find_if_not(row, row + width, is_none) - row);
    if (first == width) continue;
    int last = width - 1;
    while (is_none(row[last])) --last;
    low_x = std::min(low_x, first);
    high_x = std::max(high_x, last);
    low_y = std::min(low_y, y);
    high_y = y;
  }
  if (high_x < 0) return {0, 0, 1, 1};
  return {low_x, low_y, high_x - low_x + 1, high_y - low_y + 1};
}

}  // namespace

LightMap cropped(const LightMap& map) {
  const Region box = labelled(map);
  LightMap out;
  out.key = map.key;
  out.angle_rad = map.angle_rad;
  out.region = {map.region.x + box.x, map.region.y + box.y, box.width, box.height};
  out.resize_lists();
  const auto copy = [&](const auto& from, auto& to) {
    for (int y = 0; y < box.height; ++y) {
      std::copy_n(from.begin() + static_cast<std::ptrdiff_t>(box.y + y) * map.region.width + box.x,
                  box.width, to.begin() + static_cast<std::ptrdiff_t>(y) * box.width);
    }
  };
  copy(map.u_px, out.u_px);
  copy(map.v_px, out.v_px);
  copy(map.sigma_u_px, out.sigma_u_px);
  copy(map.sigma_v_px, out.sigma_v_px);
  copy(map.contrast, out.contrast);
  copy(map.label, out.label);
  copy(map.bit_u, out.bit_u);
  copy(map.bit_v, out.bit_v);
  return out;
}

}  // namespace alhazen
