#include "drivers/sim/shape.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "reconstruct/mesh_io/mesh_file.h"
#include "tests/unit/sim/world_file.h"

namespace alhazen::sim {
namespace {

/// Lines from all around towards the ball about `centre`.
std::vector<SightLine> random_lines(const Vec3& centre, double radius, std::size_t count) {
  std::mt19937 bits(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<SightLine> out;
  while (out.size() < count) {
    const Vec3 from(uniform(bits), uniform(bits), uniform(bits)),
        to(uniform(bits), uniform(bits), uniform(bits));
    if (from.norm() < 0.2 || to.norm() > 1) continue;
    const Vec3 origin = centre + 20 * radius * from.normalized();
    out.push_back({origin, (centre + radius * to - origin).normalized()});
  }
  return out;
}

/// Where `outside` (positive outside the surface) first changes sign along the line, by small
/// steps.
double first_crossing(const SightLine& line, double from, double to, const auto& outside) {
  constexpr int kSteps = 5000;
  for (int i = 0; i < kSteps; ++i) {
    double a = from + (to - from) * i / kSteps, b = from + (to - from) * (i + 1) / kSteps;
    if (outside(line.origin_mm + a * line.direction) > 0 &&
        outside(line.origin_mm + b * line.direction) <= 0) {
      for (int halving = 0; halving < 60; ++halving) {
        const double middle = 0.5 * (a + b);
        (outside(line.origin_mm + middle * line.direction) > 0 ? a : b) = middle;
      }
      return 0.5 * (a + b);
    }
  }
  return std::numeric_limits<double>::infinity();
}

TEST(Shape, TorusAndSphereAreHitWhereTheirEquationsSay) {
  ObjectTruth torus;
  torus.form = Form::torus;
  torus.ring_radius_mm = 24;
  torus.tube_radius_mm = 10;
  ObjectTruth sphere;
  sphere.form = Form::sphere;
  sphere.radius_mm = 25;
  const auto torus_outside = [](const Vec3& p) {
    return std::hypot(p.head<2>().norm() - 24, p.z() - 10) - 10;
  };
  const auto sphere_outside = [](const Vec3& p) { return (p - Vec3(0, 0, 25)).norm() - 25; };
  for (const bool is_torus : {true, false}) {
    const auto shape = Shape::make(is_torus ? torus : sphere);
    ASSERT_TRUE(shape);
    const double reach = is_torus ? 34 : 25;
    const Vec3 centre(0, 0, is_torus ? 10 : 25);
    const auto outside = [&](const Vec3& p) {
      return is_torus ? torus_outside(p) : sphere_outside(p);
    };
    const std::vector<SightLine> lines = random_lines(centre, 1.3 * reach, 120);
    std::vector<SurfaceHit> hits(lines.size());
    shape->intersect(lines, hits);
    int misses = 0;
    for (std::size_t i = 0; i < lines.size(); ++i) {
      const double expected = first_crossing(lines[i], 24 * reach, 28 * reach, outside);
      if (std::isinf(hits[i].distance_mm) || std::isinf(expected)) {
        // Steps may step over a graze, never the other way round.
        EXPECT_TRUE(std::isinf(expected)) << i;
        ++misses;
        continue;
      }
      EXPECT_NEAR(hits[i].distance_mm, expected, 1e-9) << i;
      EXPECT_NEAR(outside(hits[i].point_mm), 0, 1e-9);
      const double step = 1e-4;
      for (int axis = 0; axis < 3; ++axis)
        EXPECT_NEAR(hits[i].normal[axis],
                    (outside(hits[i].point_mm + step * Vec3::Unit(axis)) -
                     outside(hits[i].point_mm - step * Vec3::Unit(axis))) /
                        (2 * step),
                    1e-6);
    }
    EXPECT_LT(misses, 90);
    EXPECT_GT(misses, 0);
  }
}

TEST(Shape, TrianglesAreHitAsByLookingAtEachOne) {
  ObjectTruth block;
  block.form = Form::pits;
  block.block_mm = Vec3(20, 10, 6);
  block.pit_count = 2;
  block.pit_radius_mm = 4;
  block.pit_depth_max_mm = 4;
  block.min_triangles = 4;
  block.crease_rad = 0.5;
  const auto shape = Shape::make(block);
  ASSERT_TRUE(shape) << shape.error().text();
  const Mesh truth = shape->truth();
  const std::vector<SightLine> lines = random_lines(Vec3(0, 0, 3), 10, 40);
  std::vector<SurfaceHit> hits(lines.size());
  shape->intersect(lines, hits);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const auto& [a, b, c] : truth.triangles) {
      const Vec3 &p = truth.vertices_mm[a], along = truth.vertices_mm[b] - p,
                 across = truth.vertices_mm[c] - p;
      Eigen::Matrix3d system;
      system << along, across, -lines[i].direction;
      const Vec3 answer = system.inverse() * (lines[i].origin_mm - p);
      if (answer.x() >= 0 && answer.y() >= 0 && answer.x() + answer.y() <= 1 &&
          answer.z() < nearest)
        nearest = answer.z();
    }
    if (std::isinf(nearest))
      EXPECT_TRUE(std::isinf(hits[i].distance_mm)) << i;
    else
      EXPECT_NEAR(hits[i].distance_mm, nearest, 1e-4) << i;
    if (!std::isinf(hits[i].distance_mm)) {
      EXPECT_LT(hits[i].normal.dot(lines[i].direction), 0.3) << i;
    }
  }
  // The pits reach as deep as asked for, the sides stand on the plate.
  double lowest_floor = 6;
  for (const Vec3& p : truth.vertices_mm)
    if (std::abs(p.x() - 5) < 1 && std::abs(p.y()) < 1 && p.z() > 0.5)
      lowest_floor = std::min(lowest_floor, p.z());
  EXPECT_NEAR(lowest_floor, 2, 0.05);
}

TEST(Shape, StandsAMeshOnThePlateAtItsSize) {
  // A tetrahedron of no unit, with y up.
  Mesh mesh;
  mesh.vertices_mm = {{5, 1, 5}, {6, 1, 5}, {5, 1, 7}, {5, 3, 5}};
  mesh.triangles = {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {0, 2, 3}};
  const std::filesystem::path file =
      std::filesystem::path(testing::TempDir()) / ("shape-" + std::to_string(getpid()) + ".ply");
  ASSERT_TRUE(write_mesh(mesh, file));
  ObjectTruth object;
  object.form = Form::mesh;
  object.mesh = file;
  object.size_mm = 40;
  object.up = "y";
  object.min_triangles = 200;
  object.crease_rad = 0.5;
  const auto shape = Shape::make(object);
  std::filesystem::remove(file);
  ASSERT_TRUE(shape) << shape.error().text();
  const Mesh truth = shape->truth();
  Vec3 low = Vec3::Constant(1e9), high = -low;
  for (const Vec3& p : truth.vertices_mm) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  EXPECT_NEAR(low.z(), 0, 1e-9);
  EXPECT_NEAR(high.z(), 40, 1e-9);
  EXPECT_NEAR((high - low).maxCoeff(), 40, 1e-9);
  EXPECT_NEAR(low.x() + high.x(), 0, 1e-9);
  EXPECT_NEAR(low.y() + high.y(), 0, 1e-9);
  double volume = 0;
  for (const auto& [a, b, c] : truth.triangles)
    volume += truth.vertices_mm[a].dot(truth.vertices_mm[b].cross(truth.vertices_mm[c])) / 6;
  EXPECT_GT(volume, 0);

  object.mesh = "/nowhere.ply";
  EXPECT_FALSE(Shape::make(object));
  object.mesh.clear();
  const auto none = Shape::make(object);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, Code::invalid);
}

TEST(Shape, TruthOfSphereAndTorusIsClosedAndExact) {
  for (const Form form : {Form::sphere, Form::torus}) {
    ObjectTruth object;
    object.form = form;
    object.radius_mm = 25;
    object.ring_radius_mm = 24;
    object.tube_radius_mm = 10;
    const auto shape = Shape::make(object);
    ASSERT_TRUE(shape);
    const Mesh truth = shape->truth();
    double volume = 0, sagitta = 0;
    for (const auto& [a, b, c] : truth.triangles) {
      volume += truth.vertices_mm[a].dot(truth.vertices_mm[b].cross(truth.vertices_mm[c])) / 6;
      const Vec3 middle = (truth.vertices_mm[a] + truth.vertices_mm[b] + truth.vertices_mm[c]) / 3;
      const double outside = form == Form::sphere
                                 ? (middle - Vec3(0, 0, 25)).norm() - 25
                                 : std::hypot(middle.head<2>().norm() - 24, middle.z() - 10) - 10;
      sagitta = std::max(sagitta, std::abs(outside));
    }
    const double pi = 3.14159265358979;
    const double exact =
        form == Form::sphere ? 4.0 / 3 * pi * 25 * 25 * 25 : 2 * pi * pi * 24 * 100;
    EXPECT_NEAR(volume / exact, 1, 1e-4);
    EXPECT_LT(sagitta, 2.5e-4);
    // Closed: V − E + F is 2 for the sphere, 0 for the torus, where E = 3 F / 2.
    const auto euler =
        static_cast<long>(truth.vertices_mm.size()) - static_cast<long>(truth.triangles.size()) / 2;
    EXPECT_EQ(euler, form == Form::sphere ? 2 : 0);
  }
}

}  // namespace
}  // namespace alhazen::sim
