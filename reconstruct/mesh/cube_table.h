#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace alhazen {

/// Marching cubes: how the surface runs through a cube for each of the 256 sign patterns.
///
/// Corner c has offset (c & 1, c >> 1 & 1, c >> 2 & 1). Edge 4·axis + k runs along `axis` from the
/// k-th corner whose offset along it is 0 (k counts the other two offsets, lower axis first).
/// Bit c of a pattern: corner c is inside.
///
/// Two rules make the mesh of any signs closed and manifold. On each face every run of inside
/// corners is cut off by its own segment, so both cubes of a face draw the same segments (inside
/// corners of an ambiguous face are separated). Loops of segments are triangulated without
/// diagonals between two edges of one face, so no diagonal is drawn twice; every loop allows one.
struct CubePattern {
  struct Loop {
    std::vector<std::uint8_t> edges;  ///< counter-clockwise seen from outside the object
    /// Each a list of triangles (indices into `edges`); at least one.
    std::vector<std::vector<std::array<std::uint8_t, 3>>> triangulations;
  };
  std::vector<Loop> loops;
};

/// Corner at the low end of an edge.
[[nodiscard]] constexpr int low_corner(int edge) noexcept {
  const int axis = edge / 4, k = edge % 4;
  switch (axis) {
    case 0:
      return (k & 1) << 1 | (k >> 1) << 2;
    case 1:
      return (k & 1) | (k >> 1) << 2;
    default:
      return (k & 1) | (k >> 1) << 1;
  }
}

/// The table, generated at first use. Reentrant.
[[nodiscard]] const std::array<CubePattern, 256>& cube_table();

}  // namespace alhazen
