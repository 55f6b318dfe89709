#include "drivers/sim/emission.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <span>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "drivers/sim/emission.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace alhazen::sim {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Means of the line over `lanes` patches.
template <class D>
auto line_mean(D floats, const Emission::Node* line, std::size_t line_size, const float* centre,
               const Extent* extent, float line_mean_value) {
  const hn::RebindToUnsigned<D> words;
  const hn::RebindToSigned<D> whole;
  // Two 16-bit widths a lane.
  const auto packed = hn::LoadU(words, reinterpret_cast<const std::uint32_t*>(extent));
  const auto unit = hn::Set(floats, 1 / Extent::kUnitsPerPx);
  const auto wide_px = hn::Mul(
      hn::ConvertTo(floats, hn::BitCast(whole, hn::And(packed, hn::Set(words, 0xFFFFU)))), unit);
  const auto narrow_px =
      hn::Mul(hn::ConvertTo(floats, hn::BitCast(whole, hn::ShiftRight<16>(packed))), unit);
  // A patch is never narrower than half a pixel: no lens is sharper.
  const auto wide = hn::Max(wide_px, hn::Set(floats, 0.5F));
  const auto half = hn::Mul(wide, hn::Set(floats, 0.5F));
  const auto gauss = hn::Mul(narrow_px, hn::Set(floats, 0.288675135F));  // 1 / (2 √3)
  const auto x =
      hn::Add(hn::LoadU(floats, centre), hn::Set(floats, 0.5F));  // pixel i covers [i, i + 1)
  const auto last = hn::Set(whole, static_cast<std::int32_t>(line_size) - 1);
  const auto* numbers = reinterpret_cast<const float*>(line);
  const auto integral = [&](auto at) {
    const auto i = hn::Min(hn::Max(hn::ConvertTo(whole, at), hn::Zero(whole)), last);
    const auto inside = hn::Sub(at, hn::ConvertTo(floats, i));
    const auto pair = hn::ShiftLeft<1>(i);
    return hn::Add(hn::GatherIndex(floats, numbers, pair),
                   hn::Mul(inside, hn::GatherIndex(floats, numbers + 1, pair)));
  };
  const auto left = hn::Sub(x, half), right = hn::Add(x, half);
  const auto sum =
      hn::Add(hn::Sub(integral(hn::Add(right, gauss)), integral(hn::Add(left, gauss))),
              hn::Sub(integral(hn::Sub(right, gauss)), integral(hn::Sub(left, gauss))));
  return hn::Add(hn::Div(hn::Mul(sum, hn::Set(floats, 0.5F)), wide),
                 hn::Set(floats, line_mean_value));
}

void line_means(const Emission::Node* line, std::size_t line_size, const float* centre,
                const Extent* extent, std::size_t count, float line_mean_value,
                float* HWY_RESTRICT means) {
  const hn::ScalableTag<float> floats;
  const std::size_t lanes = hn::Lanes(floats);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes)
    hn::StoreU(line_mean(floats, line, line_size, centre + i, extent + i, line_mean_value), floats,
               means + i);
  const hn::CappedTag<float, 1> one;
  for (; i < count; ++i)
    hn::StoreU(line_mean(one, line, line_size, centre + i, extent + i, line_mean_value), one,
               means + i);
}

}  // namespace HWY_NAMESPACE
}  // namespace alhazen::sim
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace alhazen::sim {
HWY_EXPORT(line_means);
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

/// Linear light of a pixel value above that of black.
class Panel {
 public:
  Panel(const DisplayTruth& display, int bits) : table_(std::size_t{1} << bits) {
    const double white = static_cast<double>(table_.size() - 1);
    for (std::size_t i = 0; i < table_.size(); ++i)
      table_[i] = static_cast<float>((1 - display.black_share) *
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

void Patches::reserve(std::size_t count) {
  x.reserve(count);
  weight.reserve(count);
  u.reserve(count);
  v.reserve(count);
  extent_u.reserve(count);
  extent_v.reserve(count);
}

void Patches::push_back(const Patch& patch) {
  x.push_back(patch.x);
  weight.push_back(patch.weight);
  u.push_back(patch.u);
  v.push_back(patch.v);
  extent_u.push_back(patch.extent_u);
  extent_v.push_back(patch.extent_v);
}

void Emission::prepare_line(const std::vector<float>& line) {
  double sum = 0;
  for (const float value : line) sum += static_cast<double>(value);
  uniform_ = sum / static_cast<double>(line.size());
  line_.resize(line.size());
  double integral = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const double value = static_cast<double>(line[i]) - uniform_;
    line_[i] = {static_cast<float>(integral), static_cast<float>(value)};
    integral += value;
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

double Emission::area_mean(double u, double v, Extent extent_u, Extent extent_v) const {
  const auto half = [](Extent extent) {
    const double a = extent.wide, b = extent.narrow;
    return std::max(0.25,
                    0.5 / static_cast<double>(Extent::kUnitsPerPx) * std::sqrt(a * a + b * b));
  };
  const double half_u = half(extent_u), half_v = half(extent_v);
  const double left = std::clamp(u + 0.5 - half_u, 0.0, static_cast<double>(width_px_)),
               right = std::clamp(u + 0.5 + half_u, 0.0, static_cast<double>(width_px_)),
               top = std::clamp(v + 0.5 - half_v, 0.0, static_cast<double>(height_px_)),
               bottom = std::clamp(v + 0.5 + half_v, 0.0, static_cast<double>(height_px_));
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

void Emission::add(const Patches& patches, std::size_t begin, std::size_t end, double weight,
                   float* row) const {
  if (varies_ == Varies::nowhere && uniform_ * weight == 0) return;
  // A row's patches, some at a time: first the means, all lanes at once, then where they belong.
  constexpr std::size_t kAtOnce = 256;
  std::array<float, kAtOnce> means;  // filled below
  for (std::size_t first = begin; first < end; first += kAtOnce) {
    const std::size_t count = std::min(kAtOnce, end - first);
    switch (varies_) {
      case Varies::nowhere:
        std::fill_n(means.begin(), count, static_cast<float>(uniform_));
        break;
      case Varies::along_u:
      case Varies::along_v: {
        const bool along_u = varies_ == Varies::along_u;
        HWY_DYNAMIC_DISPATCH(line_means)
        (line_.data(), line_.size(), (along_u ? patches.u : patches.v).data() + first,
         (along_u ? patches.extent_u : patches.extent_v).data() + first, count,
         static_cast<float>(uniform_), means.data());
        break;
      }
      case Varies::everywhere:
        for (std::size_t i = 0; i < count; ++i)
          means[i] = static_cast<float>(area_mean(
              static_cast<double>(patches.u[first + i]), static_cast<double>(patches.v[first + i]),
              patches.extent_u[first + i], patches.extent_v[first + i]));
        break;
    }
    const auto share = static_cast<float>(weight);
    for (std::size_t i = 0; i < count; ++i)
      row[patches.x[first + i]] += share * patches.weight[first + i] * means[i];
  }
}

}  // namespace alhazen::sim
#endif  // HWY_ONCE
