#include "drivers/sim/emission.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <span>

namespace alhazen::sim {
namespace {

std::uint64_t hash_of(std::span<const std::byte> bytes) {
  // Four lanes, so that a picture costs what reading it costs.
  std::uint64_t lanes[4] = {1, 2, 3, 4};
  std::size_t i = 0;
  for (; i + 32 <= bytes.size(); i += 32)
    for (std::size_t lane = 0; lane < 4; ++lane) {
      std::uint64_t word = 0;
      std::memcpy(&word, bytes.data() + i + 8 * lane, 8);
      lanes[lane] = (lanes[lane] ^ word) * 0x9E3779B97F4A7C15ULL;
      lanes[lane] ^= lanes[lane] >> 32;
    }
  std::uint64_t hash = bytes.size();
  for (const std::uint64_t lane : lanes) hash = mixed(hash, lane);
  for (; i < bytes.size(); ++i) hash = mixed(hash, static_cast<std::uint64_t>(bytes[i]));
  return hash;
}

/// Linear light of a pixel value: black · (1 − black) … 1.
class Panel {
 public:
  Panel(const DisplayTruth& display, int bits) : table_(std::size_t{1} << bits) {
    const double white = static_cast<double>(table_.size() - 1);
    for (std::size_t i = 0; i < table_.size(); ++i)
      table_[i] = static_cast<float>(display.black_share +
                                     (1 - display.black_share) *
                                         std::pow(static_cast<double>(i) / white, display.gamma));
  }
  [[nodiscard]] float light(std::size_t value) const {
    return table_[std::min(value, table_.size() - 1)];
  }

 private:
  std::vector<float> table_;
};

}  // namespace

Emission::Emission(const Image& image, const DisplayTruth& display)
    : width_px_(image.width()), height_px_(image.height()), hash_(hash_of(image.bytes())) {
  ALHAZEN_CHECK(image.width() == display.width_px && image.height() == display.height_px);
  const Panel panel(display, image.bits());
  const auto width = static_cast<std::size_t>(width_px_),
             height = static_cast<std::size_t>(height_px_);
  const auto light = [&](std::size_t index) {
    return image.format() == PixelFormat::mono8 ? panel.light(image.mono8()[index])
                                                : panel.light(image.mono16()[index]);
  };
  const std::byte* bytes = image.bytes().data();
  const std::size_t pixel_bytes = bytes_per_pixel(image.format()), row_bytes = width * pixel_bytes;
  bool rows_equal = true, columns_equal = true;
  for (std::size_t y = 0; y < height; ++y) {
    const std::byte* row = bytes + y * row_bytes;
    rows_equal = rows_equal && std::memcmp(row, bytes, row_bytes) == 0;
    // Each pixel equals its right neighbour.
    columns_equal =
        columns_equal && std::memcmp(row, row + pixel_bytes, row_bytes - pixel_bytes) == 0;
  }
  if (rows_equal && columns_equal) {
    uniform_ = light(0);
  } else if (rows_equal || columns_equal) {
    varies_ = rows_equal ? Varies::along_u : Varies::along_v;
    std::vector<float> line(rows_equal ? width : height);
    for (std::size_t i = 0; i < line.size(); ++i) line[i] = light(rows_equal ? i : i * width);
    prepare_line(line);
  } else {
    varies_ = Varies::everywhere;
    std::vector<float> all(width * height);
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = light(i);
    prepare_area(all);
  }
}

void Emission::prepare_line(const std::vector<float>& line) {
  double sum = 0;
  for (const float value : line) sum += value;
  // Without their mean the integrals stay small, and so do their rounding errors.
  uniform_ = sum / static_cast<double>(line.size());
  line_.resize(line.size());
  double once = 0, twice = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const double value = line[i] - uniform_;
    line_[i] = {twice, once, value};
    twice += once + 0.5 * value;
    once += value;
  }
}

void Emission::prepare_area(const std::vector<float>& light) {
  const auto width = static_cast<std::size_t>(width_px_),
             height = static_cast<std::size_t>(height_px_);
  area_.assign((width + 1) * (height + 1), 0);
  for (std::size_t y = 0; y < height; ++y) {
    double row = 0;
    for (std::size_t x = 0; x < width; ++x) {
      row += light[y * width + x];
      area_[(y + 1) * (width + 1) + x + 1] = area_[y * (width + 1) + x + 1] + row;
    }
  }
}

double Emission::line_mean(float centre, std::uint16_t wide, std::uint16_t narrow) const {
  // A patch is never smaller than half a pixel across: no lens is sharper, and 1 / (a b) stays
  // tame.
  const double a = std::max(0.5, wide * (1.0 / Patch::kUnitsPerPx));
  const double b = std::max(a / 8, narrow * (1.0 / Patch::kUnitsPerPx));
  const double x = static_cast<double>(centre) + 0.5;  // pixel i covers [i, i + 1)
  const int last = static_cast<int>(line_.size()) - 1;
  const auto twice = [&](double at) {
    const int i = std::clamp(static_cast<int>(at), 0, last);
    const Node& node = line_[static_cast<std::size_t>(i)];
    const double f = at - i;
    return node.twice + f * (node.once + f * 0.5 * node.value);
  };
  const double outer = 0.5 * (a + b), inner = 0.5 * (a - b);
  return (twice(x + outer) - twice(x + inner) - twice(x - inner) + twice(x - outer)) / (a * b);
}

double Emission::area_mean(const Patch& patch) const {
  const auto half = [](std::uint16_t wide, std::uint16_t narrow) {
    const double a = wide, b = narrow;
    return std::max(0.25, 0.5 / Patch::kUnitsPerPx * std::sqrt(a * a + b * b));
  };
  const double half_u = half(patch.wide_u, patch.narrow_u),
               half_v = half(patch.wide_v, patch.narrow_v);
  const double left = std::clamp(patch.u + 0.5 - half_u, 0.0, static_cast<double>(width_px_)),
               right = std::clamp(patch.u + 0.5 + half_u, 0.0, static_cast<double>(width_px_)),
               top = std::clamp(patch.v + 0.5 - half_v, 0.0, static_cast<double>(height_px_)),
               bottom = std::clamp(patch.v + 0.5 + half_v, 0.0, static_cast<double>(height_px_));
  if (!(right > left && bottom > top)) return 0;
  const auto sum = [&](double x, double y) {
    const int i = std::min(static_cast<int>(x), width_px_ - 1),
              j = std::min(static_cast<int>(y), height_px_ - 1);
    const double fx = x - i, fy = y - j;
    const double* at =
        &area_[static_cast<std::size_t>(j) * static_cast<std::size_t>(width_px_ + 1) +
               static_cast<std::size_t>(i)];
    const double* below = at + width_px_ + 1;
    return (1 - fy) * ((1 - fx) * at[0] + fx * at[1]) + fy * ((1 - fx) * below[0] + fx * below[1]);
  };
  return (sum(right, bottom) - sum(left, bottom) - sum(right, top) + sum(left, top)) /
         ((right - left) * (bottom - top));
}

void Emission::add(const Patch* begin, const Patch* end, double weight, float* row) const {
  const auto each = [&](auto&& mean) {
    for (const Patch* patch = begin; patch != end; ++patch)
      row[patch->x] += static_cast<float>(weight * patch->weight * mean(*patch));
  };
  switch (varies_) {
    case Varies::nowhere:
      if (uniform_ * weight == 0) return;
      return each([&](const Patch&) { return uniform_; });
    case Varies::along_u:
      return each([&](const Patch& p) { return uniform_ + line_mean(p.u, p.wide_u, p.narrow_u); });
    case Varies::along_v:
      return each([&](const Patch& p) { return uniform_ + line_mean(p.v, p.wide_v, p.narrow_v); });
    case Varies::everywhere:
      return each([&](const Patch& p) { return area_mean(p); });
  }
}

}  // namespace alhazen::sim
