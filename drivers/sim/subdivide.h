#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"

namespace alhazen::sim {

/// A triangle mesh whose corners carry normals of their own, so that creases stay sharp.
struct SmoothMesh {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Eigen::Vector3f>
      normals;  ///< unit, outward; the first vertices.size() are one a vertex
  std::vector<std::array<std::uint32_t, 3>> triangles;       ///< vertex of each corner
  std::vector<std::array<std::uint32_t, 3>> corner_normals;  ///< normal of each corner
};

/// Loop subdivision until there are at least `min_triangles`; then every vertex is put on the limit
/// surface and given the limit surface's normal. Edges whose faces meet at more than `crease_rad`
/// stay sharp; a vertex where three or more of them meet keeps its place.
/// Source: C. Loop, Smooth subdivision surfaces based on triangles, 1987; creases and limit masks
///         after Hoppe et al., Piecewise smooth surface reconstruction, SIGGRAPH 1994, and
///         Biermann, Levin, Zorin, SIGGRAPH 2000.
/// Fails: invalid (not a closed manifold: says which edge or vertex; too few or too many
/// triangles).
[[nodiscard]] Result<SmoothMesh> subdivide(const Mesh& mesh, std::size_t min_triangles,
                                           double crease_rad);

}  // namespace alhazen::sim
