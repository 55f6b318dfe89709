#pragma once

#include "alhazen/pattern.h"
#include "alhazen/result.h"

namespace alhazen {

/// Gamma of a panel of which nothing better is known, and its range.
inline constexpr double kUsualGamma = 2.2, kMinGamma = 0.5, kMaxGamma = 4;

/// The picture of a pattern for a display of this size, mono8, display pixel values (not linear
/// light): Gray code of u counted from 0, 255 where the bit is 1 (0 where inverted); phases such
/// that value^gamma is ½ + ½ cos 2π(u / period − step / steps).
/// Fails: invalid (size outside 2 … 16384 px, bit beyond the size, gamma outside 0.5 … 4, period
///        outside 2 … 16384 px, steps outside 3 … 64, step outside 0 … steps − 1).
[[nodiscard]] Result<Picture> draw(const Pattern& pattern, int width_px, int height_px,
                                   double gamma = kUsualGamma);

}  // namespace alhazen
