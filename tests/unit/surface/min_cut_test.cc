#include "reconstruct/surface/min_cut.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "reconstruct/surface/divergence.h"
#include "reconstruct/surface/flow_graph.h"
#include "tests/unit/surface/scene.h"

namespace alhazen {
namespace {

using scene::kVolume;
constexpr double kPi = std::numbers::pi;

Octree random_octree(unsigned seed) {
  std::mt19937 random(seed);
  Octree octree = Octree::uniform(kVolume, 2);
  for (int level = 3; level <= 4; ++level) {
    std::vector<std::uint8_t> target(octree.size());
    for (std::size_t i = 0; i < octree.size(); ++i)
      target[i] = static_cast<std::uint8_t>(random() % 3 == 0 ? level : 2);
    octree = octree.adapted(target);
  }
  return octree;
}

double volume_mm3(const Octree& octree, const Indicator& cut) {
  double sum = 0;
  for (std::size_t i = 0; i < octree.size(); ++i)
    if (cut.u[i] > 0.5F) sum += std::pow(octree.edge_mm(i), 3);
  return sum;
}

TEST(Divergence, IsThatOfALinearFieldAndEndsAtTheBoundary) {
  // c N = (2x, −y, ½z)/100: div = 1.5/100 wherever all neighbours are of one size.
  const Octree octree = Octree::uniform(kVolume, 4);
  NormalField field = scene::field(octree, scene::sphere(20), 4);
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Eigen::Vector3d p = octree.centre_mm(i);
    const Eigen::Vector3d flow = Eigen::Vector3d(2 * p.x(), -p.y(), 0.5 * p.z()) / 100;
    field.normal[i] = flow.normalized().cast<float>();
    field.consistency[i] = static_cast<float>(flow.norm());
  }
  const std::vector<float> divergence = flux_divergence(octree, octree.faces(), field);
  double sum = 0;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Leaf& leaf = octree.leaves()[i];
    const auto is_inner = [](int k) { return k > 0 && k < 15; };
    if (is_inner(leaf.x) && is_inner(leaf.y) && is_inner(leaf.z)) {
      ASSERT_NEAR(static_cast<double>(divergence[i]), 0.015, 1e-5);
    }
    sum += static_cast<double>(divergence[i]) * std::pow(octree.edge_mm(i), 3);
  }
  EXPECT_NEAR(sum, 0, 1e-2);  // nothing leaves the volume: of 6e4 mm² · 0.4 of flux through it
}

TEST(Divergence, IsPositiveJustInsideAndNegativeJustOutside) {
  for (const auto& distance : {scene::sphere(20.3), scene::torus(18.2, 7.1)}) {
    const Octree octree = scene::refined_near(distance, 3, 6, 4);
    const NormalField field = scene::field(octree, distance, 1.0);
    const std::vector<float> divergence = flux_divergence(octree, octree.faces(), field);
    double sum = 0;
    for (std::size_t i = 0; i < octree.size(); ++i) {
      const double d = distance(octree.centre_mm(i));
      if (d > -2 && d < -0.5) {
        EXPECT_GT(divergence[i], 0) << d;
      }
      if (d > 0.7 && d < 2) {
        EXPECT_LT(divergence[i], 0) << d;
      }
      sum += static_cast<double>(divergence[i]) * std::pow(octree.edge_mm(i), 3);
    }
    EXPECT_NEAR(sum, 0, 1e-2);
  }
}

TEST(FlowGraph, OperatorsAreAdjoint) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    const Octree octree = random_octree(seed);
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    std::vector<std::uint8_t> fixed(octree.size());
    for (std::uint8_t& f : fixed) f = random() % 4 == 0 ? 1 : 0;
    const FlowGraph graph(octree, octree.faces(), fixed);
    EXPECT_GT(graph.octets(), 0U);
    EXPECT_LT(FlowGraph::kOctet * graph.octets(), graph.nodes());
    std::vector<double> u(graph.nodes()), p(graph.slots()), c_of(graph.slots(), 0.0);
    for (double& value : u) value = normal(random);
    for (double& value : p) value = normal(random);
    double ku_p = 0, u_ktp = 0, scale = 0;
    for (std::size_t i = 0; i < graph.nodes(); ++i) {
      graph.for_each_slot(i, [&](std::size_t s, std::size_t j, std::size_t twin, double c) {
        ASSERT_EQ(c_of[s], 0) << "two owners";
        c_of[s] = c;
        ku_p += c * (u[j] - u[i]) * p[s];
        scale += std::abs(c * (u[j] - u[i]) * p[s]);
        bool is_mutual = false;
        graph.for_each_slot(j, [&](std::size_t t, std::size_t back, std::size_t own, double) {
          is_mutual = is_mutual || (t == twin && back == i && own == s);
        });
        ASSERT_TRUE(is_mutual);
      });
    }
    for (std::size_t i = 0; i < graph.nodes(); ++i) {
      graph.for_each_slot(i, [&](std::size_t s, std::size_t, std::size_t twin, double) {
        u_ktp += u[i] * (c_of[twin] * p[twin] - c_of[s] * p[s]);
      });
    }
    EXPECT_NEAR(ku_p, u_ktp, 1e-12 * scale);
  }
}

/// The surface term of min_cut.h and the whole energy, from its formula, in double.
struct Energies {
  double surface = 0, primal = 0;
};
Energies energy_of(const Octree& octree, const NormalField& field,
                   const std::vector<float>& divergence, const SurfaceOptions& options,
                   const std::vector<float>& u) {
  const double unit_mm = octree.volume().edge_mm / std::pow(2, octree.finest_level());
  std::vector<double> squares(octree.size(), 0.0);
  for (const Face& face : octree.faces()) {
    const double a = octree.edge_mm(face.a) / unit_mm, b = octree.edge_mm(face.b) / unit_mm;
    const double area = std::min(a, b) * std::min(a, b), distance = (a + b) / 2;
    const double slope = (static_cast<double>(u[face.b]) - u[face.a]) / distance;
    squares[face.a] += area / (2 * a * a) * slope * slope;
    squares[face.b] += area / (2 * b * b) * slope * slope;
  }
  Energies sum;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const double volume = std::pow(octree.edge_mm(i) / unit_mm, 3);
    const double g = std::max(options.g_min,
                              std::exp(-options.beta * static_cast<double>(field.consistency[i])));
    sum.surface += volume * g * std::sqrt(squares[i]);
    sum.primal -= options.lambda * volume * unit_mm * static_cast<double>(divergence[i]) * u[i];
  }
  sum.primal += sum.surface;
  return sum;
}

TEST(MinCut, FindsTheSphereAndTheTorusOfAKnownFlux) {
  struct Case {
    scene::Distance distance;
    double volume_mm3, curvature_mm;  ///< curvature: 2 ∫ H dA
  };
  constexpr double kSigma_mm = 1.6;
  for (const Case& c :
       {Case{scene::sphere(20.3), 4 * kPi / 3 * std::pow(20.3, 3), 8 * kPi * 20.3},
        Case{scene::torus(18.2, 7.1), 2 * kPi * kPi * 18.2 * 7.1 * 7.1, 4 * kPi * kPi * 18.2}}) {
    const Octree octree = scene::refined_near(c.distance, 3, 5, 3);  // finest leaves of 2 mm
    const auto faces = octree.faces();
    const NormalField field = scene::field(octree, c.distance, kSigma_mm, 0.2);
    const std::vector<float> divergence = flux_divergence(octree, faces, field);
    SurfaceOptions options;
    options.relative_gap = 1e-3;
    options.max_iterations = 2000;
    const Result<Indicator> cut = min_cut(octree, faces, field, divergence, options, nullptr, {});
    ASSERT_TRUE(cut) << cut.error().text();
    const Energies energies = energy_of(octree, field, divergence, options, cut->u);
    EXPECT_NEAR(cut->energy, energies.primal, 1e-5 * std::abs(energies.primal));
    EXPECT_GE(cut->gap, 0);
    EXPECT_LE(cut->gap, 1e-3 * energies.surface);
    // The flux term lies outward by 2Hσ² (reconstruct/README.md).
    const double expected_mm3 = c.volume_mm3 + c.curvature_mm * kSigma_mm * kSigma_mm;
    EXPECT_NEAR(volume_mm3(octree, *cut), expected_mm3, 0.04 * expected_mm3);
    for (std::size_t i = 0; i < octree.size(); ++i) {
      if (std::abs(c.distance(octree.centre_mm(i))) > 3) {
        EXPECT_NEAR(cut->u[i], c.distance(octree.centre_mm(i)) < 0 ? 1 : 0, 0.05);
      }
    }
  }
}

TEST(MinCut, GapGoesToZeroOnUnevenOctrees) {
  for (unsigned seed = 0; seed < 3; ++seed) {
    const Octree octree = random_octree(seed);
    const auto faces = octree.faces();
    NormalField field = scene::field(octree, scene::sphere(15), 6, 0.5);
    std::mt19937 random(seed);
    for (std::uint8_t& f : field.free_space) f = random() % 50 == 0 ? 1 : 0;
    const std::vector<float> divergence = flux_divergence(octree, faces, field);
    SurfaceOptions options;
    options.relative_gap = 1e-4;
    options.max_iterations = 20000;
    const Result<Indicator> cut = min_cut(octree, faces, field, divergence, options, nullptr, {});
    ASSERT_TRUE(cut);
    EXPECT_LT(cut->iterations, 20000);
    EXPECT_GE(cut->gap, -1e-6 * std::abs(cut->energy));  // rounding of single precision
    for (std::size_t i = 0; i < octree.size(); ++i) {
      ASSERT_GE(cut->u[i], 0);
      ASSERT_LE(cut->u[i], 1);
      if (field.free_space[i] != 0) {
        ASSERT_EQ(cut->u[i], 0);
      }
    }
    // No other u does better: random changes, and both constants.
    const double best = energy_of(octree, field, divergence, options, cut->u).primal;
    std::uniform_real_distribution<float> uniform(-0.3F, 0.3F);
    for (int trial = 0; trial < 20; ++trial) {
      std::vector<float> u = cut->u;
      for (std::size_t i = 0; i < u.size(); ++i)
        if (u[i] > 0 && random() % 10 == 0) u[i] = std::clamp(u[i] + uniform(random), 0.0F, 1.0F);
      EXPECT_GE(energy_of(octree, field, divergence, options, u).primal, best - cut->gap);
    }
  }
}

/// Continuous max-flow on an n³ grid of unit cells (Yuan, Bae, Tai 2010; one projected step an
/// iteration), flows on faces: a second solver with a discretisation of its own.
std::vector<double> max_flow(int n, const std::vector<double>& g, const std::vector<double>& source,
                             const std::vector<double>& sink, int iterations) {
  const auto at = [n](int x, int y, int z) {
    const int cell = (z * n + y) * n + x;
    return static_cast<std::size_t>(cell);
  };
  const std::size_t cells = at(n - 1, n - 1, n - 1) + 1;
  const double c = 0.3, tau = 0.11;
  std::vector<double> u(cells), ps(cells), pt(cells), div(cells, 0.0), force(cells), scale(cells);
  std::array<std::vector<double>, 3> p;  // flow through the low face of each cell along an axis
  for (auto& axis : p) axis.assign(cells, 0.0);
  for (std::size_t i = 0; i < cells; ++i) {
    u[i] = source[i] >= sink[i] ? 1 : 0;
    ps[i] = pt[i] = std::min(source[i], sink[i]);
  }
  const std::array<std::size_t, 3> step{1, static_cast<std::size_t>(n), at(0, 0, 1)};
  const auto for_cells = [&](const auto& body) {
    for (int z = 0; z < n; ++z)
      for (int y = 0; y < n; ++y)
        for (int x = 0; x < n; ++x) body(at(x, y, z), std::array<int, 3>{x, y, z});
  };
  for (int k = 0; k < iterations; ++k) {
    for (std::size_t i = 0; i < cells; ++i) force[i] = div[i] - (ps[i] - pt[i] + u[i] / c);
    for_cells([&](std::size_t i, const std::array<int, 3>& xyz) {
      for (std::size_t a = 0; a < 3; ++a)
        if (xyz[a] > 0) p[a][i] += tau * (force[i] - force[i - step[a]]);
    });
    for_cells([&](std::size_t i, const std::array<int, 3>& xyz) {
      double square = 0;
      for (std::size_t a = 0; a < 3; ++a) {
        square += p[a][i] * p[a][i];
        if (xyz[a] + 1 < n) square += p[a][i + step[a]] * p[a][i + step[a]];
      }
      const double length = std::sqrt(square / 2);
      scale[i] = length > g[i] ? g[i] / length : 1;
    });
    for_cells([&](std::size_t i, const std::array<int, 3>& xyz) {
      for (std::size_t a = 0; a < 3; ++a)
        if (xyz[a] > 0) p[a][i] *= 0.5 * (scale[i] + scale[i - step[a]]);
    });
    for_cells([&](std::size_t i, const std::array<int, 3>& xyz) {
      div[i] = 0;
      for (std::size_t a = 0; a < 3; ++a)
        div[i] += (xyz[a] + 1 < n ? p[a][i + step[a]] : 0) - p[a][i];
      ps[i] = std::min(source[i], pt[i] - u[i] / c + div[i] + 1 / c);
      pt[i] = std::min(sink[i], ps[i] + u[i] / c - div[i]);
      u[i] -= c * (pt[i] + div[i] - ps[i]);
    });
  }
  return u;
}

TEST(MinCut, AgreesWithContinuousMaxFlow) {
  const auto distance = scene::torus(17, 8);
  constexpr int kSide = 32;
  const Octree octree = Octree::uniform(kVolume, 5);  // leaves of 2 mm
  const auto faces = octree.faces();
  const NormalField field = scene::field(octree, distance, 2.0, 0.3);
  const std::vector<float> divergence = flux_divergence(octree, faces, field);
  SurfaceOptions options;
  options.relative_gap = 1e-4;
  options.max_iterations = 5000;
  const Result<Indicator> cut = min_cut(octree, faces, field, divergence, options, nullptr, {});
  ASSERT_TRUE(cut);

  std::vector<double> g(octree.size()), source(octree.size()), sink(octree.size());
  std::vector<std::size_t> grid_of(octree.size());
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Leaf& leaf = octree.leaves()[i];
    const std::size_t at = (std::size_t{leaf.z} * kSide + leaf.y) * kSide + leaf.x;
    grid_of[i] = at;
    g[at] = std::max(options.g_min,
                     std::exp(-options.beta * static_cast<double>(field.consistency[i])));
    const double flux = options.lambda * 2 * static_cast<double>(divergence[i]);
    source[at] = std::max(flux, 0.0);
    sink[at] = std::max(-flux, 0.0);
    if (std::min({leaf.x, leaf.y, leaf.z}) == 0 ||
        std::max({leaf.x, leaf.y, leaf.z}) == kSide - 1) {
      source[at] = 0;
      sink[at] = 100;
    }
  }
  const std::vector<double> other = max_flow(kSide, g, source, sink, 300);
  std::size_t inside = 0, differ = 0;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    inside += cut->u[i] > 0.5F ? 1 : 0;
    differ += (cut->u[i] > 0.5F) != (other[grid_of[i]] > 0.5) ? 1 : 0;
  }
  EXPECT_GT(inside, 2500U);
  EXPECT_LE(differ, inside / 100);
  // By our energy the other solver's answer is hardly worse, and never better by more than the gap.
  std::vector<float> u(octree.size());
  for (std::size_t i = 0; i < octree.size(); ++i)
    u[i] = static_cast<float>(std::clamp(other[grid_of[i]], 0.0, 1.0));
  const double theirs = energy_of(octree, field, divergence, options, u).primal;
  EXPECT_GE(theirs, cut->energy - cut->gap);
  EXPECT_LE(theirs, cut->energy + 0.01 * std::abs(cut->energy));
}

TEST(MinCut, AWarmStartAgreesAndSavesIterations) {
  const auto distance = scene::sphere(20.3);
  const Octree octree = scene::refined_near(distance, 3, 5, 3);
  const auto faces = octree.faces();
  const NormalField field = scene::field(octree, distance, 1.6, 0.2);
  const std::vector<float> divergence = flux_divergence(octree, faces, field);
  const SurfaceOptions options;
  const Indicator cold = *min_cut(octree, faces, field, divergence, options, nullptr, {});
  const Indicator again = *min_cut(octree, faces, field, divergence, options, &cold, {});
  EXPECT_LE(again.iterations, cold.iterations);
  const Indicator start = scene::inside(octree, scene::sphere(22.3));
  const Indicator warm = *min_cut(octree, faces, field, divergence, options, &start, {});
  EXPECT_NEAR(warm.energy, cold.energy, warm.gap + cold.gap);
  std::size_t differ = 0;
  for (std::size_t i = 0; i < octree.size(); ++i)
    differ += (warm.u[i] > 0.5F) != (cold.u[i] > 0.5F) ? 1 : 0;
  EXPECT_LT(differ, octree.size() / 300);
}

TEST(MinCut, IsTheSameForAnyNumberOfThreads) {
  const auto distance = scene::torus(18.2, 7.1);
  const Octree octree = scene::refined_near(distance, 3, 5, 3);
  const auto faces = octree.faces();
  const NormalField field = scene::field(octree, distance, 1.6, 0.2);
  const std::vector<float> divergence = flux_divergence(octree, faces, field);
  const Indicator many = *min_cut(octree, faces, field, divergence, {}, nullptr, {});
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const Indicator single = *min_cut(octree, faces, field, divergence, {}, nullptr, {});
  EXPECT_EQ(many.u, single.u);
  EXPECT_EQ(many.gap, single.gap);
  EXPECT_EQ(many.iterations, single.iterations);
}

TEST(MinCut, RefusesWhatItCannotUse) {
  const Octree octree = Octree::uniform(kVolume, 3);
  const auto faces = octree.faces();
  const NormalField field = scene::field(octree, scene::sphere(20), 4);
  const std::vector<float> divergence = flux_divergence(octree, faces, field);
  const auto code = [&](const NormalField& f, const std::vector<float>& d, const Indicator* warm) {
    return min_cut(octree, faces, f, d, {}, warm, {}).error().code;
  };
  NormalField shorter = field;
  shorter.consistency.pop_back();
  EXPECT_EQ(code(shorter, divergence, nullptr), Code::invalid);
  EXPECT_EQ(code(field, {1.0F}, nullptr), Code::invalid);
  Indicator warm;
  EXPECT_EQ(code(field, divergence, &warm), Code::invalid);
  warm.u.assign(octree.size(), 1.5F);
  EXPECT_EQ(code(field, divergence, &warm), Code::invalid);
  warm.u.assign(octree.size(), std::numeric_limits<float>::quiet_NaN());
  EXPECT_EQ(code(field, divergence, &warm), Code::invalid);
  std::stop_source stop;
  stop.request_stop();
  const Result<Indicator> stopped =
      min_cut(octree, faces, field, divergence, {}, nullptr, alhazen::Run{stop.get_token(), {}});
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, Code::cancelled);
}

}  // namespace
}  // namespace alhazen
