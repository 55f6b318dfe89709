#pragma once

#include "alhazen/pattern.h"
#include "alhazen/result.h"

namespace alhazen {

/// The picture of a pattern for a display of this size, mono8, display pixel values (not linear
/// light): Gray code of u counted from 0, 255 where the bit is 1 (0 where inverted).
/// Fails: invalid (size outside 2 … 16384 px, bit beyond the size).
[[nodiscard]] Result<Picture> draw(const Pattern& pattern, int width_px, int height_px);

}  // namespace alhazen
