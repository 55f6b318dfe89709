#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <map>

#include "reconstruct/mesh_io/mesh.h"

namespace alhazen {

/// Icosahedron, each triangle split into four `splits` times, on a sphere; exact normals.
inline Mesh sphere_mesh(double radius_mm, const Eigen::Vector3d& centre_mm, int splits) {
  const double g = (1 + std::sqrt(5.0)) / 2;
  std::vector<Eigen::Vector3d> v = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                                    {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                                    {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
  Mesh mesh;
  mesh.triangles = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                    {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                    {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                    {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  for (int split = 0; split < splits; ++split) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [at, is_new] =
          middles.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(v.size()));
      if (is_new) v.push_back((v[a].normalized() + v[b].normalized()) / 2);
      return at->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    for (const auto& [a, b, c] : mesh.triangles) {
      const auto ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      for (const auto& t : {std::array{a, ab, ca}, std::array{ab, b, bc}, std::array{ca, bc, c},
                            std::array{ab, bc, ca}})
        finer.push_back(t);
    }
    mesh.triangles = std::move(finer);
  }
  for (const auto& p : v) {
    mesh.normals.push_back(p.normalized().cast<float>());
    mesh.vertices_mm.push_back(centre_mm + radius_mm * p.normalized());
  }
  return mesh;
}

/// The cube [0, edge]³, twelve triangles turned outward.
inline Mesh cube_mesh(double edge_mm) {
  Mesh mesh;
  for (int i = 0; i < 8; ++i)
    mesh.vertices_mm.push_back(Eigen::Vector3d(i & 1, (i >> 1) & 1, (i >> 2) & 1) * edge_mm);
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

/// n × n squares over [0, edge]² at a height, facing up.
inline Mesh plane_mesh(double edge_mm, double height_mm, std::uint32_t n) {
  Mesh mesh;
  for (std::uint32_t y = 0; y <= n; ++y) {
    for (std::uint32_t x = 0; x <= n; ++x) {
      mesh.vertices_mm.emplace_back(edge_mm * x / n, edge_mm * y / n, height_mm);
      mesh.normals.emplace_back(0.0F, 0.0F, 1.0F);
    }
  }
  for (std::uint32_t y = 0; y < n; ++y) {
    for (std::uint32_t x = 0; x < n; ++x) {
      const std::uint32_t a = y * (n + 1) + x, b = a + 1, c = a + n + 1, d = c + 1;
      mesh.triangles.push_back({a, b, d});
      mesh.triangles.push_back({a, d, c});
    }
  }
  return mesh;
}

}  // namespace alhazen
