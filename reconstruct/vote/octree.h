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

/// Linear octree over the cube `volume`: its leaves, in Morton order of their low corners,
/// partition the cube; face neighbours differ by at most one level. Immutable; a refinement is a
/// new octree. Reentrant.
class Octree {
 public:
  static constexpr int kMaxLevel = 11;

  /// All leaves at `level`. REQUIRES: 0 ≤ level ≤ kMaxLevel.
  [[nodiscard]] static Octree uniform(const Volume& volume, int level);

  [[nodiscard]] const Volume& volume() const noexcept { return volume_; }
  [[nodiscard]] const std::vector<Leaf>& leaves() const noexcept { return leaves_; }
  [[nodiscard]] std::size_t size() const noexcept { return leaves_.size(); }
  [[nodiscard]] double edge_mm(std::size_t leaf) const;
  [[nodiscard]] Eigen::Vector3d centre_mm(std::size_t leaf) const;
  /// The leaf that contains a point; nothing outside the volume.
  [[nodiscard]] std::optional<std::size_t> find(const Eigen::Vector3d& p_object_mm) const;

  /// A new octree in which leaves with target[i] > level are split until they reach level
  /// target[i], siblings whose parents all of whose children ask for less are merged, then balanced
  /// 2:1 by splitting. target[i]: wanted level per leaf, 0 … kMaxLevel.
  [[nodiscard]] Octree adapted(const std::vector<std::uint8_t>& target) const;

  /// For each leaf of *this, the leaf of `other` (same volume) that contains its centre: how values
  /// are carried from one octree to the next.
  [[nodiscard]] std::vector<std::uint32_t> leaf_in(const Octree& other) const;

  /// Every inner face once, sorted by (a, b). A coarse face against four fine ones is four faces.
  [[nodiscard]] std::vector<Face> faces() const;

 private:
  Octree(Volume volume, std::vector<Leaf> leaves)
      : volume_(std::move(volume)), leaves_(std::move(leaves)) {}
  Volume volume_;
  std::vector<Leaf> leaves_;
};

}  // namespace alhazen
