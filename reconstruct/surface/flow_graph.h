#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "reconstruct/vote/octree.h"

namespace alhazen {

/// The octree's faces as the cut needs them: each node owns one slot per face it touches, in rows
/// (compressed sparse rows). Only leaves that are free, or touch one that is, are nodes; the others
/// are outside whatever happens. Lengths in units of the finest leaf's edge. Immutable.
///
/// The operator K maps u (per node) to slots, (K u)_s = c_s (u_j − u_i) with slot s = (i, f) and
/// c_s = V_i √(A_f / 2A_i) / d_f. On a 2:1 balanced octree c_s = e_i² / √2 towards a neighbour of
/// the same size and e_i² √2 / 3 towards any other.
class FlowGraph {
 public:
  static constexpr std::uint32_t kNoNode = 0xffffffffU;

  /// `fixed[i]` ≠ 0: leaf i is outside for good.
  FlowGraph(const Octree& octree, const std::vector<Face>& faces,
            const std::vector<std::uint8_t>& fixed);

  [[nodiscard]] std::size_t nodes() const noexcept { return leaf_.size(); }
  [[nodiscard]] std::size_t slots() const noexcept { return twin_.size(); }
  [[nodiscard]] std::uint32_t leaf(std::size_t node) const { return leaf_[node]; }
  [[nodiscard]] bool is_fixed(std::size_t node) const { return fixed_[node] != 0; }
  /// Edge of the node's leaf, in finest edges.
  [[nodiscard]] float edge(std::size_t node) const { return edge_[node]; }
  [[nodiscard]] std::size_t row(std::size_t node) const { return row_[node]; }
  [[nodiscard]] std::size_t row_end(std::size_t node) const { return row_[node + 1]; }
  [[nodiscard]] std::uint32_t neighbour(std::size_t slot) const {
    return neighbour_[slot] & ~kOtherSize;
  }
  /// The slot of the same face that the neighbour owns.
  [[nodiscard]] std::uint32_t twin(std::size_t slot) const { return twin_[slot]; }
  /// Whether the neighbour's leaf has another size.
  [[nodiscard]] bool is_other_size(std::size_t slot) const {
    return (neighbour_[slot] & kOtherSize) != 0;
  }
  /// c_s of a slot of this node.
  template <class Real>
  [[nodiscard]] Real coefficient(std::size_t node, std::size_t slot) const {
    const Real edge = static_cast<Real>(edge_[node]);
    return edge * edge * static_cast<Real>(is_other_size(slot) ? kOther : kSame);
  }

  /// (K u)_s / c_s: what u gains from `node` through its `slot`.
  template <class Real>
  [[nodiscard]] Real step(std::span<const Real> u, std::size_t node, std::size_t slot) const {
    return u[neighbour(slot)] - u[node];
  }
  /// (Kᵀ p)_node, given q_s = c_s p_s.
  template <class Real>
  [[nodiscard]] Real adjoint(std::span<const Real> q, std::size_t node) const {
    Real sum = 0;
    for (std::size_t s = row(node); s < row_end(node); ++s) sum += q[twin(s)] - q[s];
    return sum;
  }

  static constexpr double kSame = 0.70710678118654752440;   ///< 1/√2
  static constexpr double kOther = 0.47140452079103168293;  ///< √2/3

 private:
  static constexpr std::uint32_t kOtherSize = 0x80000000U;
  std::vector<std::uint32_t> leaf_;
  std::vector<std::uint8_t> fixed_;
  std::vector<float> edge_;
  std::vector<std::uint32_t> row_, neighbour_, twin_;
};

}  // namespace alhazen
