#include "reconstruct/surface/normal_integration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "reconstruct/surface/multigrid.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

/// A link keeps this share of its weight, so that no pixel loses touch with all others.
constexpr double kLeastLink = 1e-4;
/// Pull of each pixel to zero: fixes what is open, one constant a connected part.
constexpr float kMass = 1e-7F;
/// A normal nearer to grazing than this says nothing of a slope.
constexpr double kLeastCosine = 0.02;
constexpr double kSolveTolerance = 1e-5;
constexpr int kMaxSolveIterations = 60;

/// Bits of a 16-bit number, spread to every third.
std::uint64_t spread(std::uint64_t x) {
  std::uint64_t out = 0;
  for (unsigned bit = 0; bit < 16; ++bit) out |= (x >> bit & 1U) << (3 * bit);
  return out;
}

/// The object's pixels as cells of a grid, and what their normals say of their neighbours.
struct Pixels {
  std::vector<std::size_t> pixel;  ///< of each cell
  GridSystem grid;
  /// Per cell and side (−x +x −y +y): what its own normal says the neighbour's log depth is more,
  /// in units of 1/f; and f |n·d|, in the same unit 1.
  std::vector<std::array<float, 4>> step;
  std::vector<float> cosine;
};

Pixels pixels_of(const NormalMap& map, const CameraModel& camera) {
  Pixels made;
  const int width = map.region.width;
  std::vector<std::pair<std::uint64_t, std::size_t>> order;
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    if (map.label[i] != NormalLabel::object) continue;
    const auto x = i % static_cast<std::size_t>(width), y = i / static_cast<std::size_t>(width);
    const Eigen::Vector3d d = camera.direction(Eigen::Vector2d(
        map.region.x + static_cast<double>(x), map.region.y + static_cast<double>(y)));
    if (!(map.normal[i].cast<double>().dot(d) < -kLeastCosine)) continue;
    order.emplace_back(spread(x) | spread(y) << 1U, i);
  }
  std::sort(order.begin(), order.end());
  const std::size_t n = order.size();
  std::vector<std::uint32_t> cell_of(map.size_px(), GridSystem::kNone);
  for (std::size_t c = 0; c < n; ++c) {
    const std::size_t i = order[c].second;
    cell_of[i] = static_cast<std::uint32_t>(c);
    made.pixel.push_back(i);
    made.grid.cell.push_back({static_cast<std::uint16_t>(i % static_cast<std::size_t>(width)),
                              static_cast<std::uint16_t>(i / static_cast<std::size_t>(width)), 0});
  }
  made.grid.neighbour.resize(n);
  made.grid.weight.resize(n);
  made.grid.mass.assign(n, kMass);
  made.step.resize(n);
  made.cosine.resize(n);
  const double focal_px = std::sqrt(camera.fx_px * camera.fy_px);
  for_blocks(n, [&](std::size_t begin, std::size_t end) {
    for (std::size_t c = begin; c < end; ++c) {
      const int x = made.grid.cell[c][0], y = made.grid.cell[c][1];
      const Eigen::Vector3d normal = map.normal[made.pixel[c]].cast<double>();
      const auto sight = [&](int px, int py) {
        const Eigen::Vector3d d =
            camera.direction(Eigen::Vector2d(map.region.x + px, map.region.y + py));
        return Eigen::Vector3d(d / d.z());
      };
      const Eigen::Vector3d here = sight(x, y);
      made.cosine[c] = static_cast<float>(-normal.dot(here));
      made.grid.neighbour[c].fill(GridSystem::kNone);
      constexpr std::array<std::array<int, 2>, 4> kSides{{{-1, 0}, {1, 0}, {0, -1}, {0, 1}}};
      for (std::size_t side = 0; side < kSides.size(); ++side) {
        const int px = x + kSides[side][0], py = y + kSides[side][1];
        made.step[c][side] = 0;
        if (px < 0 || py < 0 || px >= width || py >= map.region.height) continue;
        made.grid.neighbour[c][side] =
            cell_of[static_cast<std::size_t>(py) * static_cast<std::size_t>(width) +
                    static_cast<std::size_t>(px)];
        // The plane through this pixel; near grazing it may not meet the next sight line at all.
        const double ratio = normal.dot(here) / normal.dot(sight(px, py));
        const double step = ratio > 0 ? std::log(ratio) * focal_px : 0;
        made.step[c][side] = static_cast<float>(std::clamp(step, -50.0, 50.0));
      }
    }
  });
  return made;
}

/// What pixel c expects of its neighbours: how far each is from its plane, squared, scaled by
/// f|n·d|.
float misfit2(const Pixels& pixels, const std::vector<float>& x, std::size_t c, std::size_t side) {
  const std::uint32_t j = pixels.grid.neighbour[c][side];
  if (j == GridSystem::kNone) return 0;
  const float r = pixels.cosine[c] * (x[j] - x[c] - pixels.step[c][side]);
  return r * r;
}

}  // namespace

Result<DepthMap> integrate_normals(const NormalMap& map, const CameraModel& camera,
                                   double median_depth_mm, const IntegrationOptions& options,
                                   const Run& run) {
  const auto invalid = [](const std::string& what) { return Error{Code::invalid, what}; };
  if (map.normal.size() != map.size_px() || map.label.size() != map.size_px()) {
    return invalid("the normal map's lists are not of its region's size");
  }
  if (map.region.width > 65535 || map.region.height > 65535) {
    return invalid("the normal map is larger than 65535 px a side");
  }
  if (!(median_depth_mm > 0 && median_depth_mm < 1e9)) {
    return invalid("a median depth of " + std::to_string(median_depth_mm) +
                   " mm; it must be above 0");
  }
  if (!(options.sharpness >= 0 && options.sharpness <= 100) || options.rounds < 1 ||
      options.rounds > 1000 || !(options.settled >= 0 && options.settled < 1)) {
    return invalid(
        "integration: sharpness must be in [0, 100], rounds in [1, 1000], settled in [0, 1)");
  }
  Pixels pixels = pixels_of(map, camera);
  const std::size_t n = pixels.pixel.size();
  if (n == 0) return invalid("no pixel has a normal that faces the camera");

  DepthMap result;
  result.region = map.region;
  std::vector<float> x(n, 0), b(n);
  std::vector<std::array<float, 4>> weight(n);
  for (auto& w : weight) w.fill(0.5F);
  double energy = std::numeric_limits<double>::infinity();
  for (int round = 0; round < options.rounds; ++round) {
    if (run.stopped()) return Error{Code::cancelled, "integration was stopped"};
    run.tell("integrate", static_cast<double>(round) / options.rounds);
    // One link per pair: both pixels' planes, each with its weight.
    std::vector<std::array<float, 2>> rise(n);
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t c = begin; c < end; ++c) {
        pixels.grid.weight[c].fill(0);
        for (std::size_t axis = 0; axis < 2; ++axis) {
          const std::uint32_t j = pixels.grid.neighbour[c][2 * axis + 1];
          rise[c][axis] = 0;
          if (j == GridSystem::kNone) continue;
          const float here = weight[c][2 * axis + 1] * pixels.cosine[c] * pixels.cosine[c];
          const float there = weight[j][2 * axis] * pixels.cosine[j] * pixels.cosine[j];
          const float sum = std::max(here + there, static_cast<float>(kLeastLink));
          pixels.grid.weight[c][axis] = sum;
          rise[c][axis] = (here * pixels.step[c][2 * axis + 1] - there * pixels.step[j][2 * axis]) /
                          std::max(here + there, 1e-12F);
        }
      }
    });
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t c = begin; c < end; ++c) {
        b[c] = 0;
        for (std::size_t axis = 0; axis < 2; ++axis) {
          b[c] -= pixels.grid.weight[c][axis] * rise[c][axis];
          const std::uint32_t j = pixels.grid.neighbour[c][2 * axis];
          if (j != GridSystem::kNone) b[c] += pixels.grid.weight[j][axis] * rise[j][axis];
        }
      }
    });
    Multigrid multigrid(pixels.grid);
    result.residual =
        ALHAZEN_TRY(multigrid.solve(b, kSolveTolerance, kMaxSolveIterations, run, x)).residual;
    result.rounds = round + 1;

    const double before = energy;
    energy = sum_blocks<1>(n, [&](std::size_t begin, std::size_t end) {
      double sum = 0;
      for (std::size_t c = begin; c < end; ++c) {
        for (std::size_t axis = 0; axis < 2; ++axis) {
          const float low = misfit2(pixels, x, c, 2 * axis);
          const float high = misfit2(pixels, x, c, 2 * axis + 1);
          const auto k = static_cast<float>(options.sharpness);
          const float w = 1 / (1 + std::exp(std::clamp(-k * (low - high), -80.0F, 80.0F)));
          weight[c][2 * axis + 1] = w;
          weight[c][2 * axis] = 1 - w;
          sum += static_cast<double>(w) * high + static_cast<double>(1 - w) * low;
        }
      }
      return std::array<double, 1>{sum};
    })[0];
    if (round > 0 && std::abs(energy - before) <= options.settled * before) break;
  }

  std::vector<float> sorted = x;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(n / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const double focal_px = std::sqrt(camera.fx_px * camera.fy_px);
  result.depth_mm.assign(map.size_px(), std::numeric_limits<float>::quiet_NaN());
  for (std::size_t c = 0; c < n; ++c) {
    result.depth_mm[pixels.pixel[c]] = static_cast<float>(
        median_depth_mm * std::exp((static_cast<double>(x[c]) - *middle) / focal_px));
  }
  return result;
}

}  // namespace alhazen
