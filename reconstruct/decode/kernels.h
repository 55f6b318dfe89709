#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "reconstruct/scan/light_map.h"

namespace alhazen::decode {

/// Pixels are folded in blocks, so that every bit plane's block begins on a byte and every vector
/// unit's lanes divide it. The lists of a decoder are padded to it.
inline constexpr std::size_t kBlock_px = 64;

/// Most bits of an axis: displays have at most 2^14 px a side.
inline constexpr int kMaxBits = 14;

/// How white and black become a threshold, in digital numbers (DN).
struct ContrastRule {
  std::uint16_t full_scale = 255;
  std::uint16_t least = 1;           ///< smallest contrast of a pixel that decodes, ≥ 1
  std::uint16_t noise = 0;           ///< no difference up to this is resolved
  std::uint16_t modulation_q16 = 0;  ///< min_modulation · 2^16
  float per_dn = 1.0F / 255;         ///< 1 / full scale
};

/// The planes of one axis: bit i % 8 of byte i / 8 belongs to pixel i.
struct AxisPlanes {
  /// By significance; nothing where a bit is not of the sequence.
  std::array<const std::uint8_t*, kMaxBits> sign{}, resolved{};
  int bits = 0;               ///< significances are 0 … bits − 1
  std::uint16_t last_px = 0;  ///< the display's last column or row
};

/// What is left to do when every frame was folded in.
struct Final {
  AxisPlanes u, v;
  const float* contrast = nullptr;
  const std::uint8_t* saturated = nullptr;  ///< plane
  float least_contrast = 0;                 ///< of a pixel that decodes
  std::uint16_t coarsest = 0;               ///< 2^max_bit
  float noise = 0;                          ///< standard deviation of a position, cells · contrast
};

/// Where the results of pixel `begin` … `begin + count − 1` go; lists begin with pixel `begin`.
struct FinalOut {
  float *u_px, *v_px, *sigma_u_px, *sigma_v_px;
  Label* label;
  std::uint8_t *bit_u, *bit_v;
};

/// Variance of a uniform distribution over one cell, in cells².
inline constexpr float kCellVariance = 1.0F / 12;

/// The loops over pixels; `count` is a multiple of kBlock_px. Two sets exist, equal bit for bit.
/// Reentrant.
struct Kernels {
  /// contrast ← (white − black) / full scale; threshold ← what a difference must exceed to be
  /// resolved, all ones where contrast is too low; saturated ← white is at full scale.
  void (*contrast8)(const ContrastRule& rule, const std::uint8_t* white, const std::uint8_t* black,
                    std::size_t count, float* contrast, std::uint8_t* threshold,
                    std::uint8_t* saturated);
  void (*contrast16)(const ContrastRule& rule, const std::uint16_t* white,
                     const std::uint16_t* black, std::size_t count, float* contrast,
                     std::uint16_t* threshold, std::uint8_t* saturated);
  /// sign ← pattern > inverse; resolved ← |pattern − inverse| > threshold.
  void (*pair8)(const std::uint8_t* pattern, const std::uint8_t* inverse,
                const std::uint8_t* threshold, std::size_t count, std::uint8_t* sign,
                std::uint8_t* resolved);
  void (*pair16)(const std::uint16_t* pattern, const std::uint16_t* inverse,
                 const std::uint16_t* threshold, std::size_t count, std::uint8_t* sign,
                 std::uint8_t* resolved);
  /// Planes → positions. `begin` is a multiple of kBlock_px.
  void (*finish)(const Final& state, std::size_t begin, std::size_t count, const FinalOut& out);
};

/// One pixel after the other, as plain as can be: the reference.
[[nodiscard]] const Kernels& scalar_kernels();
/// With the best vector unit of this processor, chosen at run time.
[[nodiscard]] const Kernels& vector_kernels();

}  // namespace alhazen::decode
