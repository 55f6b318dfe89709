#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "reconstruct/vote/octree.h"

namespace alhazen {

/// The octree's faces as the cut needs them: each node owns one slot per face it touches. Only
/// leaves that are free, or touch one that is, are nodes (and their siblings, to keep octets
/// whole); the others are outside whatever happens. Lengths in units of the finest leaf's edge.
/// Immutable.
///
/// The operator K maps u (per node) to slots, (K u)_s = c_s (u_j − u_i) with slot s = (i, f) and
/// c_s = V_i √(A_f / 2A_i) / d_f. On a 2:1 balanced octree c_s = e_i² / √2 towards a neighbour of
/// the same size and e_i² √2 / 3 towards any other.
///
/// Eight siblings that all are leaves are an octet, and nearly all leaves belong to one. Nodes
/// 8o … 8o + 7 are octet o in Morton order; sibling k has, along each axis, one neighbour in the
/// octet and one in the octet beside it, and both are sibling k ^ (1 << axis) there. So the slots
/// of an octet need no index: its 48 lie in six rows of eight, row 2·axis towards the sibling, row
/// 2·axis + 1 outward. Faces that do not join two octets so have extra slots, listed by node.
class FlowGraph {
 public:
  static constexpr std::uint32_t kNone = 0xffffffffU;
  static constexpr std::size_t kRows = 6, kOctet = 8, kSlots = kRows * kOctet;
  static constexpr double kSame = 0.70710678118654752440;   ///< c_s/e_i², same size: 1/√2
  static constexpr double kOther = 0.47140452079103168293;  ///< c_s/e_i², other size: √2/3

  /// `fixed[i]` ≠ 0: leaf i is outside for good.
  FlowGraph(const Octree& octree, const std::vector<Face>& faces,
            const std::vector<std::uint8_t>& fixed);

  [[nodiscard]] std::size_t nodes() const noexcept { return leaf_.size(); }
  [[nodiscard]] std::size_t octets() const noexcept { return beside_.size(); }
  [[nodiscard]] std::size_t slots() const noexcept { return kSlots * octets() + extra_.size(); }
  [[nodiscard]] std::uint32_t leaf(std::size_t node) const { return leaf_[node]; }
  [[nodiscard]] bool is_fixed(std::size_t node) const { return fixed_[node] != 0; }
  /// Edge of the node's leaf, in finest edges.
  [[nodiscard]] float edge(std::size_t node) const { return edge_[node]; }
  /// The octet at -x +x -y +y -z +z of an octet; kNone: its faces there have extra slots or do not
  /// count.
  [[nodiscard]] const std::array<std::uint32_t, kRows>& beside(std::size_t octet) const {
    return beside_[octet];
  }

  struct Extra {
    std::uint32_t neighbour, twin;
    bool is_other_size;
  };
  /// The extra slots of a node; slot kSlots·octets() + k is extra k.
  [[nodiscard]] std::size_t first_extra(std::size_t node) const { return row_[node]; }
  [[nodiscard]] std::size_t end_extra(std::size_t node) const { return row_[node + 1]; }
  [[nodiscard]] const Extra& extra(std::size_t k) const { return extra_[k]; }
  [[nodiscard]] std::size_t slot_of_extra(std::size_t k) const { return kSlots * octets() + k; }

  /// Calls visit(slot, neighbour's node, the slot of the same face that the neighbour owns, c_s)
  /// for each slot of a node.
  template <class Visit>
  void for_each_slot(std::size_t node, const Visit& visit) const {
    const double area = static_cast<double>(edge_[node]) * edge_[node];
    const std::size_t octet = node / kOctet, k = node % kOctet;
    for (std::size_t axis = 0; octet < octets() && axis < 3; ++axis) {
      const std::size_t mirrored = k ^ (std::size_t{1} << axis);
      const std::size_t inner = 2 * axis * kOctet, outer = inner + kOctet;
      visit(octet * kSlots + inner + k, octet * kOctet + mirrored,
            octet * kSlots + inner + mirrored, area * kSame);
      const std::size_t other = beside_[octet][2 * axis + (k >> axis & 1)];
      if (other == kNone) continue;
      visit(octet * kSlots + outer + k, other * kOctet + mirrored,
            other * kSlots + outer + mirrored, area * kSame);
    }
    for (std::size_t e = row_[node]; e < row_[node + 1]; ++e) {
      visit(slot_of_extra(e), std::size_t{extra_[e].neighbour}, std::size_t{extra_[e].twin},
            area * (extra_[e].is_other_size ? kOther : kSame));
    }
  }

 private:
  std::vector<std::uint32_t> leaf_;
  std::vector<std::uint8_t> fixed_;
  std::vector<float> edge_;
  std::vector<std::array<std::uint32_t, kRows>> beside_;  ///< per octet
  std::vector<std::uint32_t> row_;
  std::vector<Extra> extra_;
};

}  // namespace alhazen
