#include "reconstruct/vote/clearance.h"

#include <algorithm>

#include "reconstruct/scan/region.h"

namespace alhazen {

// Two sweeps (Rosenfeld and Pfaltz, 1966), on a picture with a rim that is not clear.
Clearance::Clearance(const Region& box_px, const std::vector<std::uint8_t>& is_clear)
    : box(box_px), px(pixel_count(box_px)), tiles(box_px) {
  const auto stride = static_cast<std::size_t>(box.width) + 2;
  std::vector<std::uint8_t> far(stride * (static_cast<std::size_t>(box.height) + 2), 0);
  const auto beyond = [](std::uint8_t a, std::uint8_t b, std::uint8_t c, std::uint8_t d) {
    return static_cast<std::uint8_t>(std::min({a, b, c, d, std::uint8_t{254}}) + 1);
  };
  std::size_t pixel = 0;
  for (std::size_t y = 1; y <= static_cast<std::size_t>(box.height); ++y) {
    for (std::size_t at = y * stride + 1; at <= y * stride + stride - 2; ++at) {
      if (is_clear[pixel++] == 0) continue;
      far[at] = beyond(far[at - 1], far[at - stride - 1], far[at - stride], far[at - stride + 1]);
    }
  }
  for (int y = box.height - 1; y >= 0; --y) {
    for (int x = box.width - 1; x >= 0; --x) {
      const std::size_t at =
          (static_cast<std::size_t>(y) + 1) * stride + static_cast<std::size_t>(x) + 1;
      far[at] = std::min(far[at], beyond(far[at + 1], far[at + stride + 1], far[at + stride],
                                         far[at + stride - 1]));
      px[--pixel] = far[at];
      tiles.raise(x, y, far[at]);
    }
  }
}

}  // namespace alhazen
