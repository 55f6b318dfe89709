#pragma once

#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/camera_model.h"
#include "reconstruct/normals/normal_map.h"
#include "reconstruct/run.h"

namespace alhazen {

/// Depth of a single view, known up to its scale.
struct DepthMap {
  Region region;
  std::vector<float> depth_mm;  ///< along the camera's z; NaN where there is no normal
  int rounds = 0;               ///< of reweighting
  double residual = 0;          ///< of the last linear system
};

/// Tunables of integrate_normals().
struct IntegrationOptions {
  /// How quickly of two neighbours the one that contradicts the normal is taken for another part of
  /// the object. Unit 1 (squared steps in pixels), range [0, 100]; 0: the surface is one piece.
  double sharpness = 2;
  /// Reweightings at most. 1 … 1000.
  int rounds = 100;
  /// They end where the energy changes by a smaller share. [0, 1).
  double settled = 1e-4;
};

/// Integrates the normals of one view. For neighbours i and j with sight lines d (z = 1) and log
/// depths ζ the plane through i says ζ_j − ζ_i = log(n_i·d_i / n_i·d_j), and j says the same with
/// n_j; each pixel weighs its two neighbours along an axis against each other by
/// w = 1/(1 + exp(−k(r_other² − r²))), r = f |n·d| (ζ_j − ζ_i − t), so that a step of the surface
/// falls between two pixels instead of bending both. Reweighted least squares, each system by
/// Multigrid on the pixel grid.
///
/// The median depth of the result is `median_depth_mm`; parts that are not connected lie about it,
/// for nothing says how far they are apart.
/// Fails: invalid (lists of another length, no object pixel, options or depth out of range, side
/// above 65535), cancelled. Reentrant; the same result for any number of threads.
/// Source: the weights are those of Cao, Santo, Shi, Okura, Matsushita, Bilateral Normal
/// Integration, ECCV 2022; the planes' exact condition replaces its first-order one.
[[nodiscard]] Result<DepthMap> integrate_normals(const NormalMap& map, const CameraModel& camera,
                                                 double median_depth_mm,
                                                 const IntegrationOptions& options, const Run& run);

}  // namespace alhazen
