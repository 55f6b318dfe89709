#include "reconstruct/surface/flow_graph.h"

#include <algorithm>

#include "alhazen/check.h"

namespace alhazen {

FlowGraph::FlowGraph(const Octree& octree, const std::vector<Face>& faces,
                     const std::vector<std::uint8_t>& fixed) {
  const std::vector<Leaf>& leaves = octree.leaves();
  ALHAZEN_CHECK(fixed.size() == leaves.size());
  std::vector<std::uint8_t> wanted(leaves.size(), 0);
  for (const Face& face : faces)
    if (fixed[face.a] == 0 || fixed[face.b] == 0) wanted[face.a] = wanted[face.b] = 1;

  int finest = 0;
  for (const Leaf& leaf : leaves) finest = std::max(finest, static_cast<int>(leaf.level));
  std::vector<std::uint32_t> node_of(leaves.size(), kNoNode);
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    if (wanted[i] == 0) continue;
    node_of[i] = static_cast<std::uint32_t>(leaf_.size());
    leaf_.push_back(static_cast<std::uint32_t>(i));
    fixed_.push_back(fixed[i] != 0 ? 1 : 0);
    edge_.push_back(static_cast<float>(1 << (finest - leaves[i].level)));
  }

  // A face between two fixed leaves never carries anything: it gets no slots.
  const auto is_live = [&](const Face& face) { return fixed[face.a] == 0 || fixed[face.b] == 0; };
  row_.assign(nodes() + 1, 0);
  for (const Face& face : faces) {
    if (!is_live(face)) continue;
    ++row_[node_of[face.a] + 1];
    ++row_[node_of[face.b] + 1];
  }
  for (std::size_t n = 0; n < nodes(); ++n) row_[n + 1] += row_[n];
  neighbour_.resize(row_.back());
  twin_.resize(row_.back());
  std::vector<std::uint32_t> next(row_.begin(), row_.end() - 1);
  for (const Face& face : faces) {
    if (!is_live(face)) continue;
    const std::uint32_t a = node_of[face.a], b = node_of[face.b];
    const std::uint32_t slot_a = next[a]++, slot_b = next[b]++;
    const std::uint32_t other = leaves[face.a].level == leaves[face.b].level ? 0U : kOtherSize;
    neighbour_[slot_a] = b | other;
    neighbour_[slot_b] = a | other;
    twin_[slot_a] = slot_b;
    twin_[slot_b] = slot_a;
  }
}

}  // namespace alhazen
