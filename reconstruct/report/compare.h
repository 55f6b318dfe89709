#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/run.h"

namespace alhazen {

/// Distances of one direction. mm.
struct DistanceFigures {
  std::size_t count = 0;  ///< of points whose distance was taken
  double rms_mm = 0;
  double p90_mm = 0;  ///< accuracy: 90 % of the points lie within it (Seitz et al., CVPR 2006)
  double p99_mm = 0;
  double max_mm = 0;
};

/// Angles between the mesh's vertex normals and the reference's at the nearest point. Degrees, as
/// people read them.
struct NormalFigures {
  double mean_deg = 0, p90_deg = 0;
};

/// A mesh measured against the truth. No alignment: both are in the object frame.
struct Comparison {
  std::optional<DistanceFigures> observed;  ///< observed vertices → reference; nothing if none is
  DistanceFigures all;                      ///< every vertex → reference
  /// Samples of the reference → mesh; the maximum over the reference's own vertices, too.
  DistanceFigures reference_to_mesh;
  double hausdorff_mm = 0;  ///< larger of the two directions' maxima
  /// Share of the reference's area within 0.3 mm of a triangle whose three vertices are observed.
  double completeness_0_3mm = 0;
  /// Share of the reference's area within 1 mm of the mesh, closed parts included.
  double coverage_1mm = 0;
  /// On the observed vertices; nothing where the mesh has no normals or none is observed.
  std::optional<NormalFigures> observed_normals;
  double bias_mm = 0;  ///< mean signed distance of the observed vertices, + outside the reference
  /// Per vertex of the mesh: distance, + outside the reference. For colours; not in report.json.
  std::vector<float> signed_mm;
};

struct CompareOptions {
  /// Points on the reference, spread evenly over its area. [1000, 100000000].
  std::uint64_t samples = 300'000;
  std::uint64_t seed = 1;
};

/// Distances both ways by exact point-to-triangle queries; the result does not depend on the number
/// of threads. A mesh without `observed` counts as observed everywhere.
/// Fails: invalid (no triangles, a list of another length, index or samples out of range, a
///        coordinate not finite or beyond 1e9 mm), cancelled.
/// Source: protocol of docs/design.md after Seitz, Curless, Diebel, Scharstein, Szeliski, CVPR
/// 2006; sign by pseudonormals (Baerentzen and Aanaes 2005). Reentrant; uses the caller's TBB
/// arena.
[[nodiscard]] Result<Comparison> compare(const Mesh& mesh, const Mesh& reference,
                                         const CompareOptions& options, const Run& run);

/// Distances to a sphere of the true, fixed radius whose centre is the least-squares fit to the
/// same vertices.
struct SphereFit {
  Eigen::Vector3d centre_mm = Eigen::Vector3d::Zero();
  DistanceFigures distances;
};
struct SphereComparison {
  std::optional<SphereFit> observed;  ///< over the observed vertices; nothing if fewer than 4 are
  SphereFit all;                      ///< over every vertex
};
/// Fails: invalid (radius not positive, fewer than 4 vertices, vertices that fix no centre).
[[nodiscard]] Result<SphereComparison> compare_sphere(const Mesh& mesh, double radius_mm);

}  // namespace alhazen
