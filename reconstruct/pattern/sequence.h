#pragma once

#include <array>
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

/// Periods of gray_phase, longest first, each half of the one before, so that one tells which
/// period of the next. A period gives the best position where it is three to six times a pixel's
/// footprint, and none below 1.5 footprints: mirrors that curve less than the plate of a table and
/// more than a marble spread a pixel over 1 to 170 display pixels.
inline constexpr std::array<int, 4> kPhasePeriods_px = {256, 128, 64, 32};
/// Steps of a period. Five, for panels are not as linear as their gamma says: harmonics below the
/// fourth cancel.
inline constexpr int kPhaseSteps = 5;
/// Gray code ends above this bit where phases follow: its cells are a quarter of the longest
/// period, so that a cell's centre tells the period from its neighbours.
inline constexpr int kPhaseGrayBit = 6;

/// The patterns of one display in the order in which they are shown: white, black, column bits from
/// the most significant, each followed by its inverse, then row bits. For gray_phase bits below
/// kPhaseGrayBit are left out, and the phase steps follow: columns, then rows, each from the
/// longest period; a side of fewer pixels than two such cells is coded by all its bits alone.
/// Fails: invalid (a side outside 2 … 16384 px).
[[nodiscard]] Result<std::vector<Pattern>> make_sequence(Coding coding, int width_px,
                                                         int height_px);

}  // namespace alhazen
