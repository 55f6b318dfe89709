#include "reconstruct/surface/signed_distance.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/SparseCholesky>
#include <cmath>
#include <limits>
#include <random>

#include "reconstruct/surface/multigrid.h"
#include "tests/unit/surface/scene.h"

namespace alhazen {
namespace {

using scene::kVolume;

/// Cells of a cube of which each exists with probability `share`, with random weights.
GridSystem random_grid(int side, double share, double mass_share, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> uniform(0, 1);
  const Octree octree = Octree::uniform(kVolume, static_cast<int>(std::lround(std::log2(side))));
  GridSystem grid;
  std::vector<std::uint32_t> cell_of(octree.size(), GridSystem::kNone);
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (uniform(random) > share) continue;
    cell_of[i] = static_cast<std::uint32_t>(grid.cell.size());
    const Leaf& leaf = octree.leaves()[i];
    grid.cell.push_back({leaf.x, leaf.y, leaf.z});
    grid.mass.push_back(1e-3F + (uniform(random) < mass_share ? uniform(random) : 0.0F));
    grid.weight.push_back({0.1F + uniform(random), 0.1F + uniform(random), 0.1F + uniform(random)});
  }
  std::array<std::uint32_t, 6> alone{};
  alone.fill(GridSystem::kNone);
  grid.neighbour.assign(grid.size(), alone);
  for (const Face& face : octree.faces()) {
    const std::uint32_t a = cell_of[face.a], b = cell_of[face.b];
    if (a == GridSystem::kNone || b == GridSystem::kNone) continue;
    grid.neighbour[a][2 * std::size_t{face.axis} + 1] = b;
    grid.neighbour[b][2 * std::size_t{face.axis}] = a;
  }
  return grid;
}

/// The same system, solved directly in double.
Eigen::VectorXd solved_directly(const GridSystem& grid, const std::vector<float>& b) {
  std::vector<Eigen::Triplet<double>> entries;
  const auto add = [&](std::size_t i, std::size_t j, double value) {
    entries.emplace_back(static_cast<int>(i), static_cast<int>(j), value);
  };
  for (std::size_t i = 0; i < grid.size(); ++i) {
    add(i, i, static_cast<double>(grid.mass[i]));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::uint32_t j = grid.neighbour[i][2 * axis + 1];
      if (j == GridSystem::kNone) continue;
      const double w = static_cast<double>(grid.weight[i][axis]);
      add(i, i, w);
      add(j, j, w);
      add(i, j, -w);
      add(j, i, -w);
    }
  }
  const auto n = static_cast<Eigen::Index>(grid.size());
  Eigen::SparseMatrix<double> matrix(n, n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(matrix);
  return factor.solve(Eigen::Map<const Eigen::VectorXf>(b.data(), n).cast<double>());
}

TEST(Multigrid, AgreesWithADirectSolve) {
  for (const double share : {1.0, 0.8, 0.6}) {
    const GridSystem grid = random_grid(16, share, 0.05, 3);
    std::mt19937 random(5);
    std::normal_distribution<float> normal;
    std::vector<float> b(grid.size());
    for (float& value : b) value = normal(random);
    const Eigen::VectorXd expected = solved_directly(grid, b);
    std::vector<float> x(grid.size(), 0.0F);
    const Result<Multigrid::Solved> solved = Multigrid(grid).solve(b, 1e-6, 100, {}, x);
    ASSERT_TRUE(solved);
    EXPECT_LE(solved->residual, 2e-6);
    EXPECT_LT(solved->iterations, 40) << share;
    const auto n = static_cast<Eigen::Index>(x.size());
    const Eigen::VectorXd got = Eigen::Map<const Eigen::VectorXf>(x.data(), n).cast<double>();
    EXPECT_LT((got - expected).norm(), 1e-4 * expected.norm()) << share;
  }
}

// What made the prototype err by tens of micrometres: with little data, low frequencies must
// converge too.
TEST(Multigrid, ConvergesWithHardlyAnyMass) {
  GridSystem grid = random_grid(32, 1.0, 0, 4);
  std::fill(grid.mass.begin(), grid.mass.end(), 1e-6F);
  std::vector<float> b(grid.size());
  for (std::size_t i = 0; i < b.size(); ++i) b[i] = grid.mass[i] * 3;
  std::vector<float> x(grid.size(), 0.0F);
  const Result<Multigrid::Solved> solved = Multigrid(grid).solve(b, 1e-5, 100, {}, x);
  ASSERT_TRUE(solved);
  EXPECT_LT(solved->iterations, 40);
  for (const float value : x) ASSERT_NEAR(value, 3, 1e-2);
}

double rms_near_mm(const Octree& octree, const SignedDistance& f,
                   const scene::Distance& distance_mm,
                   const std::function<bool(std::size_t)>& use) {
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const double d = distance_mm(octree.centre_mm(i));
    if (f.in_band[i] == 0 || std::abs(d) > octree.edge_mm(i) || !use(i)) continue;
    sum += std::pow(static_cast<double>(f.value_mm[i]) - d, 2);
    ++count;
  }
  return std::sqrt(sum / count);
}
const auto kAll = [](std::size_t) { return true; };

TEST(SignedDistance, MinimisesItsEnergy) {
  const auto distance = scene::sphere(20.3);
  const Octree octree = scene::refined_near(distance, 3, 5, 3);
  SurfaceSamples samples = scene::samples(octree, distance);
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    samples.normal[i] += 0.05F * Eigen::Vector3f(normal(random), normal(random), normal(random));
    samples.normal[i].normalize();
    samples.offset_mm[i] += 0.01F * normal(random);
    samples.weight[i] *= 1 + 0.2F * std::abs(normal(random));
  }
  SurfaceOptions options;
  options.data_weight = 0.5;
  const Result<SignedDistance> f = signed_distance(
      octree, octree.faces(), scene::inside(octree, distance), samples, options, {});
  ASSERT_TRUE(f) << f.error().text();

  // The energy of the header, assembled here from its faces and solved directly.
  std::vector<int> cell_of(octree.size(), -1);
  std::vector<float> weights;
  int cells = 0;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (f->in_band[i] == 0) continue;
    cell_of[i] = cells++;
    if (samples.weight[i] > 0) weights.push_back(samples.weight[i]);
  }
  std::nth_element(weights.begin(),
                   weights.begin() + static_cast<std::ptrdiff_t>(weights.size() / 2),
                   weights.end());
  const double median = static_cast<double>(weights[weights.size() / 2]);
  const double unit_mm = 2;  // the edge of leaves of level 5
  Eigen::VectorXd right = Eigen::VectorXd::Zero(cells);
  std::vector<Eigen::Triplet<double>> entries;
  for (const Face& face : octree.faces()) {
    const int a = cell_of[face.a], b = cell_of[face.b];
    if (a < 0 || b < 0) continue;
    const auto slope = [&](std::size_t i) {
      return static_cast<double>(samples.normal[i][face.axis]);
    };
    double rise = 0.5 * (slope(face.a) + slope(face.b));
    const Eigen::Vector3d step = unit_mm * Eigen::Vector3d::Unit(face.axis);
    const std::size_t before = *octree.find(octree.centre_mm(face.a) - step);
    const std::size_t after = *octree.find(octree.centre_mm(face.b) + step);
    if (cell_of[before] >= 0 && cell_of[after] >= 0) {
      rise = 13.0 / 24 * (slope(face.a) + slope(face.b)) - (slope(before) + slope(after)) / 24;
    }
    entries.insert(entries.end(), {{a, a, 1}, {b, b, 1}, {a, b, -1}, {b, a, -1}});
    right[b] += rise;
    right[a] -= rise;
  }
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (cell_of[i] < 0 || !(samples.weight[i] > 0)) continue;
    const double w = 0.5 * static_cast<double>(samples.weight[i]) / median;
    entries.emplace_back(cell_of[i], cell_of[i], w);
    right[cell_of[i]] += w * static_cast<double>(samples.offset_mm[i]) / unit_mm;
  }
  Eigen::SparseMatrix<double> matrix(cells, cells);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(matrix);
  const Eigen::VectorXd expected = unit_mm * factor.solve(right);
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (cell_of[i] < 0) continue;
    ASSERT_NEAR(static_cast<double>(f->value_mm[i]), expected[cell_of[i]], 1e-3);  // of 2 mm
  }
}

TEST(SignedDistance, FollowsExactSamplesToAFractionOfAMicrometre) {
  for (const auto& distance : {scene::sphere(20.3), scene::torus(18.2, 7.1)}) {
    const Octree octree = scene::refined_near(distance, 3, 6, 4);
    const Result<SignedDistance> f =
        signed_distance(octree, octree.faces(), scene::inside(octree, distance),
                        scene::samples(octree, distance), {}, {});
    ASSERT_TRUE(f) << f.error().text();
    EXPECT_EQ(f->clipped, 0U);
    EXPECT_LE(f->residual, 1e-5);
    EXPECT_LT(rms_near_mm(octree, *f, distance, kAll), 5e-4);
    for (std::size_t i = 0; i < octree.size(); ++i) {
      const double d = distance(octree.centre_mm(i));
      if (std::abs(d) > octree.edge_mm(i)) {
        ASSERT_EQ(f->value_mm[i] < 0, d < 0);
      }
    }
  }
}

TEST(SignedDistance, AveragesNoiseAndDoubtsOutliers) {
  const auto distance = scene::sphere(20.3);
  const Octree octree = scene::refined_near(distance, 3, 6, 4);
  SurfaceSamples samples = scene::samples(octree, distance);
  std::mt19937 random(2);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    samples.normal[i] += 5e-4F * Eigen::Vector3f(normal(random), normal(random), normal(random));
    samples.offset_mm[i] += 0.02F * normal(random);
    if (random() % 25 == 0) samples.offset_mm[i] += 0.7F;  // all on one side: a mean would follow
  }
  const Indicator cut = scene::inside(octree, distance);
  SurfaceOptions options;
  for (const double data_weight : {0.02, 1e-4}) {
    options.data_weight = data_weight;
    const Result<SignedDistance> f =
        signed_distance(octree, octree.faces(), cut, samples, options, {});
    ASSERT_TRUE(f);
    EXPECT_LT(rms_near_mm(octree, *f, distance, kAll), 1e-3) << data_weight;
    EXPECT_LT(f->iterations, 90);
  }
}

TEST(SignedDistance, ClosesWhatWasNotObservedAlongTheCut) {
  const auto distance = scene::sphere(20.3);
  const Octree octree = scene::refined_near(distance, 3, 6, 4);
  SurfaceSamples samples = scene::samples(octree, distance);
  const auto is_seen = [&](std::size_t i) {
    return octree.centre_mm(i).z() - kVolume.centre_mm.z() > -12;
  };
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (is_seen(i)) continue;
    samples.normal[i].setZero();
    samples.weight[i] = 0;
    samples.offset_mm[i] = std::numeric_limits<float>::quiet_NaN();
  }
  const Result<SignedDistance> f =
      signed_distance(octree, octree.faces(), scene::inside(octree, distance), samples, {}, {});
  ASSERT_TRUE(f) << f.error().text();
  const auto is_well_seen = [&](std::size_t i) {  // three leaves from the rim
    return octree.centre_mm(i).z() - kVolume.centre_mm.z() > -9;
  };
  EXPECT_LT(rms_near_mm(octree, *f, distance, is_well_seen), 2.5e-3);
  const auto is_unseen = [&](std::size_t i) { return !is_seen(i); };
  EXPECT_LT(rms_near_mm(octree, *f, distance, is_unseen), 0.3);  // leaves of 1 mm
  EXPECT_EQ(f->clipped, 0U);
}

TEST(SignedDistance, FollowsTheCutAloneWhereNothingWasObserved) {
  const auto distance = scene::torus(18.2, 7.1);
  const Octree octree = scene::refined_near(distance, 3, 6, 4);
  const SurfaceSamples nothing{std::vector<Eigen::Vector3f>(octree.size(), Eigen::Vector3f::Zero()),
                               std::vector<float>(octree.size(), 0.0F),
                               std::vector<float>(octree.size(), 0.0F)};
  const Result<SignedDistance> f =
      signed_distance(octree, octree.faces(), scene::inside(octree, distance), nothing, {}, {});
  ASSERT_TRUE(f);
  EXPECT_LT(rms_near_mm(octree, *f, distance, kAll), 0.3);
}

TEST(SignedDistance, IsTheSameForAnyNumberOfThreads) {
  const auto distance = scene::sphere(20.3);
  const Octree octree = scene::refined_near(distance, 3, 6, 4);
  const auto run = [&] {
    return *signed_distance(octree, octree.faces(), scene::inside(octree, distance),
                            scene::samples(octree, distance), {}, {});
  };
  const SignedDistance many = run();
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(many.value_mm, run().value_mm);
}

TEST(SignedDistance, RefusesWhatItCannotUse) {
  const auto distance = scene::sphere(20.3);
  const Octree octree = Octree::uniform(kVolume, 4);
  const auto faces = octree.faces();
  const SurfaceSamples good = scene::samples(octree, distance);
  const Indicator cut = scene::inside(octree, distance);
  const auto code = [&](const Indicator& u, const SurfaceSamples& samples) {
    return signed_distance(octree, faces, u, samples, {}, {}).error().code;
  };
  SurfaceSamples bad = good;
  bad.weight.pop_back();
  EXPECT_EQ(code(cut, bad), Code::invalid);
  bad = good;
  bad.weight[7] = -1;
  EXPECT_EQ(code(cut, bad), Code::invalid);
  bad = good;
  bad.weight[7] = 1;
  bad.offset_mm[7] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(code(cut, bad), Code::invalid);
  bad = good;
  bad.normal[7].x() = std::numeric_limits<float>::infinity();
  EXPECT_EQ(code(cut, bad), Code::invalid);
  EXPECT_EQ(code({std::vector<float>(octree.size(), 0.0F)}, good), Code::conflict);
  std::stop_source stop;
  stop.request_stop();
  const Result<SignedDistance> stopped =
      signed_distance(octree, faces, cut, good, {}, alhazen::Run{stop.get_token(), {}});
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, Code::cancelled);
}

}  // namespace
}  // namespace alhazen
