#include "reconstruct/mesh/clean.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "reconstruct/mesh/contour.h"
#include "tests/unit/surface/scene.h"

namespace alhazen {
namespace {

Mesh tetrahedron(const Eigen::Vector3d& at_mm, double size_mm) {
  Mesh mesh;
  mesh.vertices_mm = {at_mm, at_mm + size_mm * Eigen::Vector3d::UnitX(),
                      at_mm + size_mm * Eigen::Vector3d::UnitY(),
                      at_mm + size_mm * Eigen::Vector3d::UnitZ()};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  return mesh;
}

void append(Mesh& mesh, const Mesh& other) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices_mm.size());
  mesh.vertices_mm.insert(mesh.vertices_mm.end(), other.vertices_mm.begin(),
                          other.vertices_mm.end());
  for (const auto& t : other.triangles)
    mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
}

Mesh ball(double radius_mm, int level) {
  const Octree octree = Octree::uniform(Volume{}, level);
  std::vector<float> value(octree.size());
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Eigen::Vector3d r = octree.centre_mm(i) - octree.volume().centre_mm;
    value[i] = static_cast<float>(r.norm() - radius_mm);
  }
  return *contour(octree, value, {});
}

TEST(CheckClosed, CountsEachFault) {
  const Mesh good = tetrahedron({1, 2, 3}, 6);
  const MeshCheck check = check_closed(good);
  EXPECT_TRUE(check.closed());
  EXPECT_EQ(check.euler, 2);
  EXPECT_EQ(check.components, 1U);
  EXPECT_NEAR(check.volume_mm3, 36, 1e-9);
  EXPECT_NEAR(check.area_mm2, 3 * 18 + std::sqrt(3.0) / 4 * 72, 1e-9);

  Mesh open = good;
  open.triangles.pop_back();
  EXPECT_EQ(check_closed(open).boundary_edges, 3U);

  Mesh turned = good;
  std::swap(turned.triangles[0][0], turned.triangles[0][1]);
  EXPECT_EQ(check_closed(turned).inconsistent_edges, 3U);
  EXPECT_FALSE(check_closed(turned).closed());

  Mesh doubled = good;
  doubled.triangles.push_back(good.triangles[1]);
  EXPECT_EQ(check_closed(doubled).non_manifold_edges, 3U);

  Mesh touching = good;  // two tetrahedra that share a corner
  append(touching, tetrahedron({1, 2, 3}, -6));
  touching.triangles[4] = {0, 5, 6};
  for (std::size_t t = 4; t < 8; ++t)
    for (std::uint32_t& v : touching.triangles[t])
      if (v == 4) v = 0;
  const MeshCheck both = check_closed(touching);
  EXPECT_EQ(both.non_manifold_vertices, 1U);
  EXPECT_EQ(both.unused_vertices, 1U);
  EXPECT_FALSE(both.closed());

  Mesh flat = good;
  flat.vertices_mm[3] = 0.5 * (flat.vertices_mm[1] + flat.vertices_mm[2]);
  EXPECT_EQ(check_closed(flat).degenerate_triangles, 1U);
  flat.vertices_mm[3].x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_GE(check_closed(flat).degenerate_triangles, 1U);
}

TEST(Clean, DropsWhatFloatsAndWhatIsTurnedInward) {
  Mesh mesh = tetrahedron({0, 0, 0}, 10);
  append(mesh, tetrahedron({20, 0, 0}, 1));  // a thousandth of the volume
  append(mesh, tetrahedron({40, 0, 0}, 8));
  Mesh hollow = tetrahedron({2, 2, 2}, 5);
  for (auto& t : hollow.triangles) std::swap(t[0], t[1]);
  append(mesh, hollow);
  mesh.consistency.resize(mesh.vertices_mm.size());
  for (std::size_t v = 0; v < mesh.consistency.size(); ++v)
    mesh.consistency[v] = static_cast<float>(v);
  const Result<Mesh> cleaned = clean(mesh, {});
  ASSERT_TRUE(cleaned);
  EXPECT_EQ(cleaned->triangles.size(), 8U);
  EXPECT_EQ(cleaned->vertices_mm.size(), 8U);
  // Lists go with their vertices: the third tetrahedron's follow the first's.
  EXPECT_EQ(cleaned->consistency, (std::vector<float>{0, 1, 2, 3, 8, 9, 10, 11}));
  EXPECT_TRUE(check_closed(*cleaned).closed());
  const Result<Mesh> with_void = clean(mesh, {.drop_voids = false});
  EXPECT_EQ(with_void->triangles.size(), 12U);
}

TEST(Clean, RemovesShortEdgesAndNeedlesAndStaysOnTheSurface) {
  const double edge_mm = Volume{}.edge_mm / 64;
  const Mesh rough = ball(30, 6);
  const Result<Mesh> cleaned = clean(rough, {.min_edge_mm = 0.25 * edge_mm});
  ASSERT_TRUE(cleaned);
  const MeshCheck check = check_closed(*cleaned);
  EXPECT_TRUE(check.closed());
  EXPECT_EQ(check.euler, 2);
  // Triangles whose height is below a tenth of their longest side.
  const auto needles = [](const Mesh& mesh) {
    std::size_t count = 0;
    for (const auto& t : mesh.triangles) {
      const Eigen::Vector3d &a = mesh.vertices_mm[t[0]], &b = mesh.vertices_mm[t[1]],
                            &c = mesh.vertices_mm[t[2]];
      const double longest = std::max({(a - b).norm(), (b - c).norm(), (c - a).norm()});
      count += (b - a).cross(c - a).norm() < 0.1 * longest * longest ? 1 : 0;
    }
    return count;
  };
  EXPECT_GT(needles(rough), 500U);
  EXPECT_LT(needles(*cleaned), needles(rough) / 5);
  double worst_mm = 0;
  for (std::size_t v = 0; v < cleaned->vertices_mm.size(); ++v) {
    const Eigen::Vector3d r = cleaned->vertices_mm[v] - Volume{}.centre_mm;
    worst_mm = std::max(worst_mm, std::abs(r.norm() - 30));
    EXPECT_GT(cleaned->normals[v].cast<double>().dot(r.normalized()), 0.999);
  }
  EXPECT_LT(worst_mm, 3e-3);  // sagitta of what was collapsed: (L²/8R) per round
}

TEST(Clean, RefusesBadOptionsAndBrokenMeshes) {
  const Mesh good = tetrahedron({0, 0, 0}, 1);
  EXPECT_EQ(clean(good, {.min_component_share = 2}).error().code, Code::invalid);
  EXPECT_EQ(clean(good, {.min_edge_mm = -1}).error().code, Code::invalid);
  EXPECT_EQ(clean(good, {.min_edge_mm = std::numeric_limits<double>::quiet_NaN()}).error().code,
            Code::invalid);
  Mesh broken = good;
  broken.triangles[2][1] = 4;
  EXPECT_EQ(clean(broken, {}).error().code, Code::invalid);
  EXPECT_EQ(clean(Mesh{}, {}).error().code, Code::conflict);
}

TEST(SetNormals, PointOutward) {
  Mesh mesh = ball(20, 5);
  set_normals(mesh);
  for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
    const Eigen::Vector3d out = (mesh.vertices_mm[v] - Volume{}.centre_mm).normalized();
    EXPECT_NEAR(mesh.normals[v].norm(), 1, 1e-5);
    EXPECT_GT(mesh.normals[v].cast<double>().dot(out), 0.98);
  }
}

}  // namespace
}  // namespace alhazen
