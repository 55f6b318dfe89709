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
  if (coding != Coding::gray) {
    return Error{Code::unsupported, "coding 'gray_phase' is not built yet; use 'gray'"};
  }
  std::vector<Pattern> sequence;
  sequence.push_back({.kind = PatternKind::white});
  sequence.push_back({.kind = PatternKind::black});
  for (const Axis axis : {Axis::u, Axis::v}) {
    for (int bit = gray_bits(axis == Axis::u ? width_px : height_px) - 1; bit >= 0; --bit) {
      for (const bool inverted : {false, true}) {
        sequence.push_back(
            {.kind = PatternKind::gray, .axis = axis, .bit = bit, .inverted = inverted});
      }
    }
  }
  return sequence;
}

}  // namespace alhazen
