#include "reconstruct/pattern/draw.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

constexpr std::uint8_t kWhite = 255, kBlack = 0;

std::uint8_t gray_value(const Pattern& pattern, int position_px) {
  const bool one =
      ((gray_from_binary(static_cast<std::uint32_t>(position_px)) >> pattern.bit) & 1U) != 0;
  return one != pattern.inverted ? kWhite : kBlack;
}

}  // namespace

Result<Picture> draw(const Pattern& pattern, int width_px, int height_px) {
  if (width_px < kMinDisplaySide_px || width_px > kMaxDisplaySide_px ||
      height_px < kMinDisplaySide_px || height_px > kMaxDisplaySide_px) {
    return Error{Code::invalid, "no pattern can be drawn on " + std::to_string(width_px) + " x " +
                                    std::to_string(height_px) +
                                    " px; the sides must be in [2, 16384] px"};
  }
  const auto width = static_cast<std::size_t>(width_px);
  const auto height = static_cast<std::size_t>(height_px);
  std::shared_ptr<std::byte[]> pixels(new std::byte[width * height]);
  switch (pattern.kind) {
    case PatternKind::white:
    case PatternKind::black:
      std::memset(pixels.get(), pattern.kind == PatternKind::white ? kWhite : kBlack,
                  width * height);
      break;
    case PatternKind::gray: {
      const int bits = gray_bits(pattern.axis == Axis::u ? width_px : height_px);
      if (pattern.bit < 0 || pattern.bit >= bits) {
        return Error{Code::invalid, "bit " + std::to_string(pattern.bit) + " of axis " +
                                        (pattern.axis == Axis::u ? "u" : "v") +
                                        " does not exist on " + std::to_string(width_px) + " x " +
                                        std::to_string(height_px) + " px; it must be in [0, " +
                                        std::to_string(bits - 1) + "]"};
      }
      if (pattern.axis == Axis::u) {
        for (int u = 0; u < width_px; ++u)
          pixels[u] = static_cast<std::byte>(gray_value(pattern, u));
        for (std::size_t v = 1; v < height; ++v) {
          std::memcpy(pixels.get() + v * width, pixels.get(), width);
        }
      } else {
        for (int v = 0; v < height_px; ++v) {
          std::memset(pixels.get() + static_cast<std::size_t>(v) * width, gray_value(pattern, v),
                      width);
        }
      }
      break;
    }
    case PatternKind::phase:
      return Error{Code::unsupported, "phase patterns are not built yet"};
  }
  return Picture{Image(width_px, height_px, PixelFormat::mono8, 8, std::move(pixels)), pattern};
}

}  // namespace alhazen
