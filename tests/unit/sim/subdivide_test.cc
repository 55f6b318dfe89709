#include "drivers/sim/subdivide.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace alhazen::sim {
namespace {

using testing::HasSubstr;

Mesh cube() {
  Mesh mesh;
  for (int i = 0; i < 8; ++i) mesh.vertices_mm.emplace_back(i & 1, (i >> 1) & 1, (i >> 2) & 1);
  for (const auto& [a, b, c, d] : std::vector<std::array<std::uint32_t, 4>>{
           {0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}) {
    mesh.triangles.push_back({a, b, c});
    mesh.triangles.push_back({a, c, d});
  }
  return mesh;
}

/// A lumpy closed surface without symmetry, of a latitude-longitude grid.
Mesh lump() {
  Mesh mesh;
  constexpr std::uint32_t kAround = 14, kRings = 7;
  const auto add = [&](double along, double round) {
    const double radius = 10 + 1.5 * std::sin(2 * along) * std::cos(3 * round) + std::cos(round);
    mesh.vertices_mm.emplace_back(radius * std::cos(along) * std::cos(round),
                                  radius * std::cos(along) * std::sin(round),
                                  radius * std::sin(along));
  };
  for (std::uint32_t j = 1; j <= kRings; ++j)
    for (std::uint32_t i = 0; i < kAround; ++i)
      add(std::numbers::pi * (static_cast<double>(j) / (kRings + 1) - 0.5),
          2 * std::numbers::pi * i / kAround);
  add(-std::numbers::pi / 2, 0);
  add(std::numbers::pi / 2, 0);
  const auto at = [](std::uint32_t i, std::uint32_t j) { return j * kAround + i % kAround; };
  for (std::uint32_t i = 0; i < kAround; ++i) {
    for (std::uint32_t j = 0; j + 1 < kRings; ++j) {
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
    mesh.triangles.push_back({kRings * kAround, at(i + 1, 0), at(i, 0)});
    mesh.triangles.push_back({kRings * kAround + 1, at(i, kRings - 1), at(i + 1, kRings - 1)});
  }
  return mesh;
}

constexpr double kCrease = 30 * std::numbers::pi / 180;
constexpr double kNoCrease = std::numbers::pi;

TEST(Subdivide, KeepsACubeWhoseEdgesAreSharp) {
  const auto fine = subdivide(cube(), 3000, kCrease);
  ASSERT_TRUE(fine) << fine.error().text();
  EXPECT_EQ(fine->triangles.size(), 12U * 256);
  for (std::size_t t = 0; t < fine->triangles.size(); ++t)
    for (std::size_t c = 0; c < 3; ++c) {
      const Eigen::Vector3d& p = fine->vertices[fine->triangles[t][c]];
      const Eigen::Vector3f& n = fine->normals[fine->corner_normals[t][c]];
      // Every corner lies on the face that its normal belongs to.
      int axis = 0;
      n.cwiseAbs().maxCoeff(&axis);
      EXPECT_NEAR(std::abs(n[axis]), 1, 1e-6);
      EXPECT_NEAR(p[axis], n[axis] > 0 ? 1 : 0, 1e-12);
    }
}

TEST(Subdivide, RoundsACubeWithoutCreases) {
  const auto fine = subdivide(cube(), 3000, kNoCrease);
  ASSERT_TRUE(fine);
  for (const auto& p : fine->vertices) {
    EXPECT_GT(p.minCoeff(), 0.01);
    EXPECT_LT(p.maxCoeff(), 0.99);
  }
}

// The limit of a coarse vertex is where further subdivision takes it.
TEST(Subdivide, PutsVerticesAndNormalsOnTheLimit) {
  for (const double crease : {kNoCrease, kCrease}) {
    const Mesh mesh = crease == kCrease ? cube() : lump();
    const auto coarse = subdivide(mesh, 700, crease);
    const auto fine = subdivide(mesh, 700 * 64, crease);
    ASSERT_TRUE(coarse && fine);
    for (std::size_t v = 0; v < coarse->vertices.size(); ++v) {
      EXPECT_LT((coarse->vertices[v] - fine->vertices[v]).norm(), 1e-9);
      EXPECT_LT((coarse->normals[v] - fine->normals[v]).norm(), 1e-4F);
    }
  }
}

TEST(Subdivide, GivesNormalsThatFitTheFinerSurface) {
  const auto fine = subdivide(lump(), 40'000, kNoCrease);
  ASSERT_TRUE(fine);
  double worst = 0, square = 0;
  for (const auto& [a, b, c] : fine->triangles) {
    const Eigen::Vector3d &p = fine->vertices[a], &q = fine->vertices[b], &r = fine->vertices[c];
    const Eigen::Vector3d face = (q - p).cross(r - p).normalized();
    const Eigen::Vector3d mean =
        (fine->normals[a] + fine->normals[b] + fine->normals[c]).cast<double>().normalized();
    worst = std::max(worst, (face - mean).norm());
    square += (face - mean).squaredNorm();
  }
  EXPECT_LT(worst, 0.1);  // at the poles, where 14 edges meet and curvature has no bound
  EXPECT_LT(std::sqrt(square / static_cast<double>(fine->triangles.size())), 0.01);
}

TEST(Subdivide, TurnsAMeshOutsideOut) {
  Mesh inside_out = lump();
  for (auto& triangle : inside_out.triangles) std::swap(triangle[0], triangle[1]);
  const auto fine = subdivide(inside_out, 100, kNoCrease);
  ASSERT_TRUE(fine);
  for (std::size_t v = 0; v < fine->vertices.size(); ++v)
    EXPECT_GT(fine->vertices[v].dot(fine->normals[v].cast<double>()), 0);
}

TEST(Subdivide, RefusesWhatIsNotAClosedManifold) {
  Mesh open = cube();
  open.triangles.pop_back();
  auto answer = subdivide(open, 100, kCrease);
  ASSERT_FALSE(answer);
  EXPECT_EQ(answer.error().code, Code::invalid);
  EXPECT_THAT(answer.error().what, HasSubstr("not closed: 3 edges"));

  Mesh turned = cube();
  std::swap(turned.triangles[4][0], turned.triangles[4][1]);
  answer = subdivide(turned, 100, kCrease);
  ASSERT_FALSE(answer);
  EXPECT_THAT(answer.error().what, HasSubstr("face opposite ways"));

  Mesh fin = cube();
  fin.vertices_mm.emplace_back(-1, -1, 2);
  fin.triangles.push_back({0, 1, 8});
  answer = subdivide(fin, 100, kCrease);
  ASSERT_FALSE(answer);
  EXPECT_THAT(answer.error().what, HasSubstr("triangles meet at the edge"));

  Mesh two = cube();  // a second cube that touches the first in one vertex
  const Mesh other = cube();
  for (std::size_t v = 0; v + 1 < 8; ++v)
    two.vertices_mm.push_back(other.vertices_mm[v] - Eigen::Vector3d(1, 1, 1));
  for (auto triangle : other.triangles) {
    for (auto& corner : triangle) corner = corner == 7 ? 0 : corner + 8;
    two.triangles.push_back(triangle);
  }
  answer = subdivide(two, 100, kCrease);
  ASSERT_FALSE(answer);
  EXPECT_THAT(answer.error().what, HasSubstr("touch in vertex"));

  Mesh few;
  few.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  few.triangles = {{0, 1, 2}};
  EXPECT_FALSE(subdivide(few, 100, kCrease));
  EXPECT_FALSE(subdivide(cube(), 30'000'000, kCrease));
}

}  // namespace
}  // namespace alhazen::sim
