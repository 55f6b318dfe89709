#pragma once

#include "alhazen/result.h"

namespace alhazen {

/// Every tunable of voting (method: reconstruct/README.md).
struct VoteOptions {
  /// Bandwidth h of the Gaussian kernel on normals at octree level 7; at each finer level it
  /// shrinks by `bandwidth_ratio`. rad, range (0, 0.5].
  double bandwidth_rad = 0.015;
  double bandwidth_ratio = 2.0 / 3.0;
};

/// Every tunable of the surface stage.
struct SurfaceOptions {
  /// Weight of the flux term: E(u) = ∫ g|∇u| − λ ∫ u div(cN). Unit 1, range (0, 100].
  double lambda = 3.0;
  /// g = max(g_min, exp(−β c)). Unit 1, range (0, 20].
  double beta = 4.0;
  /// Unit 1, range (0, 1].
  double g_min = 0.02;
};

struct Options {
  VoteOptions vote;
  SurfaceOptions surface;
  /// Fails: invalid, naming the tunable and its range.
  [[nodiscard]] Status is_valid() const;
};

}  // namespace alhazen
