#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "reconstruct/scan/light_map.h"

namespace alhazen::decode {

/// A decoder's state lies in tiles of so many pixels, one after the other: what finishing needs of
/// a tile is together, and a plane of it fills a line of the caches. The last tile is padded.
inline constexpr std::size_t kTile_px = 512;
/// Bit i % 8 of byte i / 8 of a plane belongs to pixel i of its tile.
inline constexpr std::size_t kPlaneBytes = kTile_px / 8;

/// Most bits of an axis: displays have at most 2^14 px a side.
inline constexpr int kMaxBits = 14;

/// How white and black become a threshold, in digital numbers (DN): what a difference must exceed
/// to be resolved. It is modulation · contrast, at least the noise, and all ones where contrast is
/// too low.
struct ContrastRule {
  std::uint16_t full_scale = 255;
  std::uint16_t least = 1;           ///< smallest contrast of a pixel that decodes, ≥ 1
  std::uint16_t noise = 0;           ///< no difference up to this is resolved
  std::uint16_t modulation_q16 = 0;  ///< min_modulation · 2^16
};

/// What the pairs of one axis said, in three planes of the tile a bit, the finest shown bit first.
/// The first, sign: the pattern is brighter than its inverse. The other two, clear and strong, say
/// how far apart they are:
///   0 0  unresolved: the pixel's footprint covers as much of one as of the other
///   0 1  weak: unresolved, but farther than a quarter of a cell from the edge (kWeak)
///   1 0  resolved: beyond the threshold
///   1 1  strong: beyond twice the threshold
///
/// Why strong: let a pixel's footprint on the display be a box of width F. A bit's modulation
/// |pattern − inverse| / (white − black) at distance x from its edge is at most 2x / F. The edges
/// of bit b lie at odd multiples of its cell, 2^b px, those of all coarser bits at even ones, so
/// every place is within a cell of a coarser bit's edge. Where all coarser bits are strong, beyond
/// ½ with the default threshold of ¼, x > F / 4 for each of them, hence F < 4 cells. There bit b's
/// sign is right (beyond 4 cells it would come back inverted), and if it is unresolved, the place
/// is within 0.4 cells of its edge: near F = 4 because x > F / 4 leaves no more, below F = 3.2
/// because 2 · 0.4 / 3.2 = ¼.
///
/// Side lobe: with 5.3 to 6.4 cells in the footprint a bit that is too fine seems resolved,
/// inverted, within F / 25 of its stripes' centres. These are edges of coarser bits, one of which
/// is unresolved then; the finer bits must read 10…0 there, and read so but for the finest.
struct AxisBits {
  std::size_t first_plane = 0;  ///< sign of the finest shown bit; three a bit follow
  int lowest = 0, bits = 0;     ///< significances lowest … bits − 1 are shown
  std::uint16_t last_px = 0;    ///< the display's last column or row
};
inline constexpr std::size_t kPlanesPerBit = 3;

/// Pairs that are folded together at most. A pair alone reads as much contrast as half of a frame.
inline constexpr std::size_t kMaxPairsAtOnce = 4;

/// Of a threshold: where a pixel with the largest footprint that resolves a bit, F = 3.2 cells, is
/// a quarter of a cell from the edge, so that the edge and the cell's centre are equally good
/// guesses of where it is: modulation 2 · ¼ / 3.2 = 0.156 = ⅝ · ¼, ¼ being the default threshold.
[[nodiscard]] constexpr int weak_threshold(int threshold) noexcept {
  const auto rounded_mean = [](int a, int b) { return (a + b + 1) / 2; };
  return rounded_mean(threshold, rounded_mean(rounded_mean(threshold, 0), 0));
}

/// How planes become positions.
struct FinalRule {
  AxisBits u, v;
  std::size_t saturated_plane = 0;  ///< the plane of enough contrast follows
  std::uint16_t coarsest = 0;       ///< 2^max_bit
  float to_255 = 1;                 ///< 255 / full scale
  /// What noise adds to a position's standard deviation · contrast², cells · DN².
  float noise_square = 0;
};

/// Where the results of one tile go: kTile_px elements each. What kernels write for long past the
/// caches is aligned to kOutAlignment, and a hwy::FlushStream() must come before another thread
/// reads it.
inline constexpr std::size_t kOutAlignment = 64;
struct FinalOut {
  float *u_px, *v_px;
  Imath::half *sigma_u_px, *sigma_v_px;
  std::uint8_t* contrast;
  Label* label;
  std::uint8_t *bit_u, *bit_v;
};

/// Standard deviation of a uniform distribution over one cell, in cells.
inline constexpr float kCellSigma = 0.288675135F;
/// √(a² + x²) ≈ a + x² / 2a with a = kCellSigma: to 1 % where x < a / 2, and noise is less wherever
/// it leaves a bit resolved.
inline constexpr float kNoiseSquareToSigma = 0.5F / kCellSigma;

/// Two frames to compare, and where the planes of the first tile go, AxisBits: clear and strong
/// follow sign, which is aligned to kOutAlignment.
template <class Dn>
struct FramePair {
  const Dn *pattern = nullptr, *inverse = nullptr;
  std::uint8_t* sign = nullptr;
};

/// The loops over the pixels of so many tiles, whose planes lie tile_bytes apart. Two sets exist,
/// equal bit for bit. Reentrant.
struct Kernels {
  /// contrast ← white − black, 0 where negative, aligned to kOutAlignment; saturated ← white is at
  /// full scale, and in the plane after it: contrast is enough.
  void (*contrast8)(const ContrastRule& rule, const std::uint8_t* white, const std::uint8_t* black,
                    std::size_t tiles, std::size_t tile_bytes, std::uint8_t* contrast,
                    std::uint8_t* saturated);
  void (*contrast16)(const ContrastRule& rule, const std::uint16_t* white,
                     const std::uint16_t* black, std::size_t tiles, std::size_t tile_bytes,
                     std::uint16_t* contrast, std::uint8_t* saturated);
  /// Pairs into their planes, several at a time: contrast and thresholds are read only once.
  void (*pairs8)(const ContrastRule& rule, const std::uint8_t* contrast,
                 std::span<const FramePair<std::uint8_t>> pairs, std::size_t tiles,
                 std::size_t tile_bytes);
  void (*pairs16)(const ContrastRule& rule, const std::uint16_t* contrast,
                  std::span<const FramePair<std::uint16_t>> pairs, std::size_t tiles,
                  std::size_t tile_bytes);
  /// One tile's planes and contrast → positions.
  void (*finish8)(const FinalRule& rule, const std::uint8_t* planes, const std::uint8_t* contrast,
                  const FinalOut& out);
  void (*finish16)(const FinalRule& rule, const std::uint8_t* planes, const std::uint16_t* contrast,
                   const FinalOut& out);
};

/// One pixel after the other, as plain as can be: the reference.
[[nodiscard]] const Kernels& scalar_kernels();
/// With the best vector unit of this processor, chosen at run time.
[[nodiscard]] const Kernels& vector_kernels();

}  // namespace alhazen::decode
