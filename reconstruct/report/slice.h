#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/reconstruct.h"

namespace alhazen {

/// What the reconstruction saw on a vertical plane through the middle of its volume (x to the
/// right, z up, y = the volume's centre): pictures as figure 5.13 of M. Weinmann's thesis. Lists
/// are height × width, row-major, top row first, cells as large as the finest leaves.
struct Slice {
  int width = 0, height = 0;
  std::vector<float> consistency;        ///< 0 … 1
  std::vector<float> divergence_per_mm;  ///< div(cN): positive just inside the surface
  std::vector<float> inside;             ///< u: 1 inside, 0 outside
};

/// At most 1024 cells wide (coarser than the leaves then). REQUIRES: lists of `reconstructed` as
/// long as its octree's leaves.
[[nodiscard]] Slice middle_slice(const Reconstructed& reconstructed);

/// Portable float map (PF, little endian): red consistency, green divergence per mm, blue inside.
[[nodiscard]] std::string to_pfm(const Slice& slice);
/// Fails: corrupt, saying what is wrong. Hostile input welcome.
[[nodiscard]] Result<Slice> parse_slice(std::string_view pfm);

}  // namespace alhazen
