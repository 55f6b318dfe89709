#include "reconstruct/report/triangle_tree.h"

#include <tbb/parallel_invoke.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <numeric>

namespace alhazen {
namespace {

constexpr std::uint32_t kLeafSize = 4;
constexpr std::uint32_t kParallelFrom = 8192;  // below it a task costs more than it saves

/// Weight of b for the point of the segment ab nearest to p.
double along(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d ab = b - a;
  const double length_squared = ab.squaredNorm();
  return length_squared > 0 ? std::clamp((p - a).dot(ab) / length_squared, 0.0, 1.0) : 0.0;
}

/// For triangles without area the regions below do not exist; their edges do.
Eigen::Vector3d nearest_weights_on_edges(const Eigen::Vector3d& p,
                                         const std::array<Eigen::Vector3d, 3>& corner) {
  Eigen::Vector3d best = Eigen::Vector3d::UnitX();
  double best_squared = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t next = (k + 1) % 3;
    const double t = along(p, corner[k], corner[next]);
    const double squared = (corner[k] + t * (corner[next] - corner[k]) - p).squaredNorm();
    if (squared < best_squared) {
      best_squared = squared;
      best.setZero();
      best[static_cast<Eigen::Index>(k)] = 1 - t;
      best[static_cast<Eigen::Index>(next)] = t;
    }
  }
  return best;
}

/// Barycentric weights of the point of triangle abc nearest to p, by the region p projects to
/// (Ericson, Real-Time Collision Detection, 2005, chapter 5.1.5).
Eigen::Vector3d nearest_weights(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a;
  // Relative to the edges' squares; what is flatter has no usable inside in double precision.
  constexpr double kFlat = 1e-24;
  const double area_squared = ab.cross(ac).squaredNorm();
  const double edge_squared = std::max(ab.squaredNorm(), ac.squaredNorm());
  if (area_squared <= kFlat * edge_squared * edge_squared)
    return nearest_weights_on_edges(p, {a, b, c});

  const Eigen::Vector3d ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return {1, 0, 0};
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return {0, 1, 0};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) {
    const double t = d1 / (d1 - d3);
    return {1 - t, t, 0};
  }
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return {0, 0, 1};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) {
    const double t = d2 / (d2 - d6);
    return {1 - t, 0, t};
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) {
    const double t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return {0, 1 - t, t};
  }
  const double sum = va + vb + vc;
  return {va / sum, vb / sum, vc / sum};
}

double squared_distance(const Eigen::Vector3d& low, const Eigen::Vector3d& high,
                        const Eigen::Vector3d& p) {
  return (low - p).cwiseMax(p - high).cwiseMax(0.0).squaredNorm();
}

std::vector<std::uint32_t> every(std::size_t count) {
  std::vector<std::uint32_t> list(count);
  std::iota(list.begin(), list.end(), 0U);
  return list;
}

/// Nodes of a tree over `count` triangles when halves differ by at most one.
std::uint32_t nodes_for(std::uint32_t count) {
  if (count <= kLeafSize) return 1;
  return 1 + nodes_for(count / 2) + nodes_for(count - count / 2);
}

}  // namespace

TriangleTree::TriangleTree(const Mesh& mesh) : TriangleTree(mesh, every(mesh.triangles.size())) {}

TriangleTree::TriangleTree(const Mesh& mesh, std::span<const std::uint32_t> triangles) {
  triangles_.reserve(triangles.size());
  for (const std::uint32_t t : triangles) {
    const auto& [a, b, c] = mesh.triangles[t];
    triangles_.push_back({mesh.vertices_mm[a], mesh.vertices_mm[b], mesh.vertices_mm[c], t});
  }
  if (triangles_.empty()) return;
  const auto count = static_cast<std::uint32_t>(triangles_.size());
  nodes_.resize(nodes_for(count));
  build(0, 0, count, 1);
}

void TriangleTree::build(std::uint32_t node, std::uint32_t begin, std::uint32_t end,
                         std::uint32_t free_node) {
  Node& here = nodes_[node];
  here.low.setConstant(std::numeric_limits<double>::infinity());
  here.high = -here.low;
  Eigen::Vector3d centre_low = here.low, centre_high = here.high;
  for (std::uint32_t i = begin; i < end; ++i) {
    const Triangle& t = triangles_[i];
    here.low = here.low.cwiseMin(t.a).cwiseMin(t.b).cwiseMin(t.c);
    here.high = here.high.cwiseMax(t.a).cwiseMax(t.b).cwiseMax(t.c);
    const Eigen::Vector3d centre = t.a + t.b + t.c;
    centre_low = centre_low.cwiseMin(centre);
    centre_high = centre_high.cwiseMax(centre);
  }
  const std::uint32_t count = end - begin;
  if (count <= kLeafSize) {
    here.first = begin;
    here.count = count;
    return;
  }
  Eigen::Index axis = 0;
  (centre_high - centre_low).maxCoeff(&axis);
  const std::uint32_t middle = begin + count / 2;
  const auto at = [this](std::uint32_t i) {
    return triangles_.begin() + static_cast<std::ptrdiff_t>(i);
  };
  std::nth_element(at(begin), at(middle), at(end), [axis](const Triangle& p, const Triangle& q) {
    const double pc = p.a[axis] + p.b[axis] + p.c[axis];
    const double qc = q.a[axis] + q.b[axis] + q.c[axis];
    return pc != qc ? pc < qc : p.index < q.index;
  });
  // Both children side by side, then the left one's descendants, then the right one's.
  here.first = free_node;
  const std::uint32_t left = free_node, right = free_node + 1;
  const std::uint32_t left_free = free_node + 2;
  const std::uint32_t right_free = left_free + nodes_for(middle - begin) - 1;
  const auto build_left = [=, this] { build(left, begin, middle, left_free); };
  const auto build_right = [=, this] { build(right, middle, end, right_free); };
  if (count >= kParallelFrom) {
    tbb::parallel_invoke(build_left, build_right);
  } else {
    build_left();
    build_right();
  }
}

std::optional<Nearest> TriangleTree::nearest(const Eigen::Vector3d& p_mm, double within_mm) const {
  if (nodes_.empty()) return std::nullopt;
  std::optional<Nearest> best;
  double best_squared = within_mm * within_mm;
  struct Waiting {
    std::uint32_t node;
    double squared;
  };
  std::array<Waiting, 64> stack;  // the tree is balanced: its depth is below 32
  std::size_t size = 0;
  stack[size++] = {0, squared_distance(nodes_[0].low, nodes_[0].high, p_mm)};
  while (size > 0) {
    const Waiting next = stack[--size];
    if (next.squared > best_squared) continue;
    const Node& node = nodes_[next.node];
    if (node.count > 0) {
      for (std::uint32_t i = node.first; i < node.first + node.count; ++i) {
        const Triangle& t = triangles_[i];
        const Eigen::Vector3d weights = nearest_weights(p_mm, t.a, t.b, t.c);
        const Eigen::Vector3d point = weights[0] * t.a + weights[1] * t.b + weights[2] * t.c;
        const double squared = (point - p_mm).squaredNorm();
        if (squared < best_squared || (!best && squared <= best_squared)) {
          best_squared = squared;
          best = Nearest{0, point, t.index, weights};
        }
      }
      continue;
    }
    const Node& l = nodes_[node.first];
    const Node& r = nodes_[node.first + 1];
    const Waiting left{node.first, squared_distance(l.low, l.high, p_mm)};
    const Waiting right{node.first + 1, squared_distance(r.low, r.high, p_mm)};
    const bool left_first = left.squared <= right.squared;
    stack[size++] = left_first ? right : left;
    stack[size++] = left_first ? left : right;
  }
  if (best) best->distance_mm = std::sqrt(best_squared);
  return best;
}

}  // namespace alhazen
