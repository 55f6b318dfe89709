#pragma once

#include <cstdint>
#include <optional>

#include "alhazen/image.h"

namespace alhazen {

/// Which coordinate of a display a pattern encodes: u is the column, v the row.
enum class Axis : std::uint8_t { u, v };

enum class PatternKind : std::uint8_t { white, black, gray, phase };

/// One picture of a pattern sequence, as parameters.
struct Pattern {
  PatternKind kind = PatternKind::black;
  Axis axis = Axis::u;    ///< gray, phase
  int bit = 0;            ///< gray: significance, 0 = finest
  bool inverted = false;  ///< gray: shown as its inverse
  int period_px = 0;      ///< phase: ½ + ½ cos 2π(u / period_px − step / steps), linear light
  int step = 0, steps = 0;  ///< phase
  friend bool operator==(const Pattern&, const Pattern&) = default;
};

/// What a display is asked to show. The pixels are what counts; `pattern` tells how they came
/// about, for displays that would rather draw than receive them (a tablet's page).
struct Picture {
  Image image;
  std::optional<Pattern> pattern;
};

}  // namespace alhazen
