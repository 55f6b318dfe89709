#pragma once

#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/run.h"
#include "reconstruct/vote/octree.h"

namespace alhazen {

/// The surface value = 0 of a function given at leaf centres (negative inside) as triangles with
/// unit normals from its gradient. For an Indicator pass ½ − u.
///
/// The samples form a uniform grid of finest leaves (a coarser leaf stands for all finest leaves in
/// it; beyond the volume everything is outside) on which marching cubes run with a table in which
/// ambiguous faces separate the inside corners and no diagonal lies in a face. Therefore the mesh
/// is closed, manifold and consistently oriented for *every* input. Positions: the root of the
/// cubic through four samples along a grid edge where they are of the finest level and smooth
/// there, else linear.
///
/// Fails: invalid (list of another length, a value not finite), conflict (no surface), cancelled.
/// Reentrant; uses the caller's TBB arena; the result is the same for any number of threads.
/// Source: Lorensen and Cline, SIGGRAPH 1987; the table is generated at first use from the
/// two rules above.
[[nodiscard]] Result<Mesh> contour(const Octree& octree, const std::vector<float>& value,
                                   const Run& run);

/// What is known per leaf and wanted per vertex. Lists run parallel to Octree::leaves().
struct LeafFacts {
  std::vector<float> consistency;      ///< 0 … 1
  std::vector<std::uint8_t> observed;  ///< 1: measured here
  std::vector<float> depth_sigma_mm;   ///< ignored where not observed
};

/// Fills mesh.consistency, observed and depth_sigma_mm: each vertex takes the values of the nearest
/// observed leaf among the eight whose centres surround it, or, where none of them is observed, of
/// the nearest.
/// REQUIRES: lists as long as octree.leaves().
void annotate(const Octree& octree, const LeafFacts& facts, Mesh& mesh);

}  // namespace alhazen
