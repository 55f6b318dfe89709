#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "reconstruct/mesh/clean.h"
#include "reconstruct/mesh/contour.h"
#include "reconstruct/surface/divergence.h"
#include "reconstruct/surface/min_cut.h"
#include "reconstruct/surface/signed_distance.h"

// The surface stages on a sphere of 25 mm in the default volume, as an octree with a band of four
// leaves on each side holds it. Level 8 has leaves of 0.4 mm, level 9 of 0.2 mm.

namespace alhazen {
namespace {

constexpr double kRadius_mm = 25;

double distance_mm(const Octree& octree, std::size_t leaf) {
  return (octree.centre_mm(leaf) - octree.volume().centre_mm).norm() - kRadius_mm;
}

Octree banded_octree(int level) {
  Octree octree = Octree::uniform(Volume{}, 5);
  for (int l = 6; l <= level; ++l) {
    std::vector<std::uint8_t> target(octree.size());
    for (std::size_t i = 0; i < octree.size(); ++i) {
      const bool is_near = std::abs(distance_mm(octree, i)) < 2 * octree.edge_mm(i);
      target[i] = static_cast<std::uint8_t>(is_near ? l : 5);
    }
    octree = octree.adapted(target);
  }
  return octree;
}

/// A field one leaf wide with noisy normals; the lowest part is not seen.
NormalField noisy_field(const Octree& octree) {
  NormalField field;
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  const double sigma_mm = octree.volume().edge_mm / std::pow(2, octree.finest_level());
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Eigen::Vector3d r = octree.centre_mm(i) - octree.volume().centre_mm;
    const double d = distance_mm(octree, i);
    const Eigen::Vector3f noise(normal(random), normal(random), normal(random));
    field.normal.push_back((r.normalized().cast<float>() + 0.3F * noise).normalized());
    const bool is_seen = r.z() > -0.7 * r.norm();
    const double c = std::exp(-d * d / (2 * sigma_mm * sigma_mm));
    field.consistency.push_back(is_seen ? static_cast<float>(c) : 0.0F);
    field.support.push_back(10);
    field.votes.push_back(20);
    field.free_space.push_back(is_seen && d > 3 ? 1 : 0);
  }
  return field;
}

Indicator inside(const Octree& octree, double margin_mm) {
  Indicator cut;
  for (std::size_t i = 0; i < octree.size(); ++i)
    cut.u.push_back(distance_mm(octree, i) < margin_mm ? 1.0F : 0.0F);
  return cut;
}

/// Arguments: level, iterations, 1 for a warm start.
void BM_Cut(benchmark::State& state) {
  const Octree octree = banded_octree(static_cast<int>(state.range(0)));
  const auto faces = octree.faces();
  const NormalField field = noisy_field(octree);
  const auto divergence = flux_divergence(octree, faces, field);
  SurfaceOptions options;
  options.max_iterations = static_cast<int>(state.range(1));
  options.relative_gap = 1e-9;
  const Indicator start = inside(octree, 0.8);
  Indicator cut;
  for (auto _ : state) {
    cut = *min_cut(octree, faces, field, divergence, options,
                   state.range(2) != 0 ? &start : nullptr, {});
  }
  state.counters["leaves"] = static_cast<double>(octree.size());
  state.counters["relative_gap"] = cut.gap / std::abs(cut.energy);
  state.counters["ns_per_leaf_iteration"] = benchmark::Counter(
      static_cast<double>(octree.size()) * cut.iterations * 1e-9,
      benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_Cut)
    ->Args({7, 100, 0})
    ->Args({7, 100, 1})
    ->Args({8, 1, 1})
    ->Args({8, 50, 1})
    ->Args({8, 100, 1})
    ->Args({9, 50, 1})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->Iterations(1);

void BM_Divergence(benchmark::State& state) {
  const Octree octree = banded_octree(static_cast<int>(state.range(0)));
  const auto faces = octree.faces();
  const NormalField field = noisy_field(octree);
  for (auto _ : state) benchmark::DoNotOptimize(flux_divergence(octree, faces, field));
}
BENCHMARK(BM_Divergence)->Arg(8)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();

SurfaceSamples noisy_samples(const Octree& octree) {
  SurfaceSamples samples;
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Eigen::Vector3d r = octree.centre_mm(i) - octree.volume().centre_mm;
    const bool is_seen = r.z() > -0.7 * r.norm();
    const double d = distance_mm(octree, i);
    const Eigen::Vector3f noise(normal(random), normal(random), normal(random));
    samples.normal.emplace_back(
        is_seen ? Eigen::Vector3f((r.normalized().cast<float>() + 2e-4F * noise).normalized())
                : Eigen::Vector3f(Eigen::Vector3f::Zero()));
    samples.offset_mm.push_back(static_cast<float>(d) + 0.005F * normal(random));
    samples.weight.push_back(is_seen && std::abs(d) < octree.edge_mm(i) ? 4e4F : 0.0F);
  }
  return samples;
}

void BM_SignedDistance(benchmark::State& state) {
  const Octree octree = banded_octree(static_cast<int>(state.range(0)));
  const auto faces = octree.faces();
  const Indicator cut = inside(octree, 0.1);
  const SurfaceSamples samples = noisy_samples(octree);
  SignedDistance f;
  for (auto _ : state) f = *signed_distance(octree, faces, cut, samples, {}, {});
  state.counters["unknowns"] = static_cast<double>(f.unknowns);
  state.counters["iterations"] = f.iterations;
  state.counters["residual"] = f.residual;
}
BENCHMARK(BM_SignedDistance)
    ->Arg(8)
    ->Arg(9)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->Iterations(1);

/// Contour and clean a signed distance; errors of the vertices against the sphere.
void BM_Mesh(benchmark::State& state) {
  const Octree octree = banded_octree(static_cast<int>(state.range(0)));
  const SignedDistance f =
      *signed_distance(octree, octree.faces(), inside(octree, 0.1), noisy_samples(octree), {}, {});
  const double edge_mm = octree.volume().edge_mm / std::pow(2, octree.finest_level());
  Mesh mesh;
  for (auto _ : state)
    mesh = *clean(*contour(octree, f.value_mm, {}), {.min_edge_mm = 0.2 * edge_mm});
  double sum = 0, count = 0;
  for (const Eigen::Vector3d& p : mesh.vertices_mm) {
    const Eigen::Vector3d r = p - octree.volume().centre_mm;
    if (r.z() < -0.65 * r.norm()) continue;
    sum += std::pow(r.norm() - kRadius_mm, 2);
    ++count;
  }
  state.counters["triangles"] = static_cast<double>(mesh.triangles.size());
  state.counters["rms_um"] = 1e3 * std::sqrt(sum / count);
  state.counters["closed"] = check_closed(mesh).closed() ? 1 : 0;
}
BENCHMARK(BM_Mesh)
    ->Arg(8)
    ->Arg(9)
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->Iterations(1);

}  // namespace
}  // namespace alhazen
