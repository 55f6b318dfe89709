#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "reconstruct/mesh_io/mesh.h"

namespace alhazen {

/// The point of a set of triangles that lies nearest to another point.
struct Nearest {
  double distance_mm = 0;
  Eigen::Vector3d point_mm;
  std::uint32_t triangle = 0;  ///< of the mesh
  /// Weights of the triangle's corners; exactly zero for corners the point is not spanned by: one
  /// zero on an edge, two at a vertex.
  Eigen::Vector3d weights;
};

/// Bounding boxes over triangles of a mesh, for exact nearest-point queries. Immutable, reentrant;
/// building uses the caller's TBB arena and gives the same tree for any number of threads.
class TriangleTree {
 public:
  /// REQUIRES: indices within the mesh; positions finite. The mesh may go afterwards.
  TriangleTree(const Mesh& mesh, std::span<const std::uint32_t> triangles);
  /// Over all triangles of the mesh.
  explicit TriangleTree(const Mesh& mesh);

  /// Nothing if no triangle is within `within_mm`.
  [[nodiscard]] std::optional<Nearest> nearest(
      const Eigen::Vector3d& p_mm,
      double within_mm = std::numeric_limits<double>::infinity()) const;

 private:
  struct Triangle {
    Eigen::Vector3d a, b, c;
    std::uint32_t index;
  };
  struct Node {
    Eigen::Vector3d low, high;
    std::uint32_t first = 0;  ///< leaf: of its triangles; inner: left child, right one is next
    std::uint32_t count = 0;  ///< 0: inner
  };
  void build(std::uint32_t node, std::uint32_t begin, std::uint32_t end, std::uint32_t free_node);

  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
};

}  // namespace alhazen
