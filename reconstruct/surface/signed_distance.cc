#include "reconstruct/surface/signed_distance.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "reconstruct/surface/multigrid.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

/// Layers of leaves on each side of the cut that are solved for: as far as depths reach (less than
/// one leaf) and cubic interpolation after that (two), and one to spare.
constexpr int kLayers = 4;
/// Length over which the cut's steps are smoothed away, in leaves.
constexpr float kCutLength = 1.5F;
/// What an edge without observed normals weighs against one with: enough to carry shape across a
/// gap, too little to bend what was measured at its rim.
constexpr float kUnobservedTrust = 0.03F;
/// Pull to the cut where a normal but no depth was observed, as a share of a depth's weight: just
/// enough that parts without any depth have a place.
constexpr double kPlace = 1e-4;
/// Rounds of down-weighting after the first solution.
constexpr int kRobustRounds = 2;
/// Tukey's bound in standard deviations, wide because the smooth f may rightly leave good depths at
/// sharp edges, and in leaves: nothing closer is ever doubted.
constexpr double kTukeyBound = 8, kTukeyFloor = 0.05;
constexpr double kTolerance = 1e-6;
constexpr int kMaxIterations = 200;

/// The band: finest leaves within kLayers of a change of sign, and how they touch.
struct Band {
  std::vector<std::uint32_t> leaf;       ///< of each cell
  std::vector<std::uint8_t> is_at_edge;  ///< a neighbour of this cell is not in the band
  GridSystem grid;                       ///< cells and neighbours; weights and masses still to come
};

[[nodiscard]] bool is_inside(const Indicator& cut, std::size_t leaf) { return cut.u[leaf] > 0.5F; }

[[nodiscard]] Band make_band(const Octree& octree, const std::vector<Face>& faces,
                             const Indicator& cut) {
  const std::vector<Leaf>& leaves = octree.leaves();
  const auto is_finest = [&](std::uint32_t i) { return leaves[i].level == octree.finest_level(); };
  // Layer of each leaf, 0 beside the cut; found by walking over the faces layer by layer.
  constexpr std::uint8_t kFar = 0xff;
  std::vector<std::uint8_t> layer(octree.size(), kFar);
  for (const Face& face : faces) {
    if (is_inside(cut, face.a) == is_inside(cut, face.b)) continue;
    if (is_finest(face.a)) layer[face.a] = 0;
    if (is_finest(face.b)) layer[face.b] = 0;
  }
  for (int k = 0; k + 1 < kLayers; ++k) {
    for (const Face& face : faces) {
      if (!is_finest(face.a) || !is_finest(face.b)) continue;
      if (layer[face.a] == k && layer[face.b] == kFar)
        layer[face.b] = static_cast<std::uint8_t>(k + 1);
      if (layer[face.b] == k && layer[face.a] == kFar)
        layer[face.a] = static_cast<std::uint8_t>(k + 1);
    }
  }

  Band band;
  std::vector<std::uint32_t> cell_of(octree.size(), GridSystem::kNone);
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (layer[i] == kFar) continue;
    cell_of[i] = static_cast<std::uint32_t>(band.leaf.size());
    band.leaf.push_back(static_cast<std::uint32_t>(i));
    band.grid.cell.push_back({leaves[i].x, leaves[i].y, leaves[i].z});
  }
  std::array<std::uint32_t, 6> alone{};
  alone.fill(GridSystem::kNone);
  band.grid.neighbour.assign(band.leaf.size(), alone);
  for (const Face& face : faces) {
    const std::uint32_t a = cell_of[face.a], b = cell_of[face.b];
    if (a == GridSystem::kNone || b == GridSystem::kNone) continue;
    band.grid.neighbour[a][2 * std::size_t{face.axis} + 1] = b;
    band.grid.neighbour[b][2 * std::size_t{face.axis}] = a;
  }
  band.is_at_edge.resize(band.leaf.size());
  for (std::size_t c = 0; c < band.leaf.size(); ++c) {
    const std::array<std::uint32_t, 6>& around = band.grid.neighbour[c];
    band.is_at_edge[c] =
        std::find(around.begin(), around.end(), GridSystem::kNone) != around.end() ? 1 : 0;
  }
  return band;
}

/// Smoothed signed distance from the cut in leaves: φ − ℓ²Δφ = ±1 decays from the cut like
/// 1 − exp(−d/ℓ) (after Varadhan, 1967), which is then undone.
[[nodiscard]] Result<std::vector<float>> cut_distance(const Band& band, const Indicator& cut,
                                                      const Run& run) {
  const std::size_t n = band.leaf.size();
  GridSystem grid = band.grid;
  constexpr float kDiffusion = kCutLength * kCutLength;
  grid.weight.assign(n, {kDiffusion, kDiffusion, kDiffusion});
  grid.mass.assign(n, 1.0F);
  std::vector<float> side(n);
  for (std::size_t c = 0; c < n; ++c) side[c] = 1 - 2 * std::clamp(cut.u[band.leaf[c]], 0.0F, 1.0F);
  std::vector<float> phi = side;
  ALHAZEN_TRY(Multigrid(std::move(grid)).solve(side, 1e-4, kMaxIterations, run, phi));
  for (float& value : phi) {
    const float distance = -kCutLength * std::log1p(-std::min(std::abs(value), 0.99F));
    value = std::copysign(distance, value);
  }
  return phi;
}

[[nodiscard]] float median_of(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

[[nodiscard]] Status check_input(const Octree& octree, const Indicator& cut,
                                 const SurfaceSamples& samples) {
  const auto length_is = [&](std::size_t length, std::string_view name) -> Status {
    if (length == octree.size()) return {};
    return Error{Code::invalid, std::string(name) + " has " + std::to_string(length) +
                                    " values for " + std::to_string(octree.size()) + " leaves"};
  };
  ALHAZEN_TRY(length_is(cut.u.size(), "the cut"));
  ALHAZEN_TRY(length_is(samples.normal.size(), "normal"));
  ALHAZEN_TRY(length_is(samples.offset_mm.size(), "offset_mm"));
  ALHAZEN_TRY(length_is(samples.weight.size(), "weight"));
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const auto refuse = [i](std::string_view what) {
      return Error{Code::invalid, std::string(what) + " of leaf " + std::to_string(i)};
    };
    if (!(samples.weight[i] >= 0) || !std::isfinite(samples.weight[i]))
      return refuse("weight below 0 or not finite");
    if (samples.weight[i] > 0 && !std::isfinite(samples.offset_mm[i]))
      return refuse("offset_mm not finite");
    if (!samples.normal[i].allFinite()) return refuse("normal not finite");
  }
  return {};
}

}  // namespace

Result<SignedDistance> signed_distance(const Octree& octree, const std::vector<Face>& faces,
                                       const Indicator& cut, const SurfaceSamples& samples,
                                       const SurfaceOptions& options, const Run& run) {
  ALHAZEN_TRY(check_input(octree, cut, samples));
  const Band band = make_band(octree, faces, cut);
  const std::size_t n = band.leaf.size();
  if (n == 0) {
    return Error{Code::conflict, "the cut has no surface among leaves of level " +
                                     std::to_string(octree.finest_level())};
  }
  const auto unit_mm =
      static_cast<float>(octree.volume().edge_mm / static_cast<double>(1 << octree.finest_level()));
  const std::vector<float> cut_leaves = ALHAZEN_TRY(cut_distance(band, cut, run));
  run.tell("distance", 0.2);

  std::vector<float> weights;  // of the depths that there are
  for (const std::uint32_t i : band.leaf)
    if (samples.weight[i] > 0) weights.push_back(samples.weight[i]);
  const float median_weight = weights.empty() ? 1.0F : median_of(weights);

  // The slope of f towards each neighbour, as the leaves of an edge know it.
  const auto is_observed = [&](std::size_t c) { return !samples.normal[band.leaf[c]].isZero(); };
  const auto trust = [&](std::size_t c) { return is_observed(c) ? 1.0F : kUnobservedTrust; };
  GridSystem grid = band.grid;
  grid.weight.resize(n);
  std::vector<std::array<float, 3>> rise(n);
  for_blocks(n, [&](std::size_t begin, std::size_t end) {
    for (std::size_t c = begin; c < end; ++c) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const std::uint32_t other = grid.neighbour[c][2 * axis + 1];
        grid.weight[c][axis] = rise[c][axis] = 0;
        if (other == GridSystem::kNone) continue;
        const auto known = [&](std::size_t cell) {
          return is_observed(cell)
                     ? samples.normal[band.leaf[cell]][static_cast<Eigen::Index>(axis)]
                     : cut_leaves[other] - cut_leaves[c];
        };
        const float trust_a = trust(c), trust_b = trust(other);
        grid.weight[c][axis] = 0.5F * (trust_a + trust_b);
        rise[c][axis] = (trust_a * known(c) + trust_b * known(other)) / (trust_a + trust_b);
        // The slope bends between the two; where the next leaves on both sides know it too, the
        // integral of the cubic through all four is exact to fifth order instead of third.
        const std::uint32_t before = grid.neighbour[c][2 * axis];
        const std::uint32_t after = grid.neighbour[other][2 * axis + 1];
        if (before != GridSystem::kNone && after != GridSystem::kNone && is_observed(before) &&
            is_observed(c) && is_observed(other) && is_observed(after)) {
          rise[c][axis] += (known(c) - known(before) + known(other) - known(after)) / 24;
        }
      }
    }
  });

  // Never below what single precision resolves beside weights of 1 where there is no depth at all.
  const double least_place = weights.empty() ? 1e-6 : 1e-9;
  const auto place = static_cast<float>(std::max(least_place, kPlace * options.data_weight));

  const float pull = kUnobservedTrust * static_cast<float>(options.cut_weight);

  SignedDistance result;
  result.unknowns = n;
  std::vector<float> f = cut_leaves, robust(n, 1.0F), b(n);
  for (int round = 0; round <= kRobustRounds; ++round) {
    grid.mass.resize(n);
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t c = begin; c < end; ++c) {
        const std::uint32_t i = band.leaf[c];
        const float depth_weight = samples.weight[i] > 0
                                       ? static_cast<float>(options.data_weight) * robust[c] *
                                             samples.weight[i] / median_weight
                                       : 0.0F;
        const float cut_weight = is_observed(c) || depth_weight > 0 ? place : std::max(pull, place);
        grid.mass[c] = depth_weight + cut_weight;
        float right = cut_weight * cut_leaves[c];
        if (depth_weight > 0) right += depth_weight * samples.offset_mm[i] / unit_mm;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          right -= grid.weight[c][axis] * rise[c][axis];
          const std::uint32_t below = grid.neighbour[c][2 * axis];
          if (below != GridSystem::kNone) right += grid.weight[below][axis] * rise[below][axis];
        }
        b[c] = right;
      }
    });
    Multigrid multigrid(grid);
    const Multigrid::Solved solved =
        ALHAZEN_TRY(multigrid.solve(b, kTolerance, kMaxIterations, run, f));
    result.iterations += solved.iterations;
    result.residual = solved.residual;
    run.tell("distance", 0.2 + 0.8 * (round + 1) / (kRobustRounds + 1));
    if (round == kRobustRounds || weights.empty()) break;

    // Depths far from what their surroundings agree on are doubted.
    std::vector<float> misfit;
    const auto misfit_of = [&](std::size_t c) {
      const std::uint32_t i = band.leaf[c];
      return std::abs(f[c] - samples.offset_mm[i] / unit_mm) *
             std::sqrt(samples.weight[i] / median_weight);
    };
    for (std::size_t c = 0; c < n; ++c)
      if (samples.weight[band.leaf[c]] > 0) misfit.push_back(misfit_of(c));
    const double bound =
        std::max(kTukeyFloor, kTukeyBound * 1.4826 * static_cast<double>(median_of(misfit)));
    bool is_all_trusted = true;
    for (std::size_t c = 0; c < n; ++c) {
      if (!(samples.weight[band.leaf[c]] > 0)) continue;
      const double share = misfit_of(c) / bound;
      robust[c] = share < 1 ? static_cast<float>((1 - share * share) * (1 - share * share)) : 0.0F;
      is_all_trusted = is_all_trusted && share < 0.5;
    }
    if (is_all_trusted) break;
  }

  const float beyond_mm = (kLayers + 1) * unit_mm;
  result.value_mm.resize(octree.size());
  result.in_band.assign(octree.size(), 0);
  for (std::size_t i = 0; i < octree.size(); ++i)
    result.value_mm[i] = is_inside(cut, i) ? -beyond_mm : beyond_mm;
  for (std::size_t c = 0; c < n; ++c) {
    const std::uint32_t i = band.leaf[c];
    result.in_band[i] = 1;
    const bool has_cuts_sign = (f[c] < 0) == is_inside(cut, i);
    if (band.is_at_edge[c] != 0 && !has_cuts_sign) {
      // The surface would leave the band here: it is held inside, so that it stays whole.
      result.value_mm[i] = (is_inside(cut, i) ? -0.05F : 0.05F) * unit_mm;
      ++result.clipped;
      continue;
    }
    result.value_mm[i] = f[c] * unit_mm;
  }
  return result;
}

}  // namespace alhazen
