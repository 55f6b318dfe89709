#include "reconstruct/vote/octree.h"

#include <algorithm>
#include <cmath>

#include "alhazen/check.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

constexpr int kMax = Octree::kMaxLevel;

/// Spreads the lowest 21 bits to every third bit.
std::uint64_t spread(std::uint64_t v) {
  v &= 0x1fffff;
  v = (v | v << 32) & 0x1f00000000ffff;
  v = (v | v << 16) & 0x1f0000ff0000ff;
  v = (v | v << 8) & 0x100f00f00f00f00f;
  v = (v | v << 4) & 0x10c30c30c30c30c3;
  v = (v | v << 2) & 0x1249249249249249;
  return v;
}

/// The inverse of spread(): every third bit, gathered.
std::uint32_t gather(std::uint64_t v) {
  v &= 0x1249249249249249;
  v = (v | v >> 2) & 0x10c30c30c30c30c3;
  v = (v | v >> 4) & 0x100f00f00f00f00f;
  v = (v | v >> 8) & 0x1f0000ff0000ff;
  v = (v | v >> 16) & 0x1f00000000ffff;
  v = (v | v >> 32) & 0x1fffff;
  return static_cast<std::uint32_t>(v);
}

std::uint64_t key_of(std::uint32_t x, std::uint32_t y, std::uint32_t z) {
  return spread(x) | spread(y) << 1 | spread(z) << 2;
}

std::uint64_t key_of(const Leaf& leaf) {
  return key_of(leaf.x, leaf.y, leaf.z) << (3 * (kMax - leaf.level));
}

/// The leaf of `level` that starts at `key` of the finest grid.
Leaf leaf_of(std::uint64_t key, int level) {
  const std::uint64_t local = key >> (3 * (kMax - level));
  return {static_cast<std::uint16_t>(gather(local)), static_cast<std::uint16_t>(gather(local >> 1)),
          static_cast<std::uint16_t>(gather(local >> 2)), static_cast<std::uint8_t>(level)};
}

/// How many cells of the finest grid a leaf of `level` holds.
std::uint64_t cells_of(int level) { return std::uint64_t{1} << (3 * (kMax - level)); }

/// What the blocks found, one after the other.
template <class T>
std::vector<T> joined(std::vector<std::vector<T>> parts) {
  std::vector<std::size_t> start(parts.size() + 1, 0);
  for (std::size_t i = 0; i < parts.size(); ++i) start[i + 1] = start[i] + parts[i].size();
  std::vector<T> all(start.back());
  for_each_index(parts.size(), [&](std::size_t i) {
    std::copy(parts[i].begin(), parts[i].end(),
              all.begin() + static_cast<std::ptrdiff_t>(start[i]));
    std::vector<T>().swap(parts[i]);
  });
  return all;
}

}  // namespace

Octree::Octree(Volume volume, std::vector<Leaf> leaves)
    : volume_(std::move(volume)), leaves_(std::move(leaves)), keys_(leaves_.size()) {
  for_blocks(leaves_.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) keys_[i] = key_of(leaves_[i]);
  });
  for (const Leaf& leaf : leaves_) finest_level_ = std::max<int>(finest_level_, leaf.level);
  // Level 6 is 1 MiB of index and leaves at most 512 leaves of level 9 to search among.
  index_level_ = std::min(finest_level_, 6);
  const std::size_t entries = std::size_t{1} << (3 * index_level_);
  index_.resize(entries + 1);
  std::size_t leaf = 0;
  for (std::size_t e = 0; e < entries; ++e) {
    const std::uint64_t key = e * cells_of(index_level_);
    while (leaf + 1 < keys_.size() && keys_[leaf + 1] <= key) ++leaf;
    index_[e] = static_cast<std::uint32_t>(leaf);
  }
  index_[entries] = static_cast<std::uint32_t>(keys_.size() - 1);
}

Octree Octree::uniform(const Volume& volume, int level) {
  ALHAZEN_CHECK(level >= 0 && level <= kMaxLevel && volume.edge_mm > 0);
  std::vector<Leaf> leaves(std::size_t{1} << (3 * level));
  for_blocks(leaves.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) leaves[i] = leaf_of(i * cells_of(level), level);
  });
  return {volume, std::move(leaves)};
}

std::size_t Octree::find_key(std::uint64_t key) const {
  const std::uint64_t entry = key / cells_of(index_level_);
  // The leaf is the last that starts at or before the key.
  const auto first = keys_.begin() + index_[entry];
  const auto last = keys_.begin() + index_[entry + 1] + 1;
  return static_cast<std::size_t>(std::upper_bound(first + 1, last, key) - keys_.begin()) - 1;
}

std::size_t Octree::find_cell(std::uint32_t x, std::uint32_t y, std::uint32_t z) const {
  return find_key(key_of(x, y, z));
}

std::optional<std::size_t> Octree::find(const Eigen::Vector3d& p_object_mm) const {
  constexpr double kCells = 1 << kMax;
  const Eigen::Vector3d cell = (p_object_mm - low_corner_mm()) * (kCells / volume_.edge_mm);
  // Written so that NaN is outside.
  for (int axis = 0; axis < 3; ++axis) {
    if (!(cell[axis] >= 0 && cell[axis] < kCells)) return std::nullopt;
  }
  return find_cell(static_cast<std::uint32_t>(cell.x()), static_cast<std::uint32_t>(cell.y()),
                   static_cast<std::uint32_t>(cell.z()));
}

Octree Octree::split(const std::vector<std::uint8_t>& marked) const {
  std::vector<std::vector<Leaf>> parts((size() + kBlock - 1) / kBlock);
  for_blocks(size(), [&](std::size_t begin, std::size_t end) {
    std::vector<Leaf>& out = parts[begin / kBlock];
    out.reserve(end - begin);
    for (std::size_t i = begin; i < end; ++i) {
      const int level = leaves_[i].level;
      if (marked[i] == 0) {
        out.push_back(leaves_[i]);
        continue;
      }
      for (std::uint64_t child = 0; child < 8; ++child) {
        out.push_back(leaf_of(keys_[i] + child * cells_of(level + 1), level + 1));
      }
    }
  });
  return {volume_, joined(std::move(parts))};
}

Octree Octree::balanced() && {
  Octree octree = std::move(*this);
  for (;;) {
    std::vector<std::uint8_t> marked(octree.size(), 0);
    std::vector<std::vector<std::size_t>> too_coarse((octree.size() + kBlock - 1) / kBlock);
    for_blocks(octree.size(), [&](std::size_t begin, std::size_t end) {
      std::uint64_t last_parent = ~std::uint64_t{0};
      int last_level = -1;
      for (std::size_t i = begin; i < end; ++i) {
        // Balance is a property of whole parents: next to one no leaf may be larger than itself.
        const int level = octree.leaves_[i].level - 1;
        if (level < 1) continue;
        const std::uint64_t parent = octree.keys_[i] / cells_of(level);
        if (parent == last_parent && level == last_level) continue;
        last_parent = parent;
        last_level = level;
        const std::uint32_t side = 1u << (kMax - level);
        const std::array<std::uint32_t, 3> corner{gather(parent), gather(parent >> 1),
                                                  gather(parent >> 2)};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          for (const int step : {-1, 1}) {
            if (step < 0 ? corner[axis] == 0 : corner[axis] + 1 == (1u << level)) continue;
            std::array<std::uint32_t, 3> next = corner;
            next[axis] += static_cast<std::uint32_t>(step);
            const std::size_t leaf =
                octree.find_cell(next[0] * side, next[1] * side, next[2] * side);
            if (octree.leaves_[leaf].level < level) too_coarse[begin / kBlock].push_back(leaf);
          }
        }
      }
    });
    bool is_balanced = true;
    for (const std::vector<std::size_t>& part : too_coarse) {
      for (const std::size_t leaf : part) marked[leaf] = 1;
      is_balanced = is_balanced && part.empty();
    }
    if (is_balanced) return octree;
    octree = octree.split(marked);
  }
}

Octree Octree::adapted(const std::vector<std::uint8_t>& target) const {
  ALHAZEN_CHECK(target.size() == size());
  std::vector<Leaf> leaves;
  leaves.reserve(size());
  // Walks down from the root; [begin, end) are the leaves inside the node.
  const auto visit = [&](const auto& self, std::uint64_t key, int level, std::size_t begin,
                         std::size_t end) -> void {
    const int wanted = *std::max_element(target.begin() + static_cast<std::ptrdiff_t>(begin),
                                         target.begin() + static_cast<std::ptrdiff_t>(end));
    ALHAZEN_CHECK(wanted <= kMaxLevel);
    if (wanted <= level) {
      leaves.push_back(leaf_of(key, level));
      return;
    }
    if (leaves_[begin].level <= level) {  // one leaf around the node: all of it goes down
      const std::uint64_t cells = cells_of(wanted);
      for (std::uint64_t k = key; k < key + cells_of(level); k += cells) {
        leaves.push_back(leaf_of(k, wanted));
      }
      return;
    }
    for (std::uint64_t child = 0; child < 8; ++child) {
      const std::uint64_t low = key + child * cells_of(level + 1);
      const auto last = std::lower_bound(keys_.begin() + static_cast<std::ptrdiff_t>(begin),
                                         keys_.begin() + static_cast<std::ptrdiff_t>(end),
                                         low + cells_of(level + 1));
      const auto next = static_cast<std::size_t>(last - keys_.begin());
      self(self, low, level + 1, begin, next);
      begin = next;
    }
  };
  visit(visit, 0, 0, 0, size());
  return Octree(volume_, std::move(leaves)).balanced();
}

std::vector<std::uint32_t> Octree::leaf_in(const Octree& other) const {
  std::vector<std::uint32_t> found(size());
  for_blocks(size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      // The centre lies in the last of the eight octants' low corner.
      const int level = leaves_[i].level;
      const std::uint64_t centre = level < kMax ? keys_[i] + 7 * cells_of(level + 1) : keys_[i];
      found[i] = static_cast<std::uint32_t>(other.find_key(centre));
    }
  });
  return found;
}

std::vector<Face> Octree::faces() const {
  std::vector<std::vector<Face>> parts((size() + kBlock - 1) / kBlock);
  for_blocks(size(), [&](std::size_t begin, std::size_t end) {
    std::vector<Face>& out = parts[begin / kBlock];
    out.reserve(3 * (end - begin));
    for (std::size_t i = begin; i < end; ++i) {
      const Leaf& leaf = leaves_[i];
      const std::uint32_t side = 1u << (kMax - leaf.level);
      const std::array<std::uint32_t, 3> corner{leaf.x * side, leaf.y * side, leaf.z * side};
      const auto first = static_cast<std::ptrdiff_t>(out.size());
      for (std::size_t axis = 0; axis < 3; ++axis) {
        std::array<std::uint32_t, 3> next = corner;
        next[axis] += side;
        if (next[axis] == (1u << kMax)) continue;
        const std::size_t neighbour = find_cell(next[0], next[1], next[2]);
        const auto tell = [&](std::size_t b) {
          out.push_back({static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(b),
                         static_cast<std::uint8_t>(axis)});
        };
        if (leaves_[neighbour].level <= leaf.level) {
          tell(neighbour);
          continue;
        }
        for (std::uint32_t quarter = 0; quarter < 4; ++quarter) {
          std::array<std::uint32_t, 3> at = next;
          at[(axis + 1) % 3] += (quarter & 1) * side / 2;
          at[(axis + 2) % 3] += (quarter >> 1) * side / 2;
          tell(find_cell(at[0], at[1], at[2]));
        }
      }
      std::sort(out.begin() + first, out.end(),
                [](const Face& p, const Face& q) { return p.b < q.b; });
    }
  });
  return joined(std::move(parts));
}

}  // namespace alhazen
