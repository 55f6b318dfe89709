#include "reconstruct/surface/min_cut.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "reconstruct/surface/flow_graph.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

constexpr int kIterationsBetweenGaps = 10;
/// Below this size an octree is solved from nothing; above it, a coarser one is solved first.
constexpr std::size_t kSmall = 5000;

/// The energy of each leaf, its constants folded in.
struct Energy {
  std::vector<float> g;         ///< weight of the surface term
  std::vector<float> volume_f;  ///< V_i f_i
  std::vector<std::uint8_t> fixed;
};

/// Four floats that are worked on at once, in the compilers' common vector extension.
using Four = float __attribute__((vector_size(16)));

[[nodiscard]] Four load(const float* from) {
  Four v;
  __builtin_memcpy(&v, from, sizeof v);
  return v;
}
void store(const Four& v, float* to) { __builtin_memcpy(to, &v, sizeof v); }

/// One value per sibling of an octet.
struct Eight {
  Four low, high;

  [[nodiscard]] static Eight at(const float* from) { return {load(from), load(from + 4)}; }
  [[nodiscard]] static Eight zero() { return {Four{}, Four{}}; }
  void to(float* there) const {
    store(low, there);
    store(high, there + 4);
  }
  friend Eight operator+(const Eight& a, const Eight& b) {
    return {a.low + b.low, a.high + b.high};
  }
  friend Eight operator-(const Eight& a, const Eight& b) {
    return {a.low - b.low, a.high - b.high};
  }
  friend Eight operator*(const Eight& a, const Eight& b) {
    return {a.low * b.low, a.high * b.high};
  }
};

/// Sibling k gets the value of sibling k ^ (1 << axis).
template <int kAxis>
[[nodiscard]] Eight mirrored(const Eight& v) {
  if constexpr (kAxis == 0) {
    return {__builtin_shufflevector(v.low, v.low, 1, 0, 3, 2),
            __builtin_shufflevector(v.high, v.high, 1, 0, 3, 2)};
  } else if constexpr (kAxis == 1) {
    return {__builtin_shufflevector(v.low, v.low, 2, 3, 0, 1),
            __builtin_shufflevector(v.high, v.high, 2, 3, 0, 1)};
  } else {
    return {v.high, v.low};
  }
}

/// Sibling k gets the value of sibling k ^ (1 << axis) of the octet that it looks out to: `before`
/// where its own offset along the axis is 0, else `behind`.
template <int kAxis>
[[nodiscard]] Eight outer(const Eight& before, const Eight& behind) {
  if constexpr (kAxis == 0) {
    return {__builtin_shufflevector(before.low, behind.low, 1, 4, 3, 6),
            __builtin_shufflevector(before.high, behind.high, 1, 4, 3, 6)};
  } else if constexpr (kAxis == 1) {
    return {__builtin_shufflevector(before.low, behind.low, 2, 3, 4, 5),
            __builtin_shufflevector(before.high, behind.high, 2, 3, 4, 5)};
  } else {
    return {before.high, behind.low};
  }
}

/// Primal u per node, dual p per slot, kept as the flow q_s = c_s p_s that leaves the node.
class PrimalDual {
 public:
  PrimalDual(const Octree& octree, const std::vector<Face>& faces, const Energy& energy,
             const std::vector<float>& start)
      : graph_(octree, faces, energy.fixed) {
    const std::size_t n = graph_.nodes();
    u_.resize(n);
    volume_f_.resize(n);
    tau_.resize(n);
    step_.resize(n);
    radius_.resize(n);
    own_.assign(n, 0.0F);
    q_.assign(graph_.slots(), 0.0F);
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const std::uint32_t leaf = graph_.leaf(i);
        u_[i] = graph_.is_fixed(i) ? 0.0F : start[leaf];
        volume_f_[i] = energy.volume_f[leaf];
        // Diagonal steps of Pock and Chambolle with exponent 1: one over the absolute row sum of K
        // (the largest of the leaf's, so that its projection stays a ball's) and column sum.
        double largest = 0, column = 0;
        graph_.for_each_slot(i, [&](std::size_t, std::size_t j, std::size_t, double c) {
          const double c_same_ratio = graph_.edge(j) / graph_.edge(i);
          largest = std::max(largest, c);
          column += c + c * c_same_ratio * c_same_ratio;
        });
        const double c_same = same(i);
        radius_[i] = static_cast<float>(energy.g[leaf] * c_same);
        step_[i] = largest > 0 ? static_cast<float>(c_same * c_same / (2 * largest)) : 0.0F;
        tau_[i] = graph_.is_fixed(i) || column <= 0 ? 0.0F : static_cast<float>(1 / column);
      }
    });
    u_bar_ = u_;
    start_flow();
  }

  void iterate() {
    for_octets([&](std::size_t octet) { dual_octet(octet); },
               [&](std::size_t node) { dual_single(node); });
    for_octets([&](std::size_t octet) { primal_octet(octet); },
               [&](std::size_t node) { primal_single(node); });
  }

  struct Bounds {
    double surface, primal, dual;
  };
  [[nodiscard]] Bounds bounds() const {
    const std::array<double, 3> sums =
        sum_blocks<3>(graph_.nodes(), [&](std::size_t begin, std::size_t end) {
          double surface = 0, linear = 0, dual = 0;
          for (std::size_t i = begin; i < end; ++i) {
            double adjoint = 0;
            graph_.for_each_slot(i, [&](std::size_t s, std::size_t, std::size_t twin, double) {
              adjoint += static_cast<double>(q_[twin]) - q_[s];
            });
            surface += radius_[i] / same(i) * slope(i);
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
  /// (c of a slot towards another size / c of one towards the same)².
  static constexpr float kOtherShare = 4.0F / 9.0F;

  [[nodiscard]] double same(std::size_t node) const {
    return static_cast<double>(graph_.edge(node)) * graph_.edge(node) * FlowGraph::kSame;
  }

  /// ‖(K u)_i‖ over the node's slots.
  [[nodiscard]] double slope(std::size_t node) const {
    double square = 0;
    graph_.for_each_slot(node, [&](std::size_t, std::size_t j, std::size_t, double c) {
      const double y = c * (static_cast<double>(u_[j]) - u_[node]);
      square += y * y;
    });
    return std::sqrt(square);
  }

  template <class OfOctet, class OfSingle>
  void for_octets(const OfOctet& of_octet, const OfSingle& of_single) {
    for_blocks(graph_.nodes(), [&](std::size_t begin, std::size_t end) {
      const std::size_t octet_nodes = FlowGraph::kOctet * graph_.octets();
      std::size_t i = begin;  // blocks begin at whole octets
      for (; i < std::min(end, octet_nodes); i += FlowGraph::kOctet)
        of_octet(i / FlowGraph::kOctet);
      for (; i < end; ++i) of_single(i);
    });
  }

  /// Where u has a slope, the best flow is known: g along it. A warm start without a warm flow
  /// would lose most of what u knows in its first steps.
  void start_flow() {
    for_blocks(graph_.nodes(), [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const double steepness = slope(i);
        if (steepness < 1e-2 * same(i)) continue;
        const double scale = radius_[i] / (same(i) * steepness);
        double sum = 0;
        graph_.for_each_slot(i, [&](std::size_t s, std::size_t j, std::size_t, double c) {
          q_[s] = static_cast<float>(c * scale * c * (static_cast<double>(u_[j]) - u_[i]));
          sum += q_[s];
        });
        own_[i] = static_cast<float>(sum);
      }
    });
  }

  // Dual step: p_i ← projection of p_i + σ_i (K ū)_i onto ‖p_i‖ ≤ g_i. In terms of q and with
  // step = σ c², radius = g c for c towards the same size: q += step·(c_s/c)² (ū_j − ū_i), and the
  // norm is that of q_s c/c_s.

  /// The extra slots of a node: their share of the squared norm.
  [[nodiscard]] float step_extras(std::size_t node) {
    float square = 0;
    for (std::size_t e = graph_.first_extra(node); e < graph_.end_extra(node); ++e) {
      const FlowGraph::Extra& extra = graph_.extra(e);
      const float share = extra.is_other_size ? kOtherShare : 1.0F;
      float& q = q_[graph_.slot_of_extra(e)];
      q += step_[node] * share * (u_bar_[extra.neighbour] - u_bar_[node]);
      square += q * q / share;
    }
    return square;
  }
  /// Scales them; their sum.
  [[nodiscard]] float scale_extras(std::size_t node, float scale) {
    float sum = 0;
    for (std::size_t e = graph_.first_extra(node); e < graph_.end_extra(node); ++e)
      sum += q_[graph_.slot_of_extra(e)] *= scale;
    return sum;
  }
  void dual_single(std::size_t node) {
    const float square = step_extras(node);
    const float radius = radius_[node];
    own_[node] = scale_extras(node, square > radius * radius ? radius / std::sqrt(square) : 1.0F);
  }

  template <int kAxis>
  void step_axis(std::size_t octet, const Eight& here, const Eight& step,
                 std::array<Eight, FlowGraph::kRows>& q, Eight& square) const {
    const std::array<std::uint32_t, FlowGraph::kRows>& beside = graph_.beside(octet);
    const Eight inside = mirrored<kAxis>(here);
    const auto beyond = [&](std::uint32_t other) {
      // No octet there: whoever looks out sees its own value, so that its slot stays 0.
      return other == FlowGraph::kNone ? inside : Eight::at(&u_bar_[other * FlowGraph::kOctet]);
    };
    const Eight outside = outer<kAxis>(beyond(beside[2 * kAxis]), beyond(beside[2 * kAxis + 1]));
    const float* row = &q_[octet * FlowGraph::kSlots + 2 * kAxis * FlowGraph::kOctet];
    q[2 * kAxis] = Eight::at(row) + step * (inside - here);
    q[2 * kAxis + 1] = Eight::at(row + FlowGraph::kOctet) + step * (outside - here);
    square = square + q[2 * kAxis] * q[2 * kAxis] + q[2 * kAxis + 1] * q[2 * kAxis + 1];
  }

  void dual_octet(std::size_t octet) {
    const std::size_t first = octet * FlowGraph::kOctet;
    const Eight here = Eight::at(&u_bar_[first]), step = Eight::at(&step_[first]);
    std::array<Eight, FlowGraph::kRows> q;
    Eight square = Eight::zero();
    step_axis<0>(octet, here, step, q, square);
    step_axis<1>(octet, here, step, q, square);
    step_axis<2>(octet, here, step, q, square);
    const bool has_extras =
        graph_.first_extra(first) != graph_.first_extra(first + FlowGraph::kOctet);
    Eigen::Array<float, 8, 1> squares, scales;
    square.to(squares.data());
    for (std::size_t k = 0; has_extras && k < FlowGraph::kOctet; ++k)
      squares[static_cast<Eigen::Index>(k)] += step_extras(first + k);
    const Eigen::Map<const Eigen::Array<float, 8, 1>> radius(&radius_[first]);
    // 1 where the ball is kept; the tiny number only keeps 0/0 away.
    scales = (radius / (squares + 1e-30F).sqrt()).min(1.0F);
    const Eight scale = Eight::at(scales.data());
    Eight sum = Eight::zero();
    for (std::size_t row = 0; row < FlowGraph::kRows; ++row) {
      q[row] = q[row] * scale;
      q[row].to(&q_[octet * FlowGraph::kSlots + row * FlowGraph::kOctet]);
      sum = sum + q[row];
    }
    sum.to(&own_[first]);
    for (std::size_t k = 0; has_extras && k < FlowGraph::kOctet; ++k)
      own_[first + k] += scale_extras(first + k, scales[static_cast<Eigen::Index>(k)]);
  }

  // Primal step: u ← clip(u − τ (V f + Kᵀp)), ū = 2u_new − u_old. Kᵀp: what flows in less what
  // flows out.

  [[nodiscard]] float inflow_by_extras(std::size_t node) const {
    float sum = 0;
    for (std::size_t e = graph_.first_extra(node); e < graph_.end_extra(node); ++e)
      sum += q_[graph_.extra(e).twin];
    return sum;
  }
  void primal_single(std::size_t node) {
    const float before = u_[node];
    const float adjoint = inflow_by_extras(node) - own_[node];
    u_[node] = std::clamp(before - tau_[node] * (volume_f_[node] + adjoint), 0.0F, 1.0F);
    u_bar_[node] = 2 * u_[node] - before;
  }

  template <int kAxis>
  [[nodiscard]] Eight inflow(std::size_t octet) const {
    const std::array<std::uint32_t, FlowGraph::kRows>& beside = graph_.beside(octet);
    constexpr std::size_t kInner = 2 * kAxis * FlowGraph::kOctet;
    const auto from = [&](std::uint32_t other) {
      return other == FlowGraph::kNone
                 ? Eight::zero()
                 : Eight::at(&q_[other * FlowGraph::kSlots + kInner + FlowGraph::kOctet]);
    };
    return mirrored<kAxis>(Eight::at(&q_[octet * FlowGraph::kSlots + kInner])) +
           outer<kAxis>(from(beside[2 * kAxis]), from(beside[2 * kAxis + 1]));
  }

  void primal_octet(std::size_t octet) {
    const std::size_t first = octet * FlowGraph::kOctet;
    using Values = Eigen::Array<float, 8, 1>;
    Values adjoint;
    (inflow<0>(octet) + inflow<1>(octet) + inflow<2>(octet) - Eight::at(&own_[first]))
        .to(adjoint.data());
    if (graph_.first_extra(first) != graph_.first_extra(first + FlowGraph::kOctet))
      for (std::size_t k = 0; k < FlowGraph::kOctet; ++k)
        adjoint[static_cast<Eigen::Index>(k)] += inflow_by_extras(first + k);
    const Eigen::Map<const Values> tau(&tau_[first]), volume_f(&volume_f_[first]);
    Eigen::Map<Values> u(&u_[first]), u_bar(&u_bar_[first]);
    const Values now = (u - tau * (volume_f + adjoint)).max(0.0F).min(1.0F);
    u_bar = 2.0F * now - u;
    u = now;
  }

  FlowGraph graph_;
  std::vector<float> u_, u_bar_, volume_f_, tau_;
  std::vector<float> step_, radius_;  ///< of the dual step, see there
  std::vector<float> q_;              ///< per slot
  std::vector<float> own_;            ///< per node: Σ q over its own slots
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
