#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace alhazen {

/// Display positions of one light map, cropped to where it knows something: (u, v) pairs row by row
/// and one flag a pixel.
struct Positions {
  int width = 0, height = 0;
  std::vector<float> uv_px;
  std::vector<std::uint8_t> is_valid;
  /// Standard deviation of u and of v, px: medians of the map. 0 where unknown.
  float sigma_u_px = 0, sigma_v_px = 0;
};

/// Prepares positions for being looked up bilinearly, in place, each coordinate on its own.
///
/// A mirror without an edge maps pixels to the display by a function that a quadratic polynomial
/// describes within a few pixels. So
/// - a position that no such polynomial through its eight neighbours comes near to, though they
///   agree among themselves, is an error of decoding: it is replaced by the neighbours' own
///   estimate, Σ(sides)/2 − Σ(corners)/4, which is exact for quadratics;
/// - the rest becomes the least-squares quadratic of the window around it (Savitzky, Golay 1964):
///   5 × 5 pixels where the code is coarse against the map's own change from pixel to pixel, 3 × 3
///   where it is fine; windows with an invalid or torn pixel leave theirs as it is;
/// - and what box-shaped pixels and bilinear look-up will add, f''/24 and f''/12 in the mean along
///   each axis, is taken off.
/// `jump_px`: neighbours farther apart than this are torn. What stays wrong becomes invalid.
void smooth_positions(Positions& positions, float jump_u_px, float jump_v_px);

}  // namespace alhazen
