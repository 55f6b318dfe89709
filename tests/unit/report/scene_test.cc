#include "reconstruct/report/scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>

#include "tests/unit/report/shapes.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;

/// What a reader of scene.h's words gets back, written apart from both the writer and the page.
struct Read {
  std::vector<Vector3d> places_mm, normals;
  std::vector<std::vector<int>> shares;  ///< one list for each colouring with stops
  std::vector<std::array<std::uint32_t, 3>> triangles;
  bool is_whole = false;
};

Read read(const Scene& scene) {
  const auto facts = nlohmann::json::parse(scene.facts);
  std::size_t at = 0;
  const auto byte = [&] {
    return at < scene.data.size() ? static_cast<unsigned char>(scene.data[at++]) : 0U;
  };
  const auto two_bytes = [&] {
    const unsigned low = byte();
    return low + 256 * byte();
  };
  Read out;
  const auto count = facts["vertices"].get<std::size_t>();
  for (std::size_t i = 0; i < count; ++i) {
    Vector3d p;
    for (int k = 0; k < 3; ++k)
      p[k] = facts["low_mm"][static_cast<std::size_t>(k)].get<double>() +
             facts["step_mm"][static_cast<std::size_t>(k)].get<double>() * two_bytes();
    out.places_mm.push_back(p);
  }
  for (std::size_t i = 0; i < count; ++i) {
    const auto signed_share = [&] {
      const unsigned raw = two_bytes();
      return (raw < 32768 ? static_cast<double>(raw) : static_cast<double>(raw) - 65536) / 32767;
    };
    const double x = signed_share(), y = signed_share(), z = 1 - std::abs(x) - std::abs(y);
    // On the folded half, x and y are mirrored at the octahedron's edge.
    const Vector3d n = z >= 0 ? Vector3d(x, y, z)
                              : Vector3d((x < 0 ? -1 : 1) * (1 - std::abs(y)),
                                         (y < 0 ? -1 : 1) * (1 - std::abs(x)), z);
    out.normals.push_back(n.normalized());
  }
  for (const auto& colouring : facts["colourings"]) {
    if (colouring["stops"].empty()) continue;
    out.shares.emplace_back();
    for (std::size_t i = 0; i < count; ++i) out.shares.back().push_back(static_cast<int>(byte()));
  }
  std::uint32_t named = 0;
  out.triangles.resize(facts["triangles"].get<std::size_t>());
  for (auto& triangle : out.triangles) {
    for (auto& corner : triangle) {
      std::uint32_t below = 0, part = 0x80;
      for (unsigned shift = 0; (part & 0x80) != 0; shift += 7) {
        part = byte();
        below |= (part & 0x7f) << shift;
      }
      corner = named - below;
      if (below == 0) ++named;
    }
  }
  out.is_whole = at == scene.data.size() && named == count;
  return out;
}

std::vector<std::array<std::uint32_t, 3>> in_the_original(const DisplayMesh& shown) {
  std::vector<std::array<std::uint32_t, 3>> out;
  for (const auto& [a, b, c] : shown.triangles)
    out.push_back({shown.source[a], shown.source[b], shown.source[c]});
  return out;
}

TEST(Simplified, LeavesASmallMeshAlone) {
  const Mesh mesh = sphere_mesh(10, {1, 2, 3}, 3);
  const DisplayMesh shown = simplified(mesh, mesh.triangles.size());
  EXPECT_EQ(shown.cell_mm, 0);
  EXPECT_EQ(shown.source.size(), mesh.vertices_mm.size());
  EXPECT_EQ(in_the_original(shown), mesh.triangles);
}

TEST(Simplified, KeepsTheBoundAndStaysWithinACell) {
  const Vector3d centre_mm(1, 2, 3);
  const Mesh mesh = sphere_mesh(10, centre_mm, 5);  // 20480 triangles
  for (const std::size_t bound : {20000U, 10000U, 1000U, 100U}) {
    const DisplayMesh shown = simplified(mesh, bound);
    EXPECT_LE(shown.triangles.size(), bound);
    EXPECT_GT(shown.triangles.size(), bound / 4) << "far coarser than asked for";
    ASSERT_GT(shown.cell_mm, 0);
    for (const Vector3d& p : mesh.vertices_mm) {
      double nearest_mm = std::numeric_limits<double>::infinity();
      for (const std::uint32_t source : shown.source)
        nearest_mm = std::min(nearest_mm, (mesh.vertices_mm[source] - p).cwiseAbs().maxCoeff());
      EXPECT_LE(nearest_mm, shown.cell_mm * (1 + 1e-12)) << bound;
    }
    // Still a sphere, turned outward: the volume is that of a coarser one inside the same radius.
    double volume_mm3 = 0;
    for (const auto& [a, b, c] : in_the_original(shown))
      volume_mm3 +=
          (mesh.vertices_mm[a] - centre_mm)
              .dot((mesh.vertices_mm[b] - centre_mm).cross(mesh.vertices_mm[c] - centre_mm)) /
          6;
    const double ball_mm3 = 4.0 / 3 * 3.14159265 * 1000;
    EXPECT_LT(volume_mm3, ball_mm3);
    EXPECT_GT(volume_mm3, (1 - 0.1 * shown.cell_mm) * ball_mm3);
  }
}

TEST(Simplified, EndsOnWhatHasNoSize) {
  EXPECT_TRUE(simplified({}, 0).triangles.empty());
  Mesh point;
  point.vertices_mm.assign(3, Vector3d(4, 5, 6));
  point.triangles = {{0, 1, 2}, {0, 2, 1}};
  EXPECT_TRUE(simplified(point, 1).triangles.empty());
  const Mesh cube = cube_mesh(5);
  EXPECT_TRUE(simplified(cube, 0).triangles.empty());
}

TEST(Scene, GivesTheMeshBack) {
  Mesh mesh = sphere_mesh(10, {-100, 250, 3}, 4);
  std::mt19937 random(7);
  std::uniform_real_distribution<float> any(0, 1);
  Colouring surface, error;
  surface.name = "</script><b>";
  error.stops = {kClay, kUnobserved};
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i)
    error.share.push_back(i % 5 == 0 ? std::numeric_limits<float>::quiet_NaN() : any(random));
  const std::vector<Colouring> colourings{surface, error, error};

  for (const std::size_t bound : {100000U, 3000U}) {
    const DisplayMesh shown = simplified(mesh, bound);
    const Scene scene = scene_of(mesh, shown, colourings);
    EXPECT_EQ(scene.facts.find('<'), std::string::npos);
    EXPECT_EQ(nlohmann::json::parse(scene.facts)["colourings"][0]["name"], "</script><b>");
    const Read back = read(scene);
    ASSERT_TRUE(back.is_whole);
    EXPECT_EQ(back.triangles, shown.triangles);
    ASSERT_EQ(back.shares.size(), 2U);
    ASSERT_EQ(back.places_mm.size(), shown.source.size());
    for (std::size_t i = 0; i < shown.source.size(); ++i) {
      const std::uint32_t source = shown.source[i];
      EXPECT_LE((back.places_mm[i] - mesh.vertices_mm[source]).cwiseAbs().maxCoeff(),
                20.0 / 65535 / 2 * (1 + 1e-6));
      EXPECT_LT((back.normals[i] - mesh.normals[source].cast<double>()).norm(), 1e-4);
      const float share = error.share[source];
      if (std::isnan(share)) {
        EXPECT_EQ(back.shares[0][i], 255);
      } else {
        EXPECT_NEAR(back.shares[0][i] / 254.0, static_cast<double>(share), 0.5 / 254 + 1e-6);
      }
      EXPECT_EQ(back.shares[0][i], back.shares[1][i]);
    }
  }

  // Normals that a file did not have are those of the triangles.
  mesh.normals.clear();
  const Read back = read(scene_of(mesh, simplified(mesh, 100000), colourings));
  for (std::size_t i = 0; i < back.normals.size(); ++i)
    EXPECT_GT(back.normals[i].dot((back.places_mm[i] - Vector3d(-100, 250, 3)).normalized()),
              0.999);
}

TEST(Scene, OfAFlatMeshHasFiniteFacts) {
  const Mesh plane = plane_mesh(10, 4, 3);
  const Read back = read(scene_of(plane, simplified(plane, 100), {}));
  ASSERT_TRUE(back.is_whole);
  for (const Vector3d& p : back.places_mm) EXPECT_EQ(p.z(), 4);
}

}  // namespace
}  // namespace alhazen
