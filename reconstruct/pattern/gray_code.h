#pragma once

#include <cstdint>

namespace alhazen {

/// Binary reflected Gray code: neighbours differ in one bit (F. Gray, US patent 2632058).
[[nodiscard]] constexpr std::uint32_t gray_from_binary(std::uint32_t value) noexcept {
  return value ^ (value >> 1);
}

[[nodiscard]] constexpr std::uint32_t binary_from_gray(std::uint32_t gray) noexcept {
  for (std::uint32_t shift = 1; shift < 32; shift <<= 1) gray ^= gray >> shift;
  return gray;
}

/// Bits that `size_px` positions need: ⌈log₂ size_px⌉, at least 1.
[[nodiscard]] constexpr int gray_bits(int size_px) noexcept {
  int bits = 1;
  while ((1 << bits) < size_px) ++bits;
  return bits;
}

}  // namespace alhazen
