#include <algorithm>
#include <cmath>

#include "reconstruct/vote/kernels.h"

namespace alhazen::kernels {

Mode histogram_mode(const float* x, const float* y, const float* z, std::size_t count,
                    float bandwidth_rad, std::uint64_t* scratch) {
  if (count == 0) return {};
  // A cell's number, then which vote: sorted, the votes of a cell stand together.
  const float cells_per_unit = 1 / (2 * bandwidth_rad);
  for (std::size_t i = 0; i < count; ++i) {
    const float sum = std::abs(x[i]) + std::abs(y[i]) + std::abs(z[i]);
    float u = x[i] / sum, v = y[i] / sum;
    if (z[i] < 0) {
      const float folded = (1 - std::abs(v)) * (u < 0 ? -1.0F : 1.0F);
      v = (1 - std::abs(u)) * (v < 0 ? -1.0F : 1.0F);
      u = folded;
    }
    const auto column = static_cast<std::uint64_t>((u + 1) * cells_per_unit);
    const auto row = static_cast<std::uint64_t>((v + 1) * cells_per_unit);
    scratch[i] = row << 44 | column << 24 | static_cast<std::uint64_t>(i);
  }
  std::sort(scratch, scratch + count);
  constexpr int kVoteBits = 24;
  std::size_t best = 0, most = 0;
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    while (end < count && scratch[end] >> kVoteBits == scratch[begin] >> kVoteBits) ++end;
    if (end - begin > most) {
      most = end - begin;
      best = begin;
    }
  }
  Mode mode;
  for (std::size_t k = best; k < best + most; ++k) {
    const std::size_t i = scratch[k] & ((std::uint64_t{1} << kVoteBits) - 1);
    mode.x += x[i];
    mode.y += y[i];
    mode.z += z[i];
  }
  const float length = std::sqrt(mode.x * mode.x + mode.y * mode.y + mode.z * mode.z);
  mode.x /= length;
  mode.y /= length;
  mode.z /= length;
  mode.support = static_cast<float>(most);
  return mode;
}

}  // namespace alhazen::kernels
