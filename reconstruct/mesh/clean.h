#pragma once

#include <cstddef>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"

namespace alhazen {

/// What a closed, oriented surface must not have, counted, and what it has.
struct MeshCheck {
  std::size_t boundary_edges = 0;         ///< edges of one triangle
  std::size_t non_manifold_edges = 0;     ///< edges of three or more triangles
  std::size_t inconsistent_edges = 0;     ///< edges that two triangles run along in the same sense
  std::size_t non_manifold_vertices = 0;  ///< vertices whose triangles form more than one fan
  std::size_t degenerate_triangles =
      0;  ///< repeated corner, or height below 1e-9 of its longest edge
  std::size_t unused_vertices = 0;
  std::size_t components = 0;  ///< of triangles connected by edges
  std::ptrdiff_t euler = 0;    ///< vertices − edges + triangles: 2 per sphere, 0 per torus
  double volume_mm3 = 0;       ///< enclosed, positive where triangles turn outward
  double area_mm2 = 0;

  /// Closed, manifold, consistently oriented, nothing degenerate.
  [[nodiscard]] bool closed() const noexcept {
    return boundary_edges == 0 && non_manifold_edges == 0 && inconsistent_edges == 0 &&
           non_manifold_vertices == 0 && degenerate_triangles == 0;
  }
};

/// REQUIRES: indices within the vertices. Reentrant.
[[nodiscard]] MeshCheck check_closed(const Mesh& mesh);

/// Tunables of clean().
struct CleanOptions {
  /// Components that enclose less than this share of the largest one's volume are dropped. Unit 1,
  /// range [0, 1].
  double min_component_share = 0.01;
  /// Components turned inward (voids inside the object, which no camera sees) are dropped.
  bool drop_voids = true;
  /// Edges shorter than this are collapsed where the surface stays manifold and no triangle turns
  /// over. mm, 0: none.
  double min_edge_mm = 0;
};

/// Keeps the object, removes what floats, collapses short edges, and turns the diagonals of
/// needles; a closed mesh stays closed, manifold and oriented. Per-vertex lists are carried along.
/// Fails: invalid (options out of range, index out of range), conflict (nothing is left).
[[nodiscard]] Result<Mesh> clean(Mesh mesh, const CleanOptions& options);

/// Sets unit normals, area-weighted means of the triangles about each vertex.
void set_normals(Mesh& mesh);

}  // namespace alhazen
