#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace alhazen {

/// Per octree leaf, the most likely normal and how far the votes agree on it. Lists run parallel to
/// Octree::leaves(). Object frame.
struct NormalField {
  std::vector<Eigen::Vector3f> normal;  ///< unit, outward; zero where nothing was voted
  std::vector<float>
      consistency;  ///< robust fraction of agreeing votes, 0 … 1 (method of docs/design.md)
  std::vector<float> support;            ///< Σ k(|n_v − N|): votes that agree
  std::vector<std::uint16_t> votes;      ///< valid look-ups
  std::vector<std::uint8_t> free_space;  ///< 1: some camera looks through this leaf onto a display
  /// 1: what is voted here is better explained elsewhere (rivals.h), so nothing is voted.
  std::vector<std::uint8_t> no_surface;
};

}  // namespace alhazen
