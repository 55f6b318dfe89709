#pragma once

#include <cstdint>
#include <vector>

#include "alhazen/pattern.h"
#include "alhazen/result.h"

namespace alhazen {

/// How display positions are coded. `gray_phase` refines Gray code below the finest bit that the
/// optics resolve.
enum class Coding : std::uint8_t { gray, gray_phase };

/// Sides of a display that can be coded.
inline constexpr int kMinDisplaySide_px = 2, kMaxDisplaySide_px = 16384;

/// The patterns of one display in the order in which they are shown: white, black, column bits from
/// the most significant, each followed by its inverse, then row bits; for gray_phase the phase
/// steps. Fails: invalid (a side outside 2 … 16384 px), unsupported (gray_phase, for now).
[[nodiscard]] Result<std::vector<Pattern>> make_sequence(Coding coding, int width_px,
                                                         int height_px);

}  // namespace alhazen
