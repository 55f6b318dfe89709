#include "reconstruct/pattern/draw.h"

#include <cmath>
#include <cstring>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

constexpr std::uint8_t kWhite = 255, kBlack = 0;
constexpr int kMinPeriod_px = 2, kMaxPeriod_px = 16384, kMinSteps = 3, kMaxSteps = 64;

std::uint8_t gray_value(const Pattern& pattern, int position_px) {
  const bool one =
      ((gray_from_binary(static_cast<std::uint32_t>(position_px)) >> pattern.bit) & 1U) != 0;
  return one != pattern.inverted ? kWhite : kBlack;
}

std::uint8_t phase_value(const Pattern& pattern, int position_px, double gamma) {
  const double turns = static_cast<double>(position_px) / pattern.period_px -
                       static_cast<double>(pattern.step) / pattern.steps;
  const double light = 0.5 + 0.5 * std::cos(2 * std::numbers::pi * turns);
  return static_cast<std::uint8_t>(std::lround(kWhite * std::pow(light, 1 / gamma)));
}

}  // namespace

Result<Picture> draw(const Pattern& pattern, int width_px, int height_px, double gamma) {
  if (width_px < kMinDisplaySide_px || width_px > kMaxDisplaySide_px ||
      height_px < kMinDisplaySide_px || height_px > kMaxDisplaySide_px) {
    return Error{Code::invalid, "no pattern can be drawn on " + std::to_string(width_px) + " x " +
                                    std::to_string(height_px) +
                                    " px; the sides must be in [2, 16384] px"};
  }
  const auto width = static_cast<std::size_t>(width_px);
  const auto height = static_cast<std::size_t>(height_px);
  std::shared_ptr<std::byte[]> pixels(new std::byte[width * height]);
  const int along_px = pattern.axis == Axis::u ? width_px : height_px;
  // One value a position along the pattern's axis.
  const auto draw_line = [&](const auto& value) {
    if (pattern.axis == Axis::u) {
      for (int u = 0; u < width_px; ++u) pixels[u] = static_cast<std::byte>(value(u));
      for (std::size_t v = 1; v < height; ++v) {
        std::memcpy(pixels.get() + v * width, pixels.get(), width);
      }
    } else {
      for (int v = 0; v < height_px; ++v) {
        std::memset(pixels.get() + static_cast<std::size_t>(v) * width, value(v), width);
      }
    }
  };
  switch (pattern.kind) {
    case PatternKind::white:
    case PatternKind::black:
      std::memset(pixels.get(), pattern.kind == PatternKind::white ? kWhite : kBlack,
                  width * height);
      break;
    case PatternKind::gray: {
      const int bits = gray_bits(along_px);
      if (pattern.bit < 0 || pattern.bit >= bits) {
        return Error{Code::invalid, "bit " + std::to_string(pattern.bit) + " of axis " +
                                        (pattern.axis == Axis::u ? "u" : "v") +
                                        " does not exist on " + std::to_string(width_px) + " x " +
                                        std::to_string(height_px) + " px; it must be in [0, " +
                                        std::to_string(bits - 1) + "]"};
      }
      draw_line([&](int position) { return gray_value(pattern, position); });
      break;
    }
    case PatternKind::phase:
      if (pattern.period_px < kMinPeriod_px || pattern.period_px > kMaxPeriod_px ||
          pattern.steps < kMinSteps || pattern.steps > kMaxSteps || pattern.step < 0 ||
          pattern.step >= pattern.steps) {
        return Error{Code::invalid, "step " + std::to_string(pattern.step) + " of " +
                                        std::to_string(pattern.steps) + " of a period of " +
                                        std::to_string(pattern.period_px) +
                                        " px; the period must be in [2, 16384] px, steps in [3, "
                                        "64], step in [0, steps - 1]"};
      }
      if (!(gamma >= kMinGamma && gamma <= kMaxGamma)) {
        return Error{Code::invalid,
                     "gamma is " + std::to_string(gamma) + "; it must be in [0.5, 4]"};
      }
      draw_line([&](int position) { return phase_value(pattern, position, gamma); });
      break;
  }
  return Picture{Image(width_px, height_px, PixelFormat::mono8, 8, std::move(pixels)), pattern};
}

}  // namespace alhazen
