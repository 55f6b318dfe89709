#include "reconstruct/surface/flow_graph.h"

#include <algorithm>

#include "alhazen/check.h"

namespace alhazen {
namespace {

/// Whether leaves i … i + 7 are the eight children of one parent.
[[nodiscard]] bool is_octet(const std::vector<Leaf>& leaves, std::size_t i) {
  if (i + FlowGraph::kOctet > leaves.size()) return false;
  const Leaf &first = leaves[i], &last = leaves[i + 7];
  // In Morton order nothing but the other six fits between the first child and the last.
  return first.level == last.level && first.level > 0 && first.x % 2 == 0 && first.y % 2 == 0 &&
         first.z % 2 == 0 && last.x == first.x + 1 && last.y == first.y + 1 &&
         last.z == first.z + 1;
}

}  // namespace

FlowGraph::FlowGraph(const Octree& octree, const std::vector<Face>& faces,
                     const std::vector<std::uint8_t>& fixed) {
  const std::vector<Leaf>& leaves = octree.leaves();
  ALHAZEN_CHECK(fixed.size() == leaves.size());
  // A face between two fixed leaves never carries anything.
  const auto is_live = [&](const Face& face) { return fixed[face.a] == 0 || fixed[face.b] == 0; };
  std::vector<std::uint8_t> is_wanted(leaves.size(), 0);
  for (const Face& face : faces)
    if (is_live(face)) is_wanted[face.a] = is_wanted[face.b] = 1;

  std::vector<std::uint32_t> node_of(leaves.size(), kNone);
  const auto add_node = [&](std::size_t i) {
    node_of[i] = static_cast<std::uint32_t>(leaf_.size());
    leaf_.push_back(static_cast<std::uint32_t>(i));
    fixed_.push_back(fixed[i] != 0 ? 1 : 0);
    edge_.push_back(static_cast<float>(1 << (octree.finest_level() - leaves[i].level)));
  };
  std::vector<std::uint32_t> single;
  for (std::size_t i = 0; i < leaves.size();) {
    if (!is_octet(leaves, i)) {
      if (is_wanted[i] != 0) single.push_back(static_cast<std::uint32_t>(i));
      ++i;
      continue;
    }
    const auto first = is_wanted.begin() + static_cast<std::ptrdiff_t>(i);
    if (std::find(first, first + kOctet, 1) != first + kOctet)
      for (std::size_t k = 0; k < kOctet; ++k) add_node(i + k);
    i += kOctet;
  }
  const std::size_t octet_nodes = leaf_.size();
  beside_.resize(octet_nodes / kOctet);
  for (std::array<std::uint32_t, kRows>& sides : beside_) sides.fill(kNone);
  for (const std::uint32_t i : single) add_node(i);

  // Faces between octets of one size are where the octets' rows have them; the others need slots.
  std::vector<std::uint32_t> extra_face;
  row_.assign(nodes() + 1, 0);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const Face& face = faces[f];
    const std::uint32_t a = node_of[face.a], b = node_of[face.b];
    if (a == kNone || b == kNone) continue;
    const bool is_between_octets =
        a < octet_nodes && b < octet_nodes && leaves[face.a].level == leaves[face.b].level;
    if (is_between_octets) {
      const auto octet_a = static_cast<std::uint32_t>(a / kOctet);
      const auto octet_b = static_cast<std::uint32_t>(b / kOctet);
      if (octet_a == octet_b) continue;
      beside_[octet_a][2 * std::size_t{face.axis} + 1] = octet_b;
      beside_[octet_b][2 * std::size_t{face.axis}] = octet_a;
    } else if (is_live(face)) {
      extra_face.push_back(static_cast<std::uint32_t>(f));
      ++row_[a + 1];
      ++row_[b + 1];
    }
  }
  for (std::size_t n = 0; n < nodes(); ++n) row_[n + 1] += row_[n];
  extra_.resize(row_.back());
  std::vector<std::uint32_t> next(row_.begin(), row_.end() - 1);
  const auto base = static_cast<std::uint32_t>(kSlots * octets());
  for (const std::uint32_t f : extra_face) {
    const Face& face = faces[f];
    const std::uint32_t a = node_of[face.a], b = node_of[face.b];
    const std::uint32_t at_a = next[a]++, at_b = next[b]++;
    const bool is_other_size = leaves[face.a].level != leaves[face.b].level;
    extra_[at_a] = {b, base + at_b, is_other_size};
    extra_[at_b] = {a, base + at_a, is_other_size};
  }
}

}  // namespace alhazen
