#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "reconstruct/surface/divergence.h"
#include "reconstruct/surface/min_cut.h"

namespace alhazen {
namespace {

Octree banded_octree(double radius_mm, int level) {
  Octree octree = Octree::uniform(Volume{}, 4);
  for (int l = 5; l <= level; ++l) {
    std::vector<std::uint8_t> target(octree.size());
    for (std::size_t i = 0; i < octree.size(); ++i) {
      const double d =
          std::abs((octree.centre_mm(i) - octree.volume().centre_mm).norm() - radius_mm);
      target[i] = static_cast<std::uint8_t>(d < 2.2 * octree.edge_mm(i) ? l : 4);
    }
    octree = octree.adapted(target);
  }
  return octree;
}

NormalField sphere_field(const Octree& octree, double radius_mm, double noise) {
  NormalField field;
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Eigen::Vector3d r = octree.centre_mm(i) - octree.volume().centre_mm;
    const double d = (r.norm() - radius_mm) / 0.4;
    Eigen::Vector3f n = r.normalized().cast<float>();
    n +=
        static_cast<float>(noise) * Eigen::Vector3f(normal(random), normal(random), normal(random));
    field.normal.push_back(n.normalized());
    const bool seen = r.z() > -0.7 * r.norm();
    field.consistency.push_back(seen ? static_cast<float>(std::exp(-0.5 * d * d)) : 0.0F);
    field.support.push_back(10);
    field.votes.push_back(20);
    field.free_space.push_back(d > 40 ? 1 : 0);
  }
  return field;
}

void BM_Cut(benchmark::State& state) {
  const int level = static_cast<int>(state.range(0));
  const double radius_mm = 25;
  const Octree octree = banded_octree(radius_mm, level);
  const auto faces = octree.faces();
  const NormalField field = sphere_field(octree, radius_mm, 0.3);
  const auto divergence = flux_divergence(octree, faces, field);
  SurfaceOptions options;
  options.max_iterations = static_cast<int>(state.range(1));
  options.relative_gap = 1e-9;
  Indicator warm;
  for (std::size_t i = 0; i < octree.size(); ++i)
    warm.u.push_back((octree.centre_mm(i) - octree.volume().centre_mm).norm() < 25.8 ? 1.0F : 0.0F);
  Indicator cut;
  for (auto _ : state)
    cut = *min_cut(octree, faces, field, divergence, options, state.range(2) ? &warm : nullptr, {});
  state.counters["leaves"] = static_cast<double>(octree.size());
  state.counters["energy"] = cut.energy;
  state.counters["gap"] = cut.gap;
  double volume = 0;
  for (std::size_t i = 0; i < octree.size(); ++i)
    volume += cut.u[i] * std::pow(octree.edge_mm(i), 3);
  state.counters["radius"] = std::cbrt(volume * 3 / 4 / M_PI);
  state.counters["ns_leaf_it"] = benchmark::Counter(
      static_cast<double>(octree.size() * static_cast<std::size_t>(cut.iterations)) * 1e-9,
      benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_Cut)
    ->ArgsProduct({{7}, {20, 50, 100, 200}, {0, 1}})
    ->Unit(benchmark::kMillisecond)
    ->MeasureProcessCPUTime()
    ->Iterations(1);

}  // namespace
}  // namespace alhazen
