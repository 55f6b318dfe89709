#include "reconstruct/report/compare.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <random>

#include "reconstruct/report/triangle_tree.h"
#include "tests/unit/report/shapes.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

/// Enough for shares to 3e-3; more would only take longer under sanitizers.
constexpr CompareOptions kFew{.samples = 30'000, .seed = 1};

/// Another way to the same distance: plane's foot point where it lies inside, else the edges.
double distance_by_hand(const Vector3d& p, const std::array<Vector3d, 3>& corner) {
  double best = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < 3; ++k) {
    const Vector3d& a = corner[k];
    const Vector3d ab = corner[(k + 1) % 3] - a;
    const double t =
        ab.squaredNorm() > 0 ? std::clamp((p - a).dot(ab) / ab.squaredNorm(), 0.0, 1.0) : 0;
    best = std::min(best, (a + t * ab - p).norm());
  }
  const Vector3d n = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  if (n.norm() == 0) return best;
  const Vector3d foot = p - n * (n.dot(p - corner[0]) / n.squaredNorm());
  for (std::size_t k = 0; k < 3; ++k) {
    if (n.dot((corner[(k + 1) % 3] - corner[k]).cross(foot - corner[k])) < 0) return best;
  }
  return std::min(best, (foot - p).norm());
}

TEST(TriangleTree, AgreesWithBruteForce) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto point = [&] { return Vector3d(uniform(random), uniform(random), uniform(random)); };
  Mesh soup;
  for (std::uint32_t t = 0; t < 400; ++t) {
    const Vector3d a = point();
    const double size = t % 10 == 0 ? 1.0 : 0.1;
    soup.vertices_mm.push_back(a);
    soup.vertices_mm.push_back(a + size * point());
    // Every seventh has no area: a line or a point.
    soup.vertices_mm.push_back(t % 7 == 0    ? 2 * soup.vertices_mm.back() - a
                               : t % 14 == 3 ? a
                                             : Vector3d(a + size * point()));
    if (t % 49 == 0) soup.vertices_mm[3 * t + 1] = soup.vertices_mm[3 * t + 2] = a;
    soup.triangles.push_back({3 * t, 3 * t + 1, 3 * t + 2});
  }
  const TriangleTree tree(soup);
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p = 1.5 * point();
    double best = std::numeric_limits<double>::infinity();
    for (const auto& [a, b, c] : soup.triangles)
      best = std::min(best, distance_by_hand(p, {soup.vertices_mm[a], soup.vertices_mm[b],
                                                 soup.vertices_mm[c]}));
    const auto nearest = tree.nearest(p);
    ASSERT_TRUE(nearest);
    EXPECT_NEAR(nearest->distance_mm, best, 1e-12);
    EXPECT_NEAR((nearest->point_mm - p).norm(), best, 1e-12);
    EXPECT_NEAR(nearest->weights.sum(), 1, 1e-12);
    EXPECT_TRUE(tree.nearest(p, best + 1e-9));
    EXPECT_FALSE(tree.nearest(p, best - 1e-9));
  }
}

TEST(TriangleTree, OfNothingFindsNothing) {
  EXPECT_FALSE(TriangleTree(Mesh{}).nearest(Vector3d::Zero()));
}

TEST(Compare, PlanePatchesAreExact) {
  const Mesh reference = plane_mesh(10, 0, 7);
  Mesh mesh = plane_mesh(10, 0.25, 20);
  const auto comparison = compare(mesh, reference, kFew, {});
  ASSERT_TRUE(comparison) << comparison.error().text();
  EXPECT_NEAR(comparison->all.rms_mm, 0.25, 1e-12);
  EXPECT_NEAR(comparison->all.p90_mm, 0.25, 1e-12);
  EXPECT_NEAR(comparison->hausdorff_mm, 0.25, 1e-12);
  EXPECT_NEAR(comparison->bias_mm, 0.25, 1e-7);
  EXPECT_EQ(comparison->completeness_0_3mm, 1.0);
  ASSERT_TRUE(comparison->observed);
  EXPECT_EQ(comparison->observed->count, 21U * 21U);
  ASSERT_TRUE(comparison->observed_normals);
  EXPECT_EQ(comparison->observed_normals->mean_deg, 0.0);

  // Half the mesh observed: half the reference is complete, but for 0.3 mm beyond the border.
  mesh = plane_mesh(10, 0, 20);
  for (const auto& p : mesh.vertices_mm) mesh.observed.push_back(p.x() <= 5 ? 1 : 0);
  const auto half = compare(mesh, reference, kFew, {});
  ASSERT_TRUE(half) << half.error().text();
  EXPECT_NEAR(half->completeness_0_3mm, 0.53, 3e-3);
  EXPECT_EQ(half->coverage_1mm, 1.0);
  EXPECT_EQ(half->observed->count, 11U * 21U);
  EXPECT_EQ(half->all.count, 21U * 21U);

  // A mesh that ends earlier than the reference: what is missing shows one way only.
  const auto small = compare(plane_mesh(4, 0, 4), reference, kFew, {});
  ASSERT_TRUE(small) << small.error().text();
  EXPECT_NEAR(small->all.max_mm, 0.0, 1e-12);
  EXPECT_NEAR(small->reference_to_mesh.max_mm, 6 * std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(small->hausdorff_mm, 6 * std::sqrt(2.0), 1e-12);
  // Within 1 mm of [0, 4]²: the square, two strips and a quarter circle.
  const double quarter_circle = 0.25 * 3.14159265358979;
  EXPECT_NEAR(small->coverage_1mm, (16 + 8 + quarter_circle) / 100, 3e-3);
}

TEST(Compare, SignOfACubeIsRightAtFacesEdgesAndCorners) {
  const Mesh cube = cube_mesh(2);
  Mesh points;  // any triangles: only the vertices count
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1, 3);
  for (int i = 0; i < 3000; ++i)
    points.vertices_mm.emplace_back(uniform(random), uniform(random), uniform(random));
  points.triangles = {{0, 1, 2}};
  const auto comparison = compare(points, cube, {.samples = 1000, .seed = 1}, {});
  ASSERT_TRUE(comparison) << comparison.error().text();
  for (std::size_t i = 0; i < points.vertices_mm.size(); ++i) {
    const Vector3d q = (points.vertices_mm[i] - Vector3d::Ones()).cwiseAbs() - Vector3d::Ones();
    const double expected = q.cwiseMax(0).norm() + std::min(q.maxCoeff(), 0.0);
    EXPECT_NEAR(static_cast<double>(comparison->signed_mm[i]), expected, 1e-6);
  }
}

TEST(Compare, OffsetSphereHasTheKnownDistribution) {
  // A sphere against itself moved by δ: distances |δ cos θ|, uniform in cos θ.
  const double shift = 0.1;
  const Mesh reference = sphere_mesh(10, {0, 0, 0}, 6);
  const Mesh mesh = sphere_mesh(10, {0, 0, shift}, 5);
  const auto comparison = compare(mesh, reference, kFew, {});
  ASSERT_TRUE(comparison) << comparison.error().text();
  EXPECT_NEAR(comparison->all.rms_mm, shift / std::sqrt(3.0), 1e-3);
  EXPECT_NEAR(comparison->all.p90_mm, 0.9 * shift, 2e-3);
  EXPECT_NEAR(comparison->all.p99_mm, 0.99 * shift, 2e-3);
  EXPECT_NEAR(comparison->all.max_mm, shift, 1e-3);
  EXPECT_NEAR(comparison->reference_to_mesh.rms_mm, shift / std::sqrt(3.0), 2e-3);
  EXPECT_NEAR(comparison->bias_mm, 0, 1e-3);
  // Normals differ by δ sin θ / r: mean π/4 δ/r.
  ASSERT_TRUE(comparison->observed_normals);
  EXPECT_NEAR(comparison->observed_normals->mean_deg, 57.29578 * 0.785398 * shift / 10, 0.01);
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    EXPECT_NEAR(static_cast<double>(comparison->signed_mm[i]), mesh.vertices_mm[i].norm() - 10,
                2e-3);
  }
}

TEST(Compare, DoesNotDependOnThreadsAndRepeats) {
  const Mesh reference = sphere_mesh(10, {0, 0, 0}, 6);
  Mesh mesh = sphere_mesh(10.01, {0.02, 0, 0}, 4);
  mesh.observed.assign(mesh.vertices_mm.size(), 1);
  const auto many = compare(mesh, reference, kFew, {});
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const auto single = compare(mesh, reference, kFew, {});
  ASSERT_TRUE(many && single);
  EXPECT_EQ(many->signed_mm, single->signed_mm);
  EXPECT_EQ(many->observed->rms_mm, single->observed->rms_mm);
  EXPECT_EQ(many->completeness_0_3mm, single->completeness_0_3mm);
  EXPECT_EQ(many->reference_to_mesh.rms_mm, single->reference_to_mesh.rms_mm);
  EXPECT_EQ(many->observed_normals->p90_deg, single->observed_normals->p90_deg);
}

TEST(Compare, RefusesWhatCannotBeCompared) {
  const Mesh cube = cube_mesh(1);
  const auto fails = [&](const Mesh& mesh, const Mesh& reference, CompareOptions options,
                         const char* what) {
    const auto comparison = compare(mesh, reference, options, {});
    ASSERT_FALSE(comparison);
    EXPECT_EQ(comparison.error().code, Code::invalid);
    EXPECT_THAT(comparison.error().what, HasSubstr(what));
  };
  fails({}, cube, {}, "the mesh has no triangles");
  fails(cube, {}, {}, "the reference has no triangles");
  fails(cube, cube, {.samples = 999, .seed = 1}, "1000");
  Mesh wrong = cube;
  wrong.vertices_mm[3].x() = std::numeric_limits<double>::quiet_NaN();
  fails(wrong, cube, {}, "1e9");
  wrong = cube;
  wrong.triangles[0][1] = 8;
  fails(cube, wrong, {}, "out of range");
  wrong = cube;
  wrong.observed = {1, 1};
  fails(wrong, cube, {}, "2 values");
  std::stop_source stop;
  stop.request_stop();
  const auto stopped = compare(cube, cube, {}, {.stop = stop.get_token(), .progress = {}});
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, Code::cancelled);
}

TEST(Compare, NothingObservedHasNoObservedFigures) {
  Mesh mesh = cube_mesh(1);
  mesh.observed.assign(8, 0);
  const auto comparison = compare(mesh, cube_mesh(1), kFew, {});
  ASSERT_TRUE(comparison) << comparison.error().text();
  EXPECT_FALSE(comparison->observed);
  EXPECT_FALSE(comparison->observed_normals);
  EXPECT_EQ(comparison->completeness_0_3mm, 0.0);
  EXPECT_EQ(comparison->coverage_1mm, 1.0);
}

TEST(CompareSphere, FindsTheCentreWhateverPartIsSeen) {
  const Vector3d centre(3, -4, 20);
  Mesh mesh = sphere_mesh(25, centre, 4);
  auto whole = compare_sphere(mesh, 25);
  ASSERT_TRUE(whole) << whole.error().text();
  EXPECT_LT((whole->all.centre_mm - centre).norm(), 1e-9);
  EXPECT_LT(whole->all.distances.max_mm, 1e-9);

  // Radius 10 µm too large, whole sphere: distances are exactly that.
  whole = compare_sphere(mesh, 25.01);
  ASSERT_TRUE(whole);
  EXPECT_NEAR(whole->all.distances.rms_mm, 0.01, 1e-6);

  // A cap is enough, and what is not observed does not count.
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    const bool is_cap = mesh.normals[i].z() > 0.7F;
    mesh.observed.push_back(is_cap ? 1 : 0);
    if (!is_cap) mesh.vertices_mm[i] *= 1.05;
  }
  const auto cap = compare_sphere(mesh, 25);
  ASSERT_TRUE(cap) << cap.error().text();
  ASSERT_TRUE(cap->observed);
  EXPECT_LT((cap->observed->centre_mm - centre).norm(), 1e-6);
  EXPECT_LT(cap->observed->distances.max_mm, 1e-6);
  EXPECT_GT(cap->all.distances.rms_mm, 0.1);
}

TEST(CompareSphere, RefusesWhatHasNoCentre) {
  Mesh mesh = sphere_mesh(25, {0, 0, 0}, 1);
  for (const double radius : {0.0, -1.0, std::numeric_limits<double>::infinity(),
                              std::numeric_limits<double>::quiet_NaN()})
    EXPECT_FALSE(compare_sphere(mesh, radius));
  mesh.vertices_mm.resize(3);
  EXPECT_FALSE(compare_sphere(mesh, 25));
}

}  // namespace
}  // namespace alhazen
