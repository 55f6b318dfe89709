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
  /// The cut stops where its duality gap is at most this share of its surface term. Unit 1, range
  /// (0, 1].
  double relative_gap = 5e-3;
  /// Range 1 … 100000.
  int max_iterations = 400;
  /// β of the signed distance: how strongly a depth of median weight counts against the slope of
  /// one edge. Depths are averaged over about 1/√β leaves. Unit 1, range (0, 1e6].
  double data_weight = 0.02;
  /// α of the signed distance: pull to the cut where nothing was observed; it acts over about 1/√α
  /// leaves. Unit 1, range (0, 1].
  double cut_weight = 1e-3;
};

struct Options {
  VoteOptions vote;
  SurfaceOptions surface;
  /// Fails: invalid, naming the tunable and its range.
  [[nodiscard]] Status is_valid() const;
};

}  // namespace alhazen
