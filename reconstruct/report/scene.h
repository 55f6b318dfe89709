#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/report/colouring.h"

namespace alhazen {

/// A mesh for display: some of another's vertices, in the order in which triangles name them first.
struct DisplayMesh {
  std::vector<std::uint32_t> source;  ///< per vertex: which one of the other mesh it is
  std::vector<std::array<std::uint32_t, 3>> triangles;
  double cell_mm = 0;  ///< edge of the grid's cells whose vertices became one; 0: none were merged
};

/// At most `max_triangles` of them: all vertices in a cell of a grid become the one that is nearest
/// to their mean (Rossignac and Borrel 1993), in the finest grid that is coarse enough. Nothing is
/// invented: every vertex keeps its place and what is known of it. Not always closed: for the eye.
/// REQUIRES: indices within the vertices.
[[nodiscard]] DisplayMesh simplified(const Mesh& mesh, std::size_t max_triangles);

/// What the page's script is given of a mesh.
struct Scene {
  /// JSON: "vertices", "triangles", "low_mm", "step_mm" (places are low + step × number),
  /// "shown_share" (of the mesh's triangles), "cell_mm", "colourings", "views". Holds no "<".
  std::string facts;
  /// Little endian, one after the other: per vertex three uint16 (place), two int16 (normal, folded
  /// octahedron, ±32767), one byte for each colouring that has stops (254 × share; 255: not
  /// observed); then the triangles' indices, each as how far it lies below the number of vertices
  /// named so far, seven bits a byte, lowest first, the eighth says that more follow.
  std::string data;
};

/// REQUIRES: per-vertex lists empty or of the vertices' number; colourings of `mesh`.
[[nodiscard]] Scene scene_of(const Mesh& mesh, const DisplayMesh& shown,
                             std::span<const Colouring> colourings);

}  // namespace alhazen
