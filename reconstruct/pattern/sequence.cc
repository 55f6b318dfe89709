#include "reconstruct/pattern/sequence.h"

#include <string>

#include "reconstruct/pattern/gray_code.h"

namespace alhazen {

Result<std::vector<Pattern>> make_sequence(Coding coding, int width_px, int height_px) {
  if (width_px < kMinDisplaySide_px || width_px > kMaxDisplaySide_px ||
      height_px < kMinDisplaySide_px || height_px > kMaxDisplaySide_px) {
    return Error{Code::invalid, "a display of " + std::to_string(width_px) + " x " +
                                    std::to_string(height_px) +
                                    " px cannot be coded; its sides must be in [2, 16384] px"};
  }
  std::vector<Pattern> sequence;
  sequence.push_back({.kind = PatternKind::white});
  sequence.push_back({.kind = PatternKind::black});
  const auto bits_of = [&](Axis axis) { return gray_bits(axis == Axis::u ? width_px : height_px); };
  const auto has_phases = [&](Axis axis) {
    return coding == Coding::gray_phase && bits_of(axis) > kPhaseGrayBit;
  };
  for (const Axis axis : {Axis::u, Axis::v}) {
    const int finest = has_phases(axis) ? kPhaseGrayBit : 0;
    for (int bit = bits_of(axis) - 1; bit >= finest; --bit) {
      for (const bool inverted : {false, true}) {
        sequence.push_back(
            {.kind = PatternKind::gray, .axis = axis, .bit = bit, .inverted = inverted});
      }
    }
  }
  for (const Axis axis : {Axis::u, Axis::v}) {
    if (!has_phases(axis)) continue;
    for (const int period_px : kPhasePeriods_px) {
      for (int step = 0; step < kPhaseSteps; ++step) {
        sequence.push_back({.kind = PatternKind::phase,
                            .axis = axis,
                            .period_px = period_px,
                            .step = step,
                            .steps = kPhaseSteps});
      }
    }
  }
  return sequence;
}

}  // namespace alhazen
