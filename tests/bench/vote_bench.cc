#include <benchmark/benchmark.h>
#include <hwy/targets.h>

#include <Eigen/Core>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <string>

#include "reconstruct/vote/depth.h"
#include "reconstruct/vote/kernels.h"
#include "reconstruct/vote/octree.h"
#include "reconstruct/vote/voter.h"
#include "tests/support/analytic.h"
#include "tests/support/nobody.h"

// Octree, voting and depth on an analytic sphere of 25 mm: eleven cameras, two displays, twelve
// stops (264 light maps), Gray code, 0.3 mm pixels. A "hypothesis" is one look-up of a point in a
// light map that passed the culling of its block.

namespace alhazen {
namespace {

const analytic::Sphere kSphere{{1, -0.5, 50}, 25};

const Observations& observations() {
  static const Observations made = [] {
    analytic::RigSize size;
    size.pixel_mm = 0.3;
    size.sensor_px = 512;
    size.has_above = false;
    const Rig rig = analytic::make_rig(size);
    Observations all(rig, VoteOptions{}, Volume{}.centre_mm);
    analytic::scan(rig, kSphere, 12, {.gray = true}, kSphere.centre_mm, 27,
                   [&](const LightMap& map) {
                     if (const Status added = all.add(map); !added) {
                       std::fprintf(stderr, "%s\n", added.error().text().c_str());
                       std::abort();
                     }
                   });
    return all;
  }();
  return made;
}

/// Leaves of `level` within three leaves of the sphere.
Octree banded_octree(int level) {
  Octree octree = Octree::uniform(Volume{}, 5);
  for (int l = 6; l <= level; ++l) {
    std::vector<std::uint8_t> target(octree.size(), 5);
    for (std::size_t i = 0; i < octree.size(); ++i) {
      const double reach = (l == level ? 1.5 : 3.0) * octree.edge_mm(i);
      if (std::abs(analytic::distance_mm(kSphere, octree.centre_mm(i))) < reach) {
        target[i] = static_cast<std::uint8_t>(l);
      }
    }
    octree = octree.adapted(target);
  }
  return octree;
}

void octree_uniform(benchmark::State& state) {
  for (auto _ : state) {
    benchmark::DoNotOptimize(Octree::uniform(Volume{}, static_cast<int>(state.range(0))));
  }
}
BENCHMARK(octree_uniform)->Arg(7)->Unit(benchmark::kMillisecond);

void octree_faces(benchmark::State& state) {
  const Octree octree = banded_octree(8);
  std::size_t faces = 0;
  for (auto _ : state) faces = octree.faces().size();
  state.counters["faces"] = static_cast<double>(faces);
}
BENCHMARK(octree_faces)->Unit(benchmark::kMillisecond);

void vote_uniform(benchmark::State& state) {
  const Octree octree = Octree::uniform(Volume{}, static_cast<int>(state.range(0)));
  const Voter voter(observations(), VoteOptions{});
  for (auto _ : state) benchmark::DoNotOptimize(voter.vote(octree, nullptr, kNobody));
  state.counters["hypotheses/s"] =
      benchmark::Counter(static_cast<double>(voter.hypotheses()), benchmark::Counter::kIsRate);
}
BENCHMARK(vote_uniform)->Arg(7)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();

void vote_band(benchmark::State& state) {
  const Octree octree = banded_octree(static_cast<int>(state.range(0)));
  const Voter voter(observations(), VoteOptions{});
  for (auto _ : state) benchmark::DoNotOptimize(voter.vote(octree, nullptr, kNobody));
  state.counters["leaves"] = static_cast<double>(octree.size());
  state.counters["hypotheses/s"] =
      benchmark::Counter(static_cast<double>(voter.hypotheses()), benchmark::Counter::kIsRate);
}
BENCHMARK(vote_band)->Arg(8)->Arg(9)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();

void depth(benchmark::State& state) {
  const Octree octree = banded_octree(8);
  const Voter voter(observations(), VoteOptions{});
  const auto field = voter.vote(octree, nullptr, kNobody);
  std::vector<std::uint32_t> leaves;
  std::vector<Eigen::Vector3f> normals;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (std::abs(analytic::distance_mm(kSphere, octree.centre_mm(i))) > 0.4 ||
        field->consistency[i] <= 0) {
      continue;
    }
    leaves.push_back(static_cast<std::uint32_t>(i));
    normals.push_back(field->normal[i]);
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(refine_depth(observations(), VoteOptions{}, DepthOptions{},
                                          voter.noise_rad(), octree, leaves, normals, kNobody));
  }
  state.counters["leaves/s"] = benchmark::Counter(static_cast<double>(leaves.size()),
                                                  benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(depth)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();

/// Votes of which a third agree.
struct Votes {
  std::vector<float> x, y, z;
  std::size_t count;

  explicit Votes(std::size_t size) : count(size) {
    std::mt19937 random(1);
    std::normal_distribution<float> normal(0, 1);
    for (std::size_t i = 0; i < size; ++i) {
      Eigen::Vector3f n(normal(random), normal(random), normal(random));
      if (i % 3 == 0) n = Eigen::Vector3f(0.3F, 0.4F, 0.8F) + 0.003F * n;
      n.normalize();
      x.push_back(n.x());
      y.push_back(n.y());
      z.push_back(n.z());
    }
    for (std::vector<float>* list : {&x, &y, &z}) list->resize(size + kernels::kPadding, 0);
  }
};

void mean_shift(benchmark::State& state) {
  Votes votes(static_cast<std::size_t>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(kernels::mean_shift(votes.x.data(), votes.y.data(), votes.z.data(),
                                                 votes.count, 0.01F, 1.2F));
  }
}
void mean_shift_epanechnikov(benchmark::State& state) {
  Votes votes(static_cast<std::size_t>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(kernels::mean_shift_epanechnikov(
        votes.x.data(), votes.y.data(), votes.z.data(), votes.count, 0.01F, 1.2F));
  }
}
void histogram(benchmark::State& state) {
  Votes votes(static_cast<std::size_t>(state.range(0)));
  std::vector<std::uint64_t> scratch(votes.count);
  for (auto _ : state) {
    benchmark::DoNotOptimize(kernels::histogram_mode(votes.x.data(), votes.y.data(), votes.z.data(),
                                                     votes.count, 0.01F, scratch.data()));
  }
}
BENCHMARK(mean_shift_epanechnikov)->Arg(8)->Arg(24)->Arg(100)->Arg(400);
BENCHMARK(histogram)->Arg(8)->Arg(24)->Arg(100)->Arg(400);
BENCHMARK(mean_shift)->Arg(8)->Arg(24)->Arg(100)->Arg(400);

/// One block of 512 points against one map that all of them fall into.
void look_up(benchmark::State& state) {
  constexpr std::size_t kPoints = 512;
  constexpr int kSide = 64;
  std::vector<float> uv(2 * kSide * kSide, 500);
  std::vector<std::uint32_t> cells(kSide * kSide / 32, ~0u);
  kernels::MapView map;
  std::vector<std::int32_t> row_pair;
  row_pair.reserve(kSide);
  for (int y = 0; y < kSide; ++y) row_pair.push_back(y * kSide);
  map.uv_px = uv.data();
  map.row_pair = row_pair.data();
  map.cells = cells.data();
  map.width = map.height = kSide;
  const float origin[3] = {-250, 400, 150}, u[3] = {0.27F, 0, 0}, v[3] = {0, 0, -0.27F};
  const float eye[3] = {600, -30, 200};
  for (int axis = 0; axis < 3; ++axis) {
    map.origin_mm[axis] = origin[axis];
    map.u_mm[axis] = u[axis];
    map.v_mm[axis] = v[axis];
    map.eye_mm[axis] = eye[axis];
  }
  const kernels::LocalProjection projection{{32, 6, -1, 0.5F, 0.02F, -0.01F, 0, 0, 0, 0},
                                            {32, 0.4F, 5, -0.7F, 0.01F, 0.02F, 0, 0, 0, 0}};
  std::vector<float> x(kPoints + kernels::kPadding), y(x), z(x), px(x), py(x), nx(x), ny(x), nz(x);
  std::vector<float> scratch(3 * x.size());
  std::vector<std::uint32_t> point(x.size());
  for (std::size_t i = 0; i < kPoints; ++i) {  // Morton order of an 8³ node of 0.4 mm leaves
    const auto bits = [i](std::size_t axis) {
      return static_cast<float>((i >> axis & 1) | (i >> (axis + 2) & 2) | (i >> (axis + 4) & 4));
    };
    x[i] = 0.4F * bits(0) - 1.4F;
    y[i] = 0.4F * bits(1) - 1.4F;
    z[i] = 0.4F * bits(2) - 1.4F;
  }
  for (auto _ : state) {
    kernels::project(projection, x.data(), y.data(), z.data(), kPoints, px.data(), py.data());
    benchmark::DoNotOptimize(kernels::look_up(map, x.data(), y.data(), z.data(), px.data(),
                                              py.data(), kPoints, scratch.data(),
                                              {point.data(), nx.data(), ny.data(), nz.data()}));
  }
  state.counters["votes/s"] = benchmark::Counter(static_cast<double>(kPoints),
                                                 benchmark::Counter::kIsIterationInvariantRate);
  state.SetLabel(hwy::TargetName(hwy::SupportedTargets() & -hwy::SupportedTargets()));
}
BENCHMARK(look_up);

}  // namespace
}  // namespace alhazen
