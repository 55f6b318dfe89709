#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/image.h"
#include "reconstruct/vote/tiles.h"

namespace alhazen {

/// How far each pixel of a box is from the nearest one that is not clear, chessboard steps, at most
/// 255. Beyond the box nothing is known, so nothing is clear.
struct Clearance {
  Region box;
  std::vector<std::uint8_t> px;  ///< row by row
  Tiles tiles;

  Clearance() = default;
  /// `is_clear`: 0 or 1 per pixel of the box, row by row.
  Clearance(const Region& box, const std::vector<std::uint8_t>& is_clear);

  /// Whether a ball of that radius in pixels, seen there, covers clear pixels alone. One pixel is
  /// left for rounding and for pixels that an outline cuts.
  [[nodiscard]] bool holds(float x_px, float y_px, float radius_px) const {
    const float x = x_px - static_cast<float>(box.x) + 0.5F;
    const float y = y_px - static_cast<float>(box.y) + 0.5F;
    if (!(x >= 0 && y >= 0 && x < static_cast<float>(box.width) &&
          y < static_cast<float>(box.height))) {
      return false;
    }
    const std::uint8_t far =
        px[static_cast<std::size_t>(static_cast<int>(y)) * static_cast<std::size_t>(box.width) +
           static_cast<std::size_t>(static_cast<int>(x))];
    return static_cast<float>(far) > std::ceil(radius_px) + 1;
  }
  /// Whether holds() may be true for a point whose nearest pixel is one of these.
  [[nodiscard]] bool may_hold(const PixelRange& range, float radius_px) const {
    return static_cast<float>(tiles.most(range)) > std::ceil(radius_px) + 1;
  }
};

}  // namespace alhazen
