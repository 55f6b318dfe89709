#include "daemon/capture/ambient.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>

namespace alhazen {
namespace {

constexpr std::size_t kBins = 256;

template <class Pixel>
std::array<std::size_t, kBins> histogram(std::span<const Pixel> pixels, int shift) {
  std::array<std::size_t, kBins> bins{};
  // Bits beyond the significant ones would be the device's mistake, not a reason to write anywhere.
  for (const Pixel pixel : pixels) ++bins[std::min<std::size_t>(pixel >> shift, kBins - 1)];
  return bins;
}

}  // namespace

double dark_level(const Image& black) {
  if (black.empty() || black.size_px() == 0) return 0;
  const int shift = black.bits() - 8;
  const auto bins = black.format() == PixelFormat::mono8 ? histogram(black.mono8(), 0)
                                                         : histogram(black.mono16(), shift);
  const std::size_t wanted = black.size_px() - black.size_px() / 10;
  std::size_t below = 0, level = 0;
  while (level + 1 < kBins && (below += bins[level]) < wanted) ++level;
  return static_cast<double>(level) / static_cast<double>(kBins - 1);
}

Result<std::string> judge_ambient(const std::string& camera, const Image& black) {
  const double level = dark_level(black);
  const auto sentence = [&](double bound) {
    return "camera " + camera + " sees " + std::to_string(std::lround(100 * level)) +
           " % of full scale with all displays black (at most " +
           std::to_string(std::lround(100 * bound)) + " %): darken the room or expose for less";
  };
  if (level >= kAmbientStopShare)
    return Error{Code::conflict, sentence(kAmbientStopShare) + "; the scan is not begun"};
  return level >= kAmbientWarnShare ? sentence(kAmbientWarnShare) : std::string();
}

}  // namespace alhazen
