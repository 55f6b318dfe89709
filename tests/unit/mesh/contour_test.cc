#include "reconstruct/mesh/contour.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "reconstruct/mesh/clean.h"
#include "reconstruct/mesh/cube_table.h"
#include "tests/unit/surface/scene.h"

namespace alhazen {
namespace {

using scene::kVolume;
using scene::refined_near;
constexpr double kPi = std::numbers::pi;

std::vector<float> sampled(const Octree& octree, const scene::Distance& f) {
  std::vector<float> value(octree.size());
  for (std::size_t i = 0; i < octree.size(); ++i)
    value[i] = static_cast<float>(f(octree.centre_mm(i)));
  return value;
}

double sphere(const Eigen::Vector3d& p) { return (p - kVolume.centre_mm).norm() - 20.3; }
double torus(const Eigen::Vector3d& p) {
  const Eigen::Vector3d q = p - kVolume.centre_mm;
  return std::hypot(std::hypot(q.x(), q.y()) - 18.2, q.z()) - 7.1;
}
double two_balls(const Eigen::Vector3d& p) {
  const Eigen::Vector3d q = p - kVolume.centre_mm;
  return std::min((q - Eigen::Vector3d(12, 1, 2)).norm() - 9.2,
                  (q + Eigen::Vector3d(11, 3, 0)).norm() - 8.7);
}

TEST(CubeTable, CutsEveryCrossedEdgeOnceAndTriangulatesEveryLoop) {
  for (int inside = 0; inside < 256; ++inside) {
    std::array<int, 12> uses{};
    for (const CubePattern::Loop& loop : cube_table()[static_cast<std::size_t>(inside)].loops) {
      EXPECT_GE(loop.edges.size(), 3U);
      EXPECT_FALSE(loop.triangulations.empty()) << inside;
      for (const std::uint8_t edge : loop.edges) ++uses[edge];
      for (const auto& triangles : loop.triangulations)
        EXPECT_EQ(triangles.size(), loop.edges.size() - 2);
    }
    for (int edge = 0; edge < 12; ++edge) {
      const int low = low_corner(edge), high = low | 1 << (edge / 4);
      const bool is_crossed = ((inside >> low) & 1) != ((inside >> high) & 1);
      EXPECT_EQ(uses[static_cast<std::size_t>(edge)], is_crossed ? 1 : 0) << inside << " " << edge;
    }
  }
}

TEST(Contour, SphereIsClosedOutwardAndWithinATenthOfAPercentOfALeaf) {
  const Octree octree = refined_near(sphere, 3, 6, 3);  // leaves of 1 mm
  const Result<Mesh> mesh = contour(octree, sampled(octree, sphere), {});
  ASSERT_TRUE(mesh) << mesh.error().text();
  const MeshCheck check = check_closed(*mesh);
  EXPECT_TRUE(check.closed());
  EXPECT_EQ(check.euler, 2);
  EXPECT_EQ(check.components, 1U);
  EXPECT_EQ(check.unused_vertices, 0U);
  // The volume of the inscribed polyhedron: chords of 1 mm lose about h²/(4R²) of it at most.
  EXPECT_NEAR(check.volume_mm3, 4 * kPi / 3 * std::pow(20.3, 3), 1.5e-3 * check.volume_mm3);
  double worst_mm = 0, worst_rad = 0;
  for (std::size_t v = 0; v < mesh->vertices_mm.size(); ++v) {
    worst_mm = std::max(worst_mm, std::abs(sphere(mesh->vertices_mm[v])));
    const Eigen::Vector3d normal = (mesh->vertices_mm[v] - kVolume.centre_mm).normalized();
    worst_rad = std::max(worst_rad, (mesh->normals[v].cast<double>() - normal).norm());
  }
  // Linear interpolation along grid edges would err by h²κ/8 = 6 µm.
  EXPECT_LT(worst_mm, 1e-4);
  EXPECT_LT(worst_rad, 2e-3);
}

TEST(Contour, TorusAndTwoBallsHaveTheirTopology) {
  {
    const Octree octree = refined_near(torus, 3, 6, 3);
    const Result<Mesh> mesh = contour(octree, sampled(octree, torus), {});
    ASSERT_TRUE(mesh);
    const MeshCheck check = check_closed(*mesh);
    EXPECT_TRUE(check.closed());
    EXPECT_EQ(check.euler, 0);
    EXPECT_NEAR(check.volume_mm3, 2 * kPi * kPi * 18.2 * 7.1 * 7.1, 5e-3 * check.volume_mm3);
  }
  {
    const Octree octree = refined_near(two_balls, 3, 6, 3);
    const Result<Mesh> mesh = contour(octree, sampled(octree, two_balls), {});
    ASSERT_TRUE(mesh);
    const MeshCheck check = check_closed(*mesh);
    EXPECT_TRUE(check.closed());
    EXPECT_EQ(check.euler, 4);
    EXPECT_EQ(check.components, 2U);
  }
}

// The strong one: whatever the signs, also at level transitions and at the volume's boundary.
TEST(Contour, NoiseGivesAClosedManifoldMesh) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(-1, 1);
    Octree octree = Octree::uniform(kVolume, 2);
    for (int round = 0; round < 2; ++round) {
      std::vector<std::uint8_t> target(octree.size());
      for (std::size_t i = 0; i < octree.size(); ++i)
        target[i] = static_cast<std::uint8_t>(random() % 4 == 0 ? 3 + round : 2);
      octree = octree.adapted(target);
    }
    if (seed % 2 == 1) octree = Octree::uniform(kVolume, 4);
    std::vector<float> value(octree.size());
    const float bias = 0.2F * static_cast<float>(seed % 5) - 0.4F;
    for (float& v : value)
      v = seed % 3 == 0 ? (uniform(random) + bias < 0 ? -1.0F : 1.0F) : uniform(random) + bias;
    const Result<Mesh> mesh = contour(octree, value, {});
    ASSERT_TRUE(mesh);
    const MeshCheck check = check_closed(*mesh);
    EXPECT_EQ(check.boundary_edges, 0U) << seed;
    EXPECT_EQ(check.non_manifold_edges, 0U) << seed;
    EXPECT_EQ(check.non_manifold_vertices, 0U) << seed;
    EXPECT_EQ(check.inconsistent_edges, 0U) << seed;
    EXPECT_EQ(check.degenerate_triangles, 0U) << seed;
    EXPECT_EQ(check.unused_vertices, 0U) << seed;
    EXPECT_GT(check.volume_mm3, 0) << seed;

    // And cleaning keeps it so.
    const Result<Mesh> cleaned =
        clean(*mesh, {.min_component_share = 0.02, .drop_voids = true, .min_edge_mm = 1.0});
    ASSERT_TRUE(cleaned);
    const MeshCheck after = check_closed(*cleaned);
    EXPECT_TRUE(after.closed()) << seed;
    EXPECT_EQ(after.unused_vertices, 0U) << seed;
    EXPECT_LT(cleaned->triangles.size(), mesh->triangles.size()) << seed;
  }
}

TEST(Contour, AnObjectThatReachesTheBoundaryIsClosedThere) {
  const Octree octree = Octree::uniform(kVolume, 3);
  const Result<Mesh> mesh = contour(octree, std::vector<float>(octree.size(), -1.0F), {});
  ASSERT_TRUE(mesh);
  const MeshCheck check = check_closed(*mesh);
  EXPECT_TRUE(check.closed());
  EXPECT_EQ(check.euler, 2);
  // A box with bevelled edges, its faces on the volume's.
  EXPECT_GT(check.volume_mm3, 0.9 * std::pow(64, 3));
  EXPECT_LT(check.volume_mm3, std::pow(64, 3));
}

TEST(Contour, IsTheSameForAnyNumberOfThreads) {
  const Octree octree = refined_near(torus, 3, 6, 3);
  const std::vector<float> value = sampled(octree, torus);
  const Mesh many = *contour(octree, value, {});
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Mesh single = *contour(octree, value, {});
  EXPECT_EQ(many.triangles, single.triangles);
  EXPECT_EQ(many.vertices_mm, single.vertices_mm);
}

TEST(Contour, RefusesWhatIsNoSurface) {
  const Octree octree = Octree::uniform(kVolume, 2);
  EXPECT_EQ(contour(octree, {1.0F}, {}).error().code, Code::invalid);
  std::vector<float> value(octree.size(), 1.0F);
  EXPECT_EQ(contour(octree, value, {}).error().code, Code::conflict);
  value[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(contour(octree, value, {}).error().code, Code::invalid);
  value[5] = -1;
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(contour(octree, value, alhazen::Run{stop.get_token(), {}}).error().code,
            Code::cancelled);
}

TEST(Annotate, TakesTheObservedNeighbour) {
  const Octree octree = Octree::uniform(kVolume, 4);
  const Mesh ball = *contour(octree, sampled(octree, sphere), {});
  LeafFacts facts{std::vector<float>(octree.size(), 0.25F),
                  std::vector<std::uint8_t>(octree.size(), 0),
                  std::vector<float>(octree.size(), 0.002F)};
  for (std::size_t i = 0; i < octree.size(); ++i)
    facts.observed[i] = octree.centre_mm(i).z() > kVolume.centre_mm.z() ? 1 : 0;
  Mesh mesh = ball;
  annotate(octree, facts, mesh);
  ASSERT_EQ(mesh.observed.size(), mesh.vertices_mm.size());
  for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
    const double z_mm = mesh.vertices_mm[v].z() - kVolume.centre_mm.z();
    if (z_mm > 0) {
      EXPECT_EQ(mesh.observed[v], 1);
    }
    if (z_mm < -4) {  // a leaf's edge
      EXPECT_EQ(mesh.observed[v], 0);
    }
    EXPECT_EQ(std::isnan(mesh.depth_sigma_mm[v]), mesh.observed[v] == 0);
    EXPECT_FLOAT_EQ(mesh.consistency[v], 0.25F);
  }
}

}  // namespace
}  // namespace alhazen
