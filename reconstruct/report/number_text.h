#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <string>

namespace alhazen {

/// A number as people read it, with that many decimals.
[[nodiscard]] inline std::string fixed(double value, int decimals) {
  std::array<char, 400> text{};
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  return text.data();
}

/// A length with the unit that suits it.
[[nodiscard]] inline std::string length(double mm) {
  const double size = std::abs(mm);
  if (size < 0.1) return fixed(mm * 1000, size < 0.01 ? 2 : 1) + " µm";
  return fixed(mm, size < 10 ? 3 : 1) + " mm";
}

/// The least of 1, 2, 5 × 10ⁿ that is not below a value: the ends of a colour bar.
[[nodiscard]] inline double round_limit(double value) {
  if (!(value > 0)) return 1;
  const double ten = std::pow(10, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (value <= step * ten * (1 + 1e-9)) return step * ten;
  }
  return 10 * ten;
}

/// Such an end, without decimals that say nothing: 0.02 as "20 µm".
[[nodiscard]] inline std::string round_length(double mm) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g", mm < 0.1 ? mm * 1000 : mm);
  return std::string(text.data()) + (mm < 0.1 ? " µm" : " mm");
}

}  // namespace alhazen
