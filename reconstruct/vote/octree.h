#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "reconstruct/scan/manifest.h"

namespace alhazen {

/// A leaf: a cube of edge `volume.edge_mm / 2^level`, at integer position (x, y, z) in units of its
/// edge.
struct Leaf {
  std::uint16_t x = 0, y = 0, z = 0;
  std::uint8_t level = 0;
  friend bool operator==(const Leaf&, const Leaf&) = default;
};

/// Two leaves that share (part of) a face. `a` lies on the low side of `axis`.
struct Face {
  std::uint32_t a = 0, b = 0;
  std::uint8_t axis = 0;  ///< 0 x, 1 y, 2 z
};

/// Linear octree over the cube `volume`: its leaves, in Morton order of their low corners (x in the
/// lowest bit of each triple), partition the cube; face neighbours differ by at most one level.
/// Immutable; a refinement is a new octree. Reentrant; builds in the caller's TBB arena, with the
/// same result for any number of threads.
class Octree {
 public:
  static constexpr int kMaxLevel = 11;

  /// All leaves at `level`. REQUIRES: 0 ≤ level ≤ kMaxLevel, volume.edge_mm > 0.
  [[nodiscard]] static Octree uniform(const Volume& volume, int level);

  [[nodiscard]] const Volume& volume() const noexcept { return volume_; }
  [[nodiscard]] const std::vector<Leaf>& leaves() const noexcept { return leaves_; }
  [[nodiscard]] std::size_t size() const noexcept { return leaves_.size(); }
  /// The level of the smallest leaf.
  [[nodiscard]] int finest_level() const noexcept { return finest_level_; }
  [[nodiscard]] double edge_mm(std::size_t leaf) const noexcept {
    return volume_.edge_mm / static_cast<double>(1 << leaves_[leaf].level);
  }
  [[nodiscard]] Eigen::Vector3d centre_mm(std::size_t leaf) const noexcept {
    const Leaf& l = leaves_[leaf];
    return low_corner_mm() + edge_mm(leaf) * Eigen::Vector3d(l.x + 0.5, l.y + 0.5, l.z + 0.5);
  }
  /// The corner of the volume with the smallest coordinates.
  [[nodiscard]] Eigen::Vector3d low_corner_mm() const noexcept {
    return volume_.centre_mm - Eigen::Vector3d::Constant(volume_.edge_mm / 2);
  }

  /// The leaf that contains a point, its low faces included; nothing outside the volume.
  [[nodiscard]] std::optional<std::size_t> find(const Eigen::Vector3d& p_object_mm) const;
  /// The leaf that contains the cell (x, y, z) of the grid of kMaxLevel.
  /// REQUIRES: each below 2^kMaxLevel.
  [[nodiscard]] std::size_t find_cell(std::uint32_t x, std::uint32_t y, std::uint32_t z) const;

  /// The coarsest octree in which every place has at least the level that `target` asks for there:
  /// leaves are split down to target[i], and merged where a whole parent asks for less; then
  /// balanced 2:1 by splitting only. target[i]: wanted level per leaf, 0 … kMaxLevel.
  /// REQUIRES: target.size() == size().
  [[nodiscard]] Octree adapted(const std::vector<std::uint8_t>& target) const;

  /// For each leaf of *this, the leaf of `other` (same volume) that contains its centre: how values
  /// are carried from one octree to the next.
  [[nodiscard]] std::vector<std::uint32_t> leaf_in(const Octree& other) const;

  /// Every inner face once, sorted by (a, b). A coarse face against four fine ones is four faces.
  [[nodiscard]] std::vector<Face> faces() const;

 private:
  /// `leaves` in Morton order, a partition.
  Octree(Volume volume, std::vector<Leaf> leaves);
  [[nodiscard]] std::size_t find_key(std::uint64_t key) const;
  /// The same octree with the marked leaves split once.
  [[nodiscard]] Octree split(const std::vector<std::uint8_t>& marked) const;
  [[nodiscard]] Octree balanced() &&;

  Volume volume_;
  std::vector<Leaf> leaves_;
  std::vector<std::uint64_t> keys_;  ///< Morton key of each leaf's low corner on kMaxLevel's grid
  /// For each cell of the grid of `index_level_`, in Morton order, the leaf of its low corner;
  /// one more at the end. Shortens the search by key.
  std::vector<std::uint32_t> index_;
  int index_level_ = 0;
  int finest_level_ = 0;
};

}  // namespace alhazen
