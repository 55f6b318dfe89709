#include "reconstruct/mesh/contour.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "alhazen/check.h"
#include "reconstruct/mesh/cube_table.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

/// Samples along a block's edge. Blocks are what is worked on at a time and kept or not.
constexpr int kSide = 8;
constexpr int kSamples = kSide * kSide * kSide;
/// A block with one sample before it and two behind: what cubic interpolation reaches.
constexpr int kWindow = kSide + 3;
constexpr std::uint32_t kNoBlock = 0xffffffffU;
constexpr std::uint8_t kHasInside = 1, kHasOutside = 2;
/// Vertices keep this share of a grid edge away from its ends: distinct grid edges, distinct
/// vertices. At 0.4 mm it moves one by 0.4 µm at most.
constexpr double kMargin = 1e-3;

struct Sample {
  enum Kind : std::uint8_t { beyond, coarse, fine };
  float value = 0;
  Kind kind = beyond;  ///< of the leaf it was taken from: of the finest level, larger, or none
};
using Window = std::array<Sample, std::size_t{kWindow} * kWindow * kWindow>;

/// Position of a sample in its block; each coordinate 0 … kSide - 1.
[[nodiscard]] std::size_t in_block(int x, int y, int z) {
  const int at = (z * kSide + y) * kSide + x;
  return static_cast<std::size_t>(at);
}

/// Blocks of samples, -1 … per axis: the block at -1 holds the samples below the volume, which are
/// outside, so that a surface that reaches the boundary is closed there.
class Blocks {
 public:
  Blocks(const Octree& octree, const std::vector<float>& value)
      : octree_(octree), value_(value), level_(octree.finest_level()) {
    const int cells = 1 << level_;
    per_axis_ = (cells + kSide - 1) / kSide + 2;
    const auto n = static_cast<std::size_t>(per_axis_);
    flags_.assign(n * n * n, 0);
    block_of_.assign(n * n * n, kNoBlock);
    find_signs();
    choose();
    fill();
  }

  [[nodiscard]] std::size_t active_count() const noexcept { return active_.size(); }
  /// Block coordinates of an active block.
  [[nodiscard]] std::array<int, 3> position(std::size_t active) const { return active_[active]; }
  /// The active block at a position. REQUIRES: it is active.
  [[nodiscard]] std::size_t active_at(const std::array<int, 3>& block) const {
    return active_of_[index(block)];
  }
  /// The samples -1 … kSide + 1 about a block, x fastest.
  void window(const std::array<int, 3>& block, Window& out) const {
    std::size_t at = 0;
    for (int z = -1; z < kWindow - 1; ++z) {
      for (int y = -1; y < kWindow - 1; ++y) {
        for (int x = -1; x < kWindow - 1; ++x) {
          const auto shift = [](int k) { return k < 0 ? -1 : k >= kSide ? 1 : 0; };
          const std::uint32_t stored =
              stored_at({block[0] + shift(x), block[1] + shift(y), block[2] + shift(z)});
          const auto wrapped = [](int k) { return static_cast<std::size_t>((k + kSide) % kSide); };
          out[at++] = stored == kNoBlock
                          ? Sample{}
                          : samples_[stored * kSamples + (wrapped(z) * kSide + wrapped(y)) * kSide +
                                     wrapped(x)];
        }
      }
    }
  }

 private:
  [[nodiscard]] std::size_t index(const std::array<int, 3>& block) const {
    const auto n = static_cast<std::size_t>(per_axis_);
    return (static_cast<std::size_t>(block[2] + 1) * n + static_cast<std::size_t>(block[1] + 1)) *
               n +
           static_cast<std::size_t>(block[0] + 1);
  }
  [[nodiscard]] std::uint32_t stored_at(const std::array<int, 3>& block) const {
    for (const int b : block)
      if (b < -1 || b >= per_axis_ - 1) return kNoBlock;
    return block_of_[index(block)];
  }

  /// The first and last block (per axis) that a leaf reaches, and its samples.
  struct Extent {
    std::array<int, 3> first_sample, last_sample;
  };
  [[nodiscard]] Extent extent(const Leaf& leaf) const {
    const int shift = level_ - leaf.level;
    const int side = 1 << shift;
    const std::array<int, 3> first{leaf.x << shift, leaf.y << shift, leaf.z << shift};
    return {first, {first[0] + side - 1, first[1] + side - 1, first[2] + side - 1}};
  }

  template <class Function>
  void for_blocks_of(const Extent& extent, const Function& function) const {
    for (int z = extent.first_sample[2] / kSide; z <= extent.last_sample[2] / kSide; ++z)
      for (int y = extent.first_sample[1] / kSide; y <= extent.last_sample[1] / kSide; ++y)
        for (int x = extent.first_sample[0] / kSide; x <= extent.last_sample[0] / kSide; ++x)
          function(std::array<int, 3>{x, y, z});
  }

  void find_signs() {
    for (std::size_t i = 0; i < octree_.size(); ++i) {
      const std::uint8_t sign = value_[i] < 0 ? kHasInside : kHasOutside;
      for_blocks_of(extent(octree_.leaves()[i]),
                    [&](const std::array<int, 3>& block) { flags_[index(block)] |= sign; });
    }
    // Beyond the volume everything is outside; so are the samples behind it in its last blocks.
    const int cells = 1 << level_;
    for (int z = -1; z < per_axis_ - 1; ++z)
      for (int y = -1; y < per_axis_ - 1; ++y)
        for (int x = -1; x < per_axis_ - 1; ++x)
          for (const int b : {x, y, z})
            if (b < 0 || (b + 1) * kSide > cells) flags_[index({x, y, z})] |= kHasOutside;
  }

  /// A block is active where a cube that begins in it may have both signs; samples are kept for
  /// those and for all about them.
  void choose() {
    active_of_.assign(flags_.size(), 0);
    std::vector<std::uint8_t> is_kept(flags_.size(), 0);
    for (int z = -1; z < per_axis_ - 1; ++z) {
      for (int y = -1; y < per_axis_ - 1; ++y) {
        for (int x = -1; x < per_axis_ - 1; ++x) {
          std::uint8_t signs = 0;
          for (int k = 0; k < 8; ++k) {
            const std::array<int, 3> next{x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)};
            const bool is_beyond =
                std::any_of(next.begin(), next.end(), [&](int b) { return b >= per_axis_ - 1; });
            signs |= is_beyond ? kHasOutside : flags_[index(next)];
          }
          if (signs != (kHasInside | kHasOutside)) continue;
          active_of_[index({x, y, z})] = static_cast<std::uint32_t>(active_.size());
          active_.push_back({x, y, z});
          for (int dz = -1; dz <= 1; ++dz)
            for (int dy = -1; dy <= 1; ++dy)
              for (int dx = -1; dx <= 1; ++dx) {
                const std::array<int, 3> about{x + dx, y + dy, z + dz};
                if (std::all_of(about.begin(), about.end(),
                                [&](int b) { return b >= -1 && b < per_axis_ - 1; })) {
                  is_kept[index(about)] = 1;
                }
              }
        }
      }
    }
    std::uint32_t kept = 0;
    for (std::size_t b = 0; b < is_kept.size(); ++b)
      if (is_kept[b] != 0) block_of_[b] = kept++;
    samples_.resize(std::size_t{kept} * kSamples);
  }

  void fill() {
    for_blocks(octree_.size(), [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        const Leaf& leaf = octree_.leaves()[i];
        const Extent reach = extent(leaf);
        const Sample sample{value_[i], leaf.level == level_ ? Sample::fine : Sample::coarse};
        for_blocks_of(reach, [&](const std::array<int, 3>& block) {
          const std::uint32_t stored = block_of_[index(block)];
          if (stored == kNoBlock) return;
          std::array<int, 3> first{}, last{};
          for (std::size_t a = 0; a < 3; ++a) {
            first[a] = std::max(reach.first_sample[a] - block[a] * kSide, 0);
            last[a] = std::min(reach.last_sample[a] - block[a] * kSide, kSide - 1);
          }
          for (int z = first[2]; z <= last[2]; ++z)
            for (int y = first[1]; y <= last[1]; ++y)
              for (int x = first[0]; x <= last[0]; ++x)
                samples_[std::size_t{stored} * kSamples + in_block(x, y, z)] = sample;
        });
      }
    });
  }

  const Octree& octree_;
  const std::vector<float>& value_;
  int level_;
  int per_axis_ = 0;
  std::vector<std::uint8_t> flags_;
  std::vector<std::uint32_t> block_of_, active_of_;
  std::vector<std::array<int, 3>> active_;
  std::vector<Sample> samples_;  ///< zero, that is outside, where no leaf is
};

/// Position of a sample of a block in its window; each coordinate -1 … kSide + 1.
[[nodiscard]] std::size_t in_window(int x, int y, int z) {
  const int at = ((z + 1) * kWindow + (y + 1)) * kWindow + (x + 1);
  return static_cast<std::size_t>(at);
}
[[nodiscard]] constexpr std::size_t stride(int axis) {
  return axis == 0 ? 1 : axis == 1 ? kWindow : kWindow * kWindow;
}

/// Where along the grid edge from sample `at` the function is zero, 0 … 1.
[[nodiscard]] double crossing(const Window& window, std::size_t at, int axis) {
  const std::size_t step = stride(axis);
  const auto is_fine = [&](std::size_t sample) { return window[sample].kind == Sample::fine; };
  if (window[at].kind == Sample::beyond || window[at + step].kind == Sample::beyond) return 0.5;
  const double f0 = window[at].value, f1 = window[at + step].value;
  double t = f0 / (f0 - f1);
  if (is_fine(at - step) && is_fine(at) && is_fine(at + step) && is_fine(at + 2 * step)) {
    const double before = window[at - step].value, after = window[at + 2 * step].value;
    const double bend0 = before - 2 * f0 + f1, bend1 = f0 - 2 * f1 + after;
    const auto [low, high] = std::minmax({before, f0, f1, after});
    // Smooth: the four samples lie on a parabola but for a little.
    if (std::abs(bend1 - bend0) < 0.25 * (high - low)) {
      // The cubic through them, as the linear interpolant plus a multiple of t(t − 1); Newton's
      // method, kept between the ends of a bracket that closes.
      double below = f0 < 0 ? 0 : 1, above = 1 - below;
      for (int k = 0; k < 40; ++k) {
        const double value =
            f0 + t * (f1 - f0) + t * (t - 1) / 6 * (bend0 * (2 - t) + bend1 * (1 + t));
        const double slope =
            f1 - f0 + (bend0 * (6 * t - 3 * t * t - 2) + bend1 * (3 * t * t - 1)) / 6;
        (value < 0 ? below : above) = t;
        const double next = t - value / slope;
        const bool is_within = next > std::min(below, above) && next < std::max(below, above);
        const double moved = is_within ? next : 0.5 * (below + above);
        if (std::abs(moved - t) < 1e-7) break;
        t = moved;
      }
    }
  }
  return std::clamp(t, kMargin, 1 - kMargin);
}

/// Gradient at a sample of the window, per grid edge: central where both neighbours are samples of
/// their own (or neither is), one-sided where one is.
[[nodiscard]] Eigen::Vector3f gradient(const Window& window, std::size_t at) {
  Eigen::Vector3f g = Eigen::Vector3f::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    const Sample &low = window[at - stride(axis)], &high = window[at + stride(axis)];
    const float f = window[at].value;
    const bool has_low = low.kind == Sample::fine, has_high = high.kind == Sample::fine;
    if (has_low == has_high) {
      g[axis] = 0.5F * (high.value - low.value);
    } else {
      g[axis] = has_high ? high.value - f : f - low.value;
    }
  }
  return g;
}

/// What one block contributes; vertices are numbered over all blocks later.
struct Patch {
  std::vector<Eigen::Vector3d> vertices_mm;
  std::vector<Eigen::Vector3f> normals;
  std::vector<std::uint32_t> vertex_of_edge;  ///< 3 per sample of the block: within this patch
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

void find_vertices(const Octree& octree, const std::array<int, 3>& block, const Window& window,
                   Patch& patch) {
  const double unit_mm = octree.volume().edge_mm / static_cast<double>(1 << octree.finest_level());
  for (int z = 0; z < kSide; ++z) {
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const std::size_t at = in_window(x, y, z);
        const bool is_inside = window[at].value < 0;
        for (int axis = 0; axis < 3; ++axis) {
          if (is_inside == (window[at + stride(axis)].value < 0)) continue;
          if (patch.vertex_of_edge.empty()) patch.vertex_of_edge.assign(3 * kSamples, 0);
          patch.vertex_of_edge[3 * in_block(x, y, z) + static_cast<std::size_t>(axis)] =
              static_cast<std::uint32_t>(patch.vertices_mm.size());
          const double t = crossing(window, at, axis);
          Eigen::Vector3d grid(block[0] * kSide + x + 0.5, block[1] * kSide + y + 0.5,
                               block[2] * kSide + z + 0.5);
          grid[axis] += t;
          patch.vertices_mm.emplace_back(octree.low_corner_mm() + unit_mm * grid);
          const auto share = static_cast<float>(t);
          const Eigen::Vector3f slope =
              (1 - share) * gradient(window, at) + share * gradient(window, at + stride(axis));
          const float length = slope.norm();
          // Where the gradient cancels, the edge itself tells which way is out.
          patch.normals.push_back(length > 1e-12F ? Eigen::Vector3f(slope / length)
                                                  : Eigen::Vector3f(Eigen::Vector3f::Unit(axis) *
                                                                    (is_inside ? 1.0F : -1.0F)));
        }
      }
    }
  }
}

}  // namespace

Result<Mesh> contour(const Octree& octree, const std::vector<float>& value, const Run& run) {
  if (value.size() != octree.size()) {
    return Error{Code::invalid, "value has " + std::to_string(value.size()) + " values for " +
                                    std::to_string(octree.size()) + " leaves"};
  }
  for (std::size_t i = 0; i < value.size(); ++i) {
    if (!std::isfinite(value[i])) {
      return Error{Code::invalid, "value of leaf " + std::to_string(i) + " is not finite"};
    }
  }
  const Blocks blocks(octree, value);
  std::vector<Patch> patches(blocks.active_count());
  for_each_index(patches.size(), [&](std::size_t b) {
    if (run.stopped()) return;
    Window window;
    blocks.window(blocks.position(b), window);
    find_vertices(octree, blocks.position(b), window, patches[b]);
  });
  if (run.stopped()) return Error{Code::cancelled, "the contour was stopped"};

  std::vector<std::size_t> first_vertex(patches.size() + 1, 0);
  for (std::size_t b = 0; b < patches.size(); ++b)
    first_vertex[b + 1] = first_vertex[b] + patches[b].vertices_mm.size();
  if (first_vertex.back() == 0) {
    return Error{Code::conflict, "there is no surface: all leaves lie on one side of it"};
  }
  if (first_vertex.back() >= std::numeric_limits<std::uint32_t>::max()) {
    return Error{Code::exhausted, "the surface has more vertices than a mesh can number"};
  }

  Mesh mesh;
  mesh.vertices_mm.resize(first_vertex.back());
  mesh.normals.resize(first_vertex.back());
  for_each_index(patches.size(), [&](std::size_t b) {
    std::copy(patches[b].vertices_mm.begin(), patches[b].vertices_mm.end(),
              mesh.vertices_mm.begin() + static_cast<std::ptrdiff_t>(first_vertex[b]));
    std::copy(patches[b].normals.begin(), patches[b].normals.end(),
              mesh.normals.begin() + static_cast<std::ptrdiff_t>(first_vertex[b]));
  });

  const std::array<CubePattern, 256>& table = cube_table();
  for_each_index(patches.size(), [&](std::size_t b) {
    if (run.stopped()) return;
    Window window;
    const std::array<int, 3> block = blocks.position(b);
    blocks.window(block, window);
    const auto vertex = [&](int x, int y, int z, int edge) {
      const int corner = low_corner(edge);
      std::array<int, 3> at{x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)};
      std::array<int, 3> owner = block;
      for (std::size_t a = 0; a < 3; ++a) {
        if (at[a] < kSide) continue;
        at[a] -= kSide;
        ++owner[a];
      }
      const std::size_t patch = blocks.active_at(owner);
      const std::size_t edge_of_patch =
          3 * in_block(at[0], at[1], at[2]) + static_cast<std::size_t>(edge / 4);
      return static_cast<std::uint32_t>(first_vertex[patch] +
                                        patches[patch].vertex_of_edge[edge_of_patch]);
    };
    for (int z = 0; z < kSide; ++z) {
      for (int y = 0; y < kSide; ++y) {
        for (int x = 0; x < kSide; ++x) {
          std::size_t signs = 0;
          for (int c = 0; c < 8; ++c) {
            const Sample& s = window[in_window(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2))];
            signs |= static_cast<std::size_t>(s.value < 0 ? 1 : 0) << c;
          }
          for (const CubePattern::Loop& loop : table[signs].loops) {
            std::array<std::uint32_t, 12> corner{};
            for (std::size_t k = 0; k < loop.edges.size(); ++k)
              corner[k] = vertex(x, y, z, loop.edges[k]);
            // Of the triangulations allowed, the one with the shortest sides.
            std::size_t best = 0;
            double best_length = std::numeric_limits<double>::infinity();
            for (std::size_t option = 0;
                 loop.triangulations.size() > 1 && option < loop.triangulations.size(); ++option) {
              double length = 0;
              for (const auto& t : loop.triangulations[option])
                for (std::size_t k = 0; k < 3; ++k)
                  length +=
                      (mesh.vertices_mm[corner[t[k]]] - mesh.vertices_mm[corner[t[(k + 1) % 3]]])
                          .squaredNorm();
              if (length < best_length) {
                best_length = length;
                best = option;
              }
            }
            for (const auto& t : loop.triangulations[best])
              patches[b].triangles.push_back({corner[t[0]], corner[t[1]], corner[t[2]]});
          }
        }
      }
    }
  });
  if (run.stopped()) return Error{Code::cancelled, "the contour was stopped"};
  std::size_t triangles = 0;
  for (const Patch& patch : patches) triangles += patch.triangles.size();
  mesh.triangles.reserve(triangles);
  for (const Patch& patch : patches)
    mesh.triangles.insert(mesh.triangles.end(), patch.triangles.begin(), patch.triangles.end());
  return mesh;
}

void annotate(const Octree& octree, const LeafFacts& facts, Mesh& mesh) {
  ALHAZEN_CHECK(facts.consistency.size() == octree.size());
  ALHAZEN_CHECK(facts.observed.size() == octree.size());
  ALHAZEN_CHECK(facts.depth_sigma_mm.size() == octree.size());
  const std::size_t n = mesh.vertices_mm.size();
  mesh.consistency.assign(n, 0.0F);
  mesh.observed.assign(n, 0);
  mesh.depth_sigma_mm.assign(n, std::numeric_limits<float>::quiet_NaN());
  const double half_mm =
      0.5 * octree.volume().edge_mm / static_cast<double>(1 << octree.finest_level());
  for_blocks(n, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) {
      const Eigen::Vector3d& p = mesh.vertices_mm[v];
      std::optional<std::size_t> best;
      double best_mm = 0;
      for (int k = 0; k < 8; ++k) {
        const Eigen::Vector3d corner((k & 1) != 0 ? half_mm : -half_mm,
                                     (k & 2) != 0 ? half_mm : -half_mm,
                                     (k & 4) != 0 ? half_mm : -half_mm);
        const std::optional<std::size_t> leaf = octree.find(p + corner);
        if (!leaf) continue;
        const double distance_mm = (octree.centre_mm(*leaf) - p).norm();
        const bool is_better =
            !best || facts.observed[*leaf] > facts.observed[*best] ||
            (facts.observed[*leaf] == facts.observed[*best] && distance_mm < best_mm);
        if (!is_better) continue;
        best = leaf;
        best_mm = distance_mm;
      }
      if (!best) continue;
      mesh.consistency[v] = facts.consistency[*best];
      mesh.observed[v] = facts.observed[*best];
      if (facts.observed[*best] != 0) mesh.depth_sigma_mm[v] = facts.depth_sigma_mm[*best];
    }
  });
}

}  // namespace alhazen
