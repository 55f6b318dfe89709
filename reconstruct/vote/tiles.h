#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/image.h"

namespace alhazen {

/// The largest byte in each square tile of a box of sensor pixels: spares the look at a rectangle
/// in which nothing is large enough.
class Tiles {
 public:
  static constexpr int kSide_px = 16;

  Tiles() = default;
  /// All zero.
  explicit Tiles(const Region& box)
      : box_(box),
        columns_((box.width + kSide_px - 1) / kSide_px),
        most_(static_cast<std::size_t>(columns_) *
              static_cast<std::size_t>((box.height + kSide_px - 1) / kSide_px)) {}

  /// Pixel (x, y), counted from the first of the box, holds `value`.
  void raise(int x, int y, std::uint8_t value) {
    std::uint8_t& most = most_[tile(x / kSide_px, y / kSide_px)];
    most = std::max(most, value);
  }
  /// No pixel within [x0, x1] × [y0, y1] (sensor pixels, in the box or not) holds more.
  [[nodiscard]] std::uint8_t most(double x0, double y0, double x1, double y1) const {
    const double low_x = std::max(x0 - box_.x, 0.0),
                 high_x = std::min(x1 - box_.x, box_.width - 1.0);
    const double low_y = std::max(y0 - box_.y, 0.0),
                 high_y = std::min(y1 - box_.y, box_.height - 1.0);
    if (!(low_x <= high_x && low_y <= high_y)) return 0;
    const int last_x = static_cast<int>(high_x) / kSide_px;
    const int last_y = static_cast<int>(high_y) / kSide_px;
    std::uint8_t most = 0;
    for (int y = static_cast<int>(low_y) / kSide_px; y <= last_y; ++y) {
      for (int x = static_cast<int>(low_x) / kSide_px; x <= last_x; ++x)
        most = std::max(most, most_[tile(x, y)]);
    }
    return most;
  }
  [[nodiscard]] std::size_t bytes() const noexcept { return most_.size(); }

 private:
  [[nodiscard]] std::size_t tile(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  Region box_;
  int columns_ = 0;
  std::vector<std::uint8_t> most_;
};

}  // namespace alhazen
