#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/image.h"

namespace alhazen {

/// A rectangle of sensor pixels, the last ones included. What is not on the sensor stands at −1 or
/// beyond every one.
struct PixelRange {
  int x0, y0, x1, y1;

  /// The pixels within `reach_px` of a point, along rows and columns. None, where it is no number.
  static PixelRange about(double x_px, double y_px, double reach_px) {
    const auto pixel = [](double px) {
      constexpr double kFarthest_px = 1 << 20;
      return px >= 0 ? static_cast<int>(std::min(px, kFarthest_px)) : -1;
    };
    return {pixel(x_px - reach_px), pixel(y_px - reach_px), pixel(x_px + reach_px),
            pixel(y_px + reach_px)};
  }
};

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
  /// No pixel of the range holds more.
  [[nodiscard]] std::uint8_t most(const PixelRange& range) const {
    const int x0 = std::max(range.x0 - box_.x, 0), x1 = std::min(range.x1 - box_.x, box_.width - 1);
    const int y0 = std::max(range.y0 - box_.y, 0),
              y1 = std::min(range.y1 - box_.y, box_.height - 1);
    if (x0 > x1 || y0 > y1) return 0;
    std::uint8_t most = 0;
    for (int y = y0 / kSide_px; y <= y1 / kSide_px; ++y) {
      for (int x = x0 / kSide_px; x <= x1 / kSide_px; ++x) most = std::max(most, most_[tile(x, y)]);
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
