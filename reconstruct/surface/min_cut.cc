#include "reconstruct/surface/min_cut.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "reconstruct/surface/blocks.h"
#include "reconstruct/surface/flow_graph.h"

namespace alhazen {
namespace {

/// Primal steps over dual steps. Any positive number converges; this one was the fastest on
/// spheres, tori and noisy fields of 32³ to 128³ (tests/bench/surface_bench.cc).
constexpr float kStepRatio = 1.0F;
constexpr int kIterationsBetweenGaps = 10;
/// Below this size an octree is solved from nothing; above it, a coarser one is solved first.
constexpr std::size_t kSmall = 5000;

/// The energy of each leaf, its constants folded in.
struct Energy {
  std::vector<float> g;         ///< weight of the surface term
  std::vector<float> volume_f;  ///< V_i f_i
  std::vector<std::uint8_t> fixed;
};

class PrimalDual {
 public:
  PrimalDual(const Octree& octree, const std::vector<Face>& faces, const Energy& energy,
             const std::vector<float>& start)
      : graph_(octree, faces, energy.fixed) {
    const std::size_t n = graph_.nodes();
    u_.resize(n);
    g_.resize(n);
    volume_f_.resize(n);
    tau_.resize(n);
    sigma_.resize(n);
    q_.assign(graph_.slots(), 0.0F);
    own_.assign(n, 0.0F);
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const std::uint32_t leaf = graph_.leaf(i);
        u_[i] = graph_.is_fixed(i) ? 0.0F : start[leaf];
        g_[i] = energy.g[leaf];
        volume_f_[i] = energy.volume_f[leaf];
        // Diagonal steps of Pock and Chambolle with exponent 1: one over the absolute row sum of K
        // (the largest of the leaf's, so that its projection stays a ball's) and column sum.
        float largest = 0, column = 0;
        for (std::size_t s = graph_.row(i); s < graph_.row_end(i); ++s) {
          const float own = graph_.coefficient<float>(i, s);
          const float theirs = graph_.coefficient<float>(graph_.neighbour(s), graph_.twin(s));
          largest = std::max(largest, own);
          column += own + theirs;
        }
        sigma_[i] = 1.0F / (kStepRatio * 2.0F * largest);
        tau_[i] = graph_.is_fixed(i) ? 0.0F : kStepRatio / column;
      }
    });
    u_bar_ = u_;
    start_flow();
  }

  void iterate() {
    for_blocks(graph_.nodes(), [&](std::size_t begin, std::size_t end) { dual(begin, end); });
    for_blocks(graph_.nodes(), [&](std::size_t begin, std::size_t end) { primal(begin, end); });
  }

  struct Bounds {
    double surface, primal, dual;
  };
  [[nodiscard]] Bounds bounds() const {
    const std::array<double, 3> sums =
        sum_blocks<3>(graph_.nodes(), [&](std::size_t begin, std::size_t end) {
          double surface = 0, linear = 0, dual = 0;
          for (std::size_t i = begin; i < end; ++i) {
            double norm = 0, adjoint = 0;
            for (std::size_t s = graph_.row(i); s < graph_.row_end(i); ++s) {
              const double y = graph_.coefficient<double>(i, s) *
                               (static_cast<double>(u_[graph_.neighbour(s)]) - u_[i]);
              norm += y * y;
              adjoint += static_cast<double>(q_[graph_.twin(s)]) - q_[s];
            }
            surface += g_[i] * std::sqrt(norm);
            if (graph_.is_fixed(i)) continue;
            linear += static_cast<double>(volume_f_[i]) * u_[i];
            dual += std::min(0.0, volume_f_[i] + adjoint);
          }
          return std::array<double, 3>{surface, linear, dual};
        });
    return {sums[0], sums[0] + sums[1], sums[2]};
  }

  [[nodiscard]] std::vector<float> leaf_values(std::size_t leaves) const {
    std::vector<float> u(leaves, 0.0F);
    for (std::size_t i = 0; i < graph_.nodes(); ++i) u[graph_.leaf(i)] = u_[i];
    return u;
  }

 private:
  /// Where u has a slope, the best flow is known: g along it. A warm start without a warm flow
  /// would lose most of what u knows in its first steps.
  void start_flow() {
    for_blocks(graph_.nodes(), [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        double norm = 0;
        for (std::size_t s = graph_.row(i); s < graph_.row_end(i); ++s) {
          const double y = graph_.coefficient<double>(i, s) *
                           (static_cast<double>(u_[graph_.neighbour(s)]) - u_[i]);
          norm += y * y;
        }
        const double largest = 0.5 / static_cast<double>(sigma_[i] * kStepRatio);
        if (std::sqrt(norm) < 1e-2 * largest) continue;
        const double scale = g_[i] / std::sqrt(norm);
        float sum = 0;
        for (std::size_t s = graph_.row(i); s < graph_.row_end(i); ++s) {
          const double c = graph_.coefficient<double>(i, s);
          const double y = c * (static_cast<double>(u_[graph_.neighbour(s)]) - u_[i]);
          q_[s] = static_cast<float>(c * scale * y);
          sum += q_[s];
        }
        own_[i] = sum;
      }
    });
  }

  /// p_i ← projection of p_i + σ_i (K ū)_i onto ‖p_i‖ ≤ g_i, kept as q = c p.
  void dual(std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const float here = u_bar_[i];
      const float area = graph_.edge(i) * graph_.edge(i);
      // p is stepped in units of area / c: the same for all slots of one size.
      const float same = static_cast<float>(FlowGraph::kSame);
      const float other = static_cast<float>(FlowGraph::kOther);
      const float inverse_same = 1 / (area * same), inverse_other = 1 / (area * other);
      const float step_same = sigma_[i] * area * same, step_other = sigma_[i] * area * other;
      const std::size_t first = graph_.row(i), last = graph_.row_end(i);
      float norm = 0, sum = 0;
      for (std::size_t s = first; s < last; ++s) {
        const bool is_other = graph_.is_other_size(s);
        const float rise = u_bar_[graph_.neighbour(s)] - here;
        const float p = q_[s] * (is_other ? inverse_other : inverse_same) +
                        (is_other ? step_other : step_same) * rise;
        norm += p * p;
        const float q = p * area * (is_other ? other : same);
        q_[s] = q;
        sum += q;
      }
      if (norm > g_[i] * g_[i]) {
        const float shrink = g_[i] / std::sqrt(norm);
        for (std::size_t s = first; s < last; ++s) q_[s] *= shrink;
        sum *= shrink;
      }
      own_[i] = sum;
    }
  }

  /// u ← clip(u − τ (V f + Kᵀp)), ū = 2u_new − u_old.
  void primal(std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      float sum = -own_[i];
      for (std::size_t s = graph_.row(i); s < graph_.row_end(i); ++s) sum += q_[graph_.twin(s)];
      const float before = u_[i];
      const float now = std::clamp(before - tau_[i] * (volume_f_[i] + sum), 0.0F, 1.0F);
      u_[i] = now;
      u_bar_[i] = 2.0F * now - before;
    }
  }

  FlowGraph graph_;
  std::vector<float> u_, u_bar_, g_, volume_f_, tau_, sigma_;
  std::vector<float> q_;    ///< per slot: c p
  std::vector<float> own_;  ///< per node: Σ q over its own slots
};

[[nodiscard]] bool in_unit_range(const std::vector<float>& u) {
  return std::all_of(u.begin(), u.end(), [](float value) { return value >= 0 && value <= 1; });
}

/// Leaves that touch the volume's boundary: the object does not reach it.
[[nodiscard]] bool is_at_boundary(const Leaf& leaf) {
  const int last = (1 << leaf.level) - 1;
  return leaf.x == 0 || leaf.y == 0 || leaf.z == 0 || leaf.x == last || leaf.y == last ||
         leaf.z == last;
}

[[nodiscard]] Result<Indicator> solve(const Octree& octree, const std::vector<Face>& faces,
                                      const Energy& energy, const SurfaceOptions& options,
                                      const std::vector<float>& start, const Run& run) {
  PrimalDual method(octree, faces, energy, start);
  Indicator cut;
  for (;;) {
    const PrimalDual::Bounds bounds = method.bounds();
    cut.energy = bounds.primal;
    cut.gap = bounds.primal - bounds.dual;
    const bool is_done = cut.gap <= options.relative_gap * bounds.surface ||
                         cut.iterations >= options.max_iterations;
    if (is_done) break;
    const int batch = std::min(kIterationsBetweenGaps, options.max_iterations - cut.iterations);
    for (int k = 0; k < batch; ++k) {
      if (run.stopped()) return Error{Code::cancelled, "the cut was stopped"};
      method.iterate();
    }
    cut.iterations += batch;
    run.tell("cut", static_cast<double>(cut.iterations) / options.max_iterations);
  }
  cut.u = method.leaf_values(octree.size());
  return cut;
}

/// The same energy on the octree with its finest leaves merged, level by level, until it is small:
/// what is solved there first saves the thousands of iterations that information needs to cross a
/// fine grid.
[[nodiscard]] Result<std::vector<float>> coarse_start(const Octree& octree, const Energy& energy,
                                                      const SurfaceOptions& options,
                                                      const Run& run) {
  if (octree.size() <= kSmall) return std::vector<float>(octree.size(), 0.0F);
  std::vector<std::uint8_t> target(octree.size());
  for (std::size_t i = 0; i < octree.size(); ++i) {
    target[i] = static_cast<std::uint8_t>(
        std::min<int>(octree.leaves()[i].level, octree.finest_level() - 1));
  }
  const Octree coarse = octree.adapted(target);
  const std::vector<std::uint32_t> parent = octree.leaf_in(coarse);
  Energy coarse_energy{std::vector<float>(coarse.size(), 0.0F),
                       std::vector<float>(coarse.size(), 0.0F),
                       std::vector<std::uint8_t>(coarse.size(), 1)};
  // In the coarser octree's unit of length, twice this one's: V f shrinks by 2² (f carries one
  // length), g is a mean over the parent's volume.
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const std::uint32_t p = parent[i];
    const int levels = octree.leaves()[i].level - coarse.leaves()[p].level;
    coarse_energy.g[p] += energy.g[i] / static_cast<float>(1 << (3 * levels));
    coarse_energy.volume_f[p] += energy.volume_f[i] / 4;
    coarse_energy.fixed[p] = coarse_energy.fixed[p] != 0 && energy.fixed[i] != 0 ? 1 : 0;
  }
  const std::vector<float> start = ALHAZEN_TRY(coarse_start(coarse, coarse_energy, options, run));
  const Indicator cut =
      ALHAZEN_TRY(solve(coarse, coarse.faces(), coarse_energy, options, start, run));
  std::vector<float> fine(octree.size());
  for (std::size_t i = 0; i < octree.size(); ++i) fine[i] = cut.u[parent[i]];
  return fine;
}

}  // namespace

Result<Indicator> min_cut(const Octree& octree, const std::vector<Face>& faces,
                          const NormalField& field, const std::vector<float>& divergence,
                          const SurfaceOptions& options, const Indicator* warm_start,
                          const Run& run) {
  const std::size_t n = octree.size();
  const auto check = [n](std::size_t length, std::string_view name) -> Status {
    if (length == n) return {};
    return Error{Code::invalid, std::string(name) + " has " + std::to_string(length) +
                                    " values for " + std::to_string(n) + " leaves"};
  };
  ALHAZEN_TRY(check(field.consistency.size(), "consistency"));
  ALHAZEN_TRY(check(field.free_space.size(), "free_space"));
  ALHAZEN_TRY(check(divergence.size(), "divergence"));
  if (warm_start != nullptr) {
    ALHAZEN_TRY(check(warm_start->u.size(), "warm_start"));
    if (!in_unit_range(warm_start->u)) {
      return Error{Code::invalid, "warm_start has values outside 0 … 1"};
    }
  }

  const double unit_mm = octree.volume().edge_mm / static_cast<double>(1 << octree.finest_level());
  Energy energy{std::vector<float>(n), std::vector<float>(n), std::vector<std::uint8_t>(n)};
  for_blocks(n, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const double edge = octree.edge_mm(i) / unit_mm;
      energy.g[i] = static_cast<float>(
          std::max(options.g_min, std::exp(-options.beta * field.consistency[i])));
      energy.volume_f[i] =
          static_cast<float>(-options.lambda * divergence[i] * unit_mm * edge * edge * edge);
      energy.fixed[i] = field.free_space[i] != 0 || is_at_boundary(octree.leaves()[i]) ? 1 : 0;
    }
  });
  std::vector<float> start;
  if (warm_start == nullptr) {
    start = ALHAZEN_TRY(coarse_start(octree, energy, options, run));
  }
  return solve(octree, faces, energy, options, warm_start != nullptr ? warm_start->u : start, run);
}

}  // namespace alhazen
