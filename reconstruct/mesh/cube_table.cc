#include "reconstruct/mesh/cube_table.h"

#include <algorithm>

namespace alhazen {
namespace {

constexpr int kNoEdge = -1;

int edge_between(int corner_a, int corner_b) {
  const int low = std::min(corner_a, corner_b);
  for (int edge = 0; edge < 12; ++edge) {
    if (low_corner(edge) == low && (low | 1 << (edge / 4)) == std::max(corner_a, corner_b)) {
      return edge;
    }
  }
  return kNoEdge;
}

/// Corners of a face, counter-clockwise seen from outside the cube.
std::array<int, 4> corners_of(int face) {
  const int axis = face / 2, side = face % 2;
  const int u = 1 << ((axis + 1) % 3), v = 1 << ((axis + 2) % 3), base = side << axis;
  if (side == 1) return {base, base | u, base | u | v, base | v};
  return {base, base | v, base | u | v, base | u};
}

bool share_a_face(int edge_a, int edge_b) {
  for (int face = 0; face < 6; ++face) {
    const std::array<int, 4> corners = corners_of(face);
    bool has_a = false, has_b = false;
    for (std::size_t k = 0; k < 4; ++k) {
      const int edge = edge_between(corners[k], corners[(k + 1) % 4]);
      has_a = has_a || edge == edge_a;
      has_b = has_b || edge == edge_b;
    }
    if (has_a && has_b) return true;
  }
  return false;
}

using Triangles = std::vector<std::array<std::uint8_t, 3>>;

/// All triangulations of the polygon first … last (indices into `edges`) on the chord first-last.
std::vector<Triangles> triangulate(const std::vector<std::uint8_t>& edges, std::size_t first,
                                   std::size_t last) {
  if (last - first < 2) return {{}};
  const auto is_allowed = [&](std::size_t a, std::size_t b) {
    const bool is_side = b - a == 1 || (a == 0 && b + 1 == edges.size());
    return is_side || !share_a_face(edges[a], edges[b]);
  };
  std::vector<Triangles> all;
  for (std::size_t apex = first + 1; apex < last; ++apex) {
    if (!is_allowed(first, apex) || !is_allowed(apex, last)) continue;
    for (const Triangles& left : triangulate(edges, first, apex)) {
      for (const Triangles& right : triangulate(edges, apex, last)) {
        Triangles one = left;
        one.insert(one.end(), right.begin(), right.end());
        one.push_back({static_cast<std::uint8_t>(first), static_cast<std::uint8_t>(apex),
                       static_cast<std::uint8_t>(last)});
        all.push_back(std::move(one));
      }
    }
  }
  return all;
}

CubePattern make(int inside) {
  const auto is_inside = [inside](int corner) { return (inside >> corner & 1) != 0; };
  // next[e]: where the segment that begins on edge e ends. Seen from outside the cube, a segment
  // runs so that the inside corners it cuts off lie on its right: the neighbouring cube, which sees
  // the face from behind, runs it the other way, and loops turn outward.
  std::array<int, 12> next{};
  next.fill(kNoEdge);
  for (int face = 0; face < 6; ++face) {
    const std::array<int, 4> corner = corners_of(face);
    for (std::size_t k = 0; k < 4; ++k) {
      if (is_inside(corner[k]) || !is_inside(corner[(k + 1) % 4])) continue;
      std::size_t end = k + 1;  // the last corner of the run that begins after corner k
      while (is_inside(corner[(end + 1) % 4])) ++end;
      const int enters = edge_between(corner[k], corner[(k + 1) % 4]);
      const int leaves = edge_between(corner[end % 4], corner[(end + 1) % 4]);
      next[static_cast<std::size_t>(enters)] = leaves;
    }
  }
  CubePattern pattern;
  std::array<bool, 12> is_done{};
  for (std::size_t start = 0; start < 12; ++start) {
    if (next[start] == kNoEdge || is_done[start]) continue;
    CubePattern::Loop loop;
    for (std::size_t e = start; !is_done[e]; e = static_cast<std::size_t>(next[e])) {
      is_done[e] = true;
      loop.edges.push_back(static_cast<std::uint8_t>(e));
    }
    loop.triangulations = triangulate(loop.edges, 0, loop.edges.size() - 1);
    pattern.loops.push_back(std::move(loop));
  }
  return pattern;
}

}  // namespace

const std::array<CubePattern, 256>& cube_table() {
  static const std::array<CubePattern, 256> table = [] {
    std::array<CubePattern, 256> all;
    for (int inside = 0; inside < 256; ++inside)
      all[static_cast<std::size_t>(inside)] = make(inside);
    return all;
  }();
  return table;
}

}  // namespace alhazen
