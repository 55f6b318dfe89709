#pragma once

#include <cstdint>

#include "alhazen/result.h"

namespace alhazen {

/// How the density of a point's hypotheses is estimated (M. Weinmann's thesis, eq. 5.8, compares
/// these): h is the bandwidth, d the chord between two unit normals.
enum class Density : std::uint8_t {
  gaussian,      ///< exp(−d² / 2h²)
  epanechnikov,  ///< max(0, 1 − d² / 6h²): the same mean d² on the sphere
  histogram,     ///< equal cells of 2h of the octahedron's plane; the fullest one
};

/// Every tunable of voting (method: reconstruct/README.md).
struct VoteOptions {
  Density density = Density::gaussian;
  /// Bandwidth h of the Gaussian kernel on normals, Σ exp(−|n_v − n|² / 2h²), for a leaf of edge
  /// `bandwidth_edge_mm`; with each halving of the edge it shrinks by `bandwidth_ratio`.
  /// rad, range (0, 0.5]; mm, range (0, 1000]; unit 1, range (0, 1].
  /// Source: the hypotheses at a leaf's centre spread with its distance from the surface by 16 to
  /// 20 mrad/mm on a sphere of 25 mm; tests/unit/vote checks that the field peaks there.
  double bandwidth_rad = 0.015;
  double bandwidth_edge_mm = 0.8;
  double bandwidth_ratio = 2.0 / 3.0;
  /// h is never below this many standard deviations of a hypothesis, as the light maps' own sigmas
  /// give them. Unit 1, range [0, 10].
  double bandwidth_noises = 3;
  /// c = max(0, s − lone_support) / (prior_votes + V) with the support s = Σ exp(−|n_v − N|² / 2h²)
  /// of V votes: a vote always supports itself, so 1 and a little more says nothing. Unit 1, range
  /// [1, 10].
  double lone_support = 1.2;
  /// How many votes that disagree are presumed before the first: few votes that agree by chance
  /// weigh little. Unit 1, range [0, 100].
  double prior_votes = 4;
  /// Hypotheses nearer to grazing are left out: least n·v = n·l. Unit 1, range [0, 1).
  double min_cosine = 0.08;
  /// Neighbouring pixels whose display positions are farther apart, as an angle seen from the
  /// volume's centre, are not interpolated between. rad, range (0, 3]. A mirror of radius R turns
  /// the light by 2·pixel/(R cos θ): 0.15 rad is R = 2 mm seen with 0.15 mm pixels.
  double jump_rad = 0.15;
  /// Neighbouring pixels of a normal map whose normals differ by more are not interpolated between:
  /// a crease or another part of the object lies there. rad, range (0, 3].
  double normal_jump_rad = 0.5;
};

/// Every tunable of the depth refinement (reconstruct/vote/depth.h).
struct DepthOptions {
  /// Rounds of gathering and solving at most; a foot point that has settled takes no more. Range 1
  /// … 10.
  int rounds = 3;
  /// Central difference over ± this, in the first round and in the others. mm, range (0, 10].
  double first_step_mm = 0.15, step_mm = 0.10;
  /// Votes farther than this from the normal are left out. rad, range (0, 1].
  double first_cone_rad = 0.06, cone_rad = 0.03;
  /// Reweightings by Tukey's biweight in each round. Range 0 … 20.
  int tukey_rounds = 3;
  /// Accepted: at least so many votes agree (range 3 … 100),
  int min_votes = 3;
  /// their median residual is at most this, or so many standard deviations of a hypothesis by the
  /// light maps' own sigmas, whichever is more (rad, range (0, 1]; unit 1, range [0, 10]),
  double max_residual_rad = 1e-3;
  double max_residual_noises = 2;
  /// the last correction is at most this (mm, range (0, 10]),
  double max_last_step_mm = 0.1;
  /// the foot point is within so many leaf edges of the leaf's centre (range (0, 10]),
  double max_offset_edges = 1.5;
  /// and the standard deviation is at most so many leaf edges (range (0, 10]).
  double max_sigma_edges = 0.5;
};

/// Every tunable of the surface stage.
struct SurfaceOptions {
  /// Weight of the flux term: E(u) = ∫ g|∇u| − λ ∫ u div(cN). Unit 1, range (0, 100].
  double lambda = 40.0;
  /// g = max(g_min, exp(−β c)). Unit 1, range (0, 20].
  double beta = 4.0;
  /// Unit 1, range (0, 1].
  double g_min = 0.02;
  /// The cut stops where its duality gap is at most this share of its surface term. Unit 1, range
  /// (0, 1].
  double relative_gap = 0.02;
  /// Range 1 … 100000.
  int max_iterations = 400;
  /// β of the signed distance: how strongly a depth of median weight counts against the slope of
  /// one edge. Depths are averaged over about 1/√β leaves. Unit 1, range (0, 1e6].
  double data_weight = 0.2;
  /// α of the signed distance: pull to the cut where nothing was observed; it acts over about 1/√α
  /// leaves. Unit 1, range (0, 1].
  double cut_weight = 1e-3;
};

/// How the octree follows the surface.
struct AdaptOptions {
  /// The level at which every leaf is voted on first. Range 4 … 8. At the default volume of 102.4
  /// mm level 7 is 0.8 mm: small enough that a bandwidth fits that tells concavities apart.
  int start_level = 7;
  /// Adaptions of the octree to the cut at each level. Range 1 … 10. Three as in the thesis.
  int adaptions = 3;
  /// Leaves within so many steps of the cut are of the current level. Range 1 … 20.
  int band_leaves = 3;
  /// So are leaves of at least this consistency, and their neighbours, wherever they are. Unit 1,
  /// range (0, 1].
  double min_consistency = 0.25;
};

/// Every tunable of the refinement of a calibration (reconstruct/refine/refine.h).
struct RefineOptions {
  /// Standard deviations of the calibration that is refined: of where a camera sees things (turns
  /// about its centre; px, range (0, 100]) and of its centre's coordinates (mm, range (0, 100]),
  double camera_px = 0.1;
  double camera_mm = 0.01;
  /// of each coordinate of a display's middle and of its turns (mm, range (0, 100]; rad, range (0,
  /// 0.5]),
  double display_mm = 0.2;
  double display_rad = 7e-4;
  /// of where the turntable's axis stands and of its tilt (mm, range (0, 100]; rad, range (0,
  /// 0.5]).
  double axis_mm = 0.01;
  double axis_rad = 1e-4;
  /// At most so many points of the surface, evenly picked. Range 30 … 1000000.
  int points = 3000;
  /// Share of them that only judges the result. Unit 1, range [0.05, 0.5].
  double held_out_share = 1.0 / 3;
  /// Fewer points at which votes agree, of each of the two kinds, and the calibration stays as it
  /// is. Range 10 … 100000.
  int min_points = 100;
  /// Votes farther than this from a point's normal are left out. rad, range (0, 1].
  double cone_rad = 0.02;
  /// Points with fewer votes that agree are left out: three unknowns of its own take one and a
  /// half. Range 3 … 100.
  int min_votes = 4;
  /// How far a point may be from the surface it was taken from, a standard deviation: what keeps
  /// points of flat parts, whose votes know little of depth, in place. mm, range (0, 10].
  double depth_mm = 0.1;
  /// Gauss-Newton steps at most. Range 1 … 50.
  int iterations = 6;
};

struct Options {
  AdaptOptions adapt;
  VoteOptions vote;
  DepthOptions depth;
  SurfaceOptions surface;
  RefineOptions refine;
  /// For scans of normal maps alone. Votes at a leaf spread with the surface's curvature times the
  /// leaf's edge, as those of light maps do, but there is no finer information to wait for, so
  /// bandwidth and cones are wide enough for details of two leaves' radius.
  /// Source: chosen on armadillo and torus, reconstruct/README.md.
  [[nodiscard]] static Options for_normal_maps();
  /// Fails: invalid, naming the tunable and its range.
  [[nodiscard]] Status is_valid() const;
};

}  // namespace alhazen
