#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace alhazen {

/// Triangles with what is known about each vertex. Millimetres, object frame; counter-clockwise
/// seen from outside. Per-vertex lists are empty or as long as `vertices_mm`.
struct Mesh {
  std::vector<Eigen::Vector3d> vertices_mm;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<Eigen::Vector3f> normals;  ///< unit, outward
  std::vector<float> consistency;        ///< surface consistency, 0 … 1
  std::vector<std::uint8_t>
      observed;  ///< 1: measured; 0: closed smoothly, never counted as measured
  std::vector<float>
      depth_sigma_mm;  ///< standard deviation along the normal; NaN where not observed
};

}  // namespace alhazen
