#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace alhazen {

/// Red, green, blue, 0 … 1, as a display takes them (sRGB).
struct Colour {
  float r = 0, g = 0, b = 0;
};

[[nodiscard]] inline Colour mixed(const Colour& from, const Colour& to, float share) {
  return {from.r + share * (to.r - from.r), from.g + share * (to.g - from.g),
          from.b + share * (to.b - from.b)};
}

/// Colour at `share` (clamped to 0 … 1) of evenly spaced stops. REQUIRES: two stops or more.
[[nodiscard]] inline Colour at_share(std::span<const Colour> stops, float share) {
  const float at = std::clamp(share, 0.0F, 1.0F) * static_cast<float>(stops.size() - 1);
  const auto low = std::min(static_cast<std::size_t>(at), stops.size() - 2);
  return mixed(stops[low], stops[low + 1], at - static_cast<float>(low));
}

/// For values about zero: blue below, pale grey at zero, red above.
inline constexpr std::array<Colour, 5> kDiverging{{{0.07F, 0.22F, 0.48F},
                                                   {0.35F, 0.60F, 0.80F},
                                                   {0.94F, 0.94F, 0.92F},
                                                   {0.89F, 0.49F, 0.35F},
                                                   {0.55F, 0.06F, 0.14F}}};
/// For shares 0 … 1: pale sand to deep green-blue.
inline constexpr std::array<Colour, 4> kSequential{
    {{0.96F, 0.93F, 0.84F}, {0.62F, 0.80F, 0.66F}, {0.17F, 0.55F, 0.56F}, {0.07F, 0.24F, 0.36F}}};
/// For amounts that had better be small: pale, then orange, then dark red.
inline constexpr std::array<Colour, 4> kHeat{
    {{0.97F, 0.95F, 0.89F}, {0.96F, 0.75F, 0.45F}, {0.80F, 0.36F, 0.21F}, {0.40F, 0.07F, 0.14F}}};
/// For places on a display, along one of its axes.
inline constexpr std::array<Colour, 5> kPlaces{{{0.17F, 0.20F, 0.44F},
                                                {0.13F, 0.50F, 0.58F},
                                                {0.56F, 0.76F, 0.47F},
                                                {0.97F, 0.82F, 0.40F},
                                                {0.84F, 0.36F, 0.23F}}};
inline constexpr Colour kDirect{0.86F, 0.87F, 0.87F};  ///< what is seen, but not in the mirror
inline constexpr Colour kCovered{0.25F, 0.60F, 0.58F};
inline constexpr Colour kUnobserved{0.47F, 0.46F, 0.48F};
inline constexpr Colour kClay{0.83F, 0.82F, 0.79F};

}  // namespace alhazen
