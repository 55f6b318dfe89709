#include "reconstruct/mesh/clean.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <numeric>
#include <string>
#include <vector>

namespace alhazen {
namespace {

using Triangle = std::array<std::uint32_t, 3>;
constexpr std::uint32_t kNoVertex = 0xffffffffU;
/// A triangle whose height is below this share of its longest side is worth turning that side.
constexpr double kFlatTriangle = 0.1;

/// A directed edge of a triangle, sorted by its undirected name.
struct EdgeUse {
  std::uint32_t low, high, triangle;
  bool is_forward;  ///< the triangle runs low → high
  friend bool operator<(const EdgeUse& a, const EdgeUse& b) {
    if (a.low != b.low) return a.low < b.low;
    if (a.high != b.high) return a.high < b.high;
    return a.triangle < b.triangle;
  }
};

[[nodiscard]] std::vector<EdgeUse> sorted_edges(const Mesh& mesh) {
  std::vector<EdgeUse> uses;
  uses.reserve(3 * mesh.triangles.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = mesh.triangles[t][k], b = mesh.triangles[t][(k + 1) % 3];
      uses.push_back({std::min(a, b), std::max(a, b), static_cast<std::uint32_t>(t), a < b});
    }
  }
  std::sort(uses.begin(), uses.end());
  return uses;
}

/// Disjoint sets of indices.
class Sets {
 public:
  explicit Sets(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0U);
  }
  [[nodiscard]] std::uint32_t find(std::uint32_t i) {
    while (parent_[i] != i) {
      parent_[i] = parent_[parent_[i]];
      i = parent_[i];
    }
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = find(a);
    b = find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

[[nodiscard]] Eigen::Vector3d area_vector_mm2(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                              const Eigen::Vector3d& c) {
  return 0.5 * (b - a).cross(c - a);
}

[[nodiscard]] double longest_edge_mm(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                                     const Eigen::Vector3d& c) {
  return std::sqrt(std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()}));
}

/// Keeps the triangles and vertices marked; every list follows.
void compact(Mesh& mesh, const std::vector<std::uint8_t>& keep_triangle) {
  std::vector<std::uint32_t> new_of(mesh.vertices_mm.size(), kNoVertex);
  std::vector<Triangle> triangles;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (keep_triangle[t] == 0) continue;
    triangles.push_back(mesh.triangles[t]);
    for (const std::uint32_t v : mesh.triangles[t]) new_of[v] = 0;
  }
  std::uint32_t kept = 0;
  const auto move_down = [&](auto& list) {
    if (list.empty()) return;
    for (std::size_t v = 0; v < new_of.size(); ++v)
      if (new_of[v] != kNoVertex) list[new_of[v]] = list[v];
    list.resize(kept);
  };
  for (std::uint32_t& v : new_of)
    if (v != kNoVertex) v = kept++;
  for (Triangle& t : triangles)
    for (std::uint32_t& v : t) v = new_of[v];
  mesh.triangles = std::move(triangles);
  move_down(mesh.vertices_mm);
  move_down(mesh.normals);
  move_down(mesh.consistency);
  move_down(mesh.observed);
  move_down(mesh.depth_sigma_mm);
}

/// Drops small and inverted components.
void drop_components(Mesh& mesh, const CleanOptions& options) {
  Sets sets(mesh.vertices_mm.size());
  for (const Triangle& t : mesh.triangles) {
    sets.join(t[0], t[1]);
    sets.join(t[0], t[2]);
  }
  std::vector<double> volume_mm3(mesh.vertices_mm.size(), 0.0);
  const Eigen::Vector3d origin = mesh.vertices_mm[mesh.triangles[0][0]];
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector3d a = mesh.vertices_mm[t[0]] - origin, b = mesh.vertices_mm[t[1]] - origin,
                          c = mesh.vertices_mm[t[2]] - origin;
    volume_mm3[sets.find(t[0])] += a.dot(b.cross(c)) / 6;
  }
  const double largest_mm3 =
      std::abs(*std::max_element(volume_mm3.begin(), volume_mm3.end(),
                                 [](double a, double b) { return std::abs(a) < std::abs(b); }));
  std::vector<std::uint8_t> keep(mesh.triangles.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const double own_mm3 = volume_mm3[sets.find(mesh.triangles[t][0])];
    keep[t] = std::abs(own_mm3) >= options.min_component_share * largest_mm3 &&
                      (own_mm3 > 0 || !options.drop_voids)
                  ? 1
                  : 0;
  }
  compact(mesh, keep);
}

/// Collapses and flips on a mesh that is closed and manifold; elsewhere it leaves alone what it
/// cannot judge (an edge that has not exactly two triangles).
class Tidier {
 public:
  explicit Tidier(Mesh& mesh) : mesh_(mesh), at_(mesh.vertices_mm.size()) {
    alive_.assign(mesh.triangles.size(), 1);
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
      for (const std::uint32_t v : mesh.triangles[t])
        at_[v].push_back(static_cast<std::uint32_t>(t));
  }

  void collapse_below(double min_edge_mm) {
    struct Short {
      double squared_mm2;
      std::uint32_t a, b;
      bool operator<(const Short& other) const {
        if (squared_mm2 != other.squared_mm2) return squared_mm2 < other.squared_mm2;
        return a != other.a ? a < other.a : b < other.b;
      }
    };
    // Each round takes the short edges in order of length, so that the worst go first and the
    // result has one order; a collapse makes new short edges, which the next round takes.
    for (int round = 0; round < 4; ++round) {
      std::vector<Short> edges;
      for (std::size_t t = 0; t < mesh_.triangles.size(); ++t) {
        if (alive_[t] == 0) continue;
        for (std::size_t k = 0; k < 3; ++k) {
          const std::uint32_t a = mesh_.triangles[t][k], b = mesh_.triangles[t][(k + 1) % 3];
          const double squared_mm2 = (p(a) - p(b)).squaredNorm();
          if (a < b && squared_mm2 < min_edge_mm * min_edge_mm)
            edges.push_back({squared_mm2, a, b});
        }
      }
      std::sort(edges.begin(), edges.end());
      std::size_t collapsed = 0;
      for (const Short& edge : edges)
        if (collapse(edge.a, edge.b, min_edge_mm)) ++collapsed;
      if (collapsed == 0) break;
    }
  }

  /// Turns the longest side of triangles flatter than `min_height_share` of it, where that helps.
  void flip_needles(double min_height_share) {
    for (int round = 0; round < 3; ++round) {
      std::size_t flipped = 0;
      for (std::size_t t = 0; t < mesh_.triangles.size(); ++t)
        if (alive_[t] != 0 && height_share(mesh_.triangles[t]) < min_height_share &&
            flip_longest(static_cast<std::uint32_t>(t)))
          ++flipped;
      if (flipped == 0) break;
    }
  }

  [[nodiscard]] const std::vector<std::uint8_t>& alive() const noexcept { return alive_; }

 private:
  [[nodiscard]] const Eigen::Vector3d& p(std::uint32_t v) const { return mesh_.vertices_mm[v]; }

  [[nodiscard]] double height_share(const Triangle& t) const {
    const double longest_mm = longest_edge_mm(p(t[0]), p(t[1]), p(t[2]));
    return 2 * area_vector_mm2(p(t[0]), p(t[1]), p(t[2])).norm() / (longest_mm * longest_mm);
  }

  [[nodiscard]] std::vector<std::uint32_t> ring(std::uint32_t v) const {
    std::vector<std::uint32_t> around;
    for (const std::uint32_t t : at_[v])
      for (const std::uint32_t w : mesh_.triangles[t])
        if (w != v) around.push_back(w);
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    return around;
  }

  /// The triangles on both sides of an edge; false where there are not exactly two.
  [[nodiscard]] bool sides(std::uint32_t a, std::uint32_t b,
                           std::array<std::uint32_t, 2>& both) const {
    std::size_t count = 0;
    for (const std::uint32_t t : at_[a]) {
      const Triangle& corners = mesh_.triangles[t];
      if (std::find(corners.begin(), corners.end(), b) == corners.end()) continue;
      if (count < 2) both[count] = t;
      ++count;
    }
    return count == 2;
  }

  [[nodiscard]] std::uint32_t opposite(std::uint32_t t, std::uint32_t a, std::uint32_t b) const {
    for (const std::uint32_t v : mesh_.triangles[t])
      if (v != a && v != b) return v;
    return kNoVertex;
  }

  /// Merges b into a, half way between them. The link condition (Dey et al. 1999: the rings of both
  /// meet in exactly the two opposite corners) keeps the surface's topology.
  [[nodiscard]] bool collapse(std::uint32_t a, std::uint32_t b, double min_edge_mm) {
    if (at_[a].empty() || at_[b].empty()) return false;  // gone by an earlier one
    if ((p(a) - p(b)).squaredNorm() >= min_edge_mm * min_edge_mm) return false;
    std::array<std::uint32_t, 2> both{};
    if (!sides(a, b, both)) return false;
    const std::vector<std::uint32_t> ring_a = ring(a), ring_b = ring(b);
    std::vector<std::uint32_t> common;
    std::set_intersection(ring_a.begin(), ring_a.end(), ring_b.begin(), ring_b.end(),
                          std::back_inserter(common));
    if (common.size() != 2 || ring_a.size() + ring_b.size() <= 6) return false;
    const Eigen::Vector3d middle_mm = 0.5 * (p(a) + p(b));
    for (const std::uint32_t v : {a, b})
      for (const std::uint32_t t : at_[v])
        if (t != both[0] && t != both[1] && !survives(t, v, middle_mm)) return false;

    mesh_.vertices_mm[a] = middle_mm;
    if (!mesh_.normals.empty()) {
      const Eigen::Vector3f sum = mesh_.normals[a] + mesh_.normals[b];
      if (sum.norm() > 1e-6F) mesh_.normals[a] = sum.normalized();
    }
    for (const std::uint32_t t : both) {
      alive_[t] = 0;
      for (const std::uint32_t v : mesh_.triangles[t]) std::erase(at_[v], t);
    }
    for (const std::uint32_t t : at_[b]) {
      for (std::uint32_t& v : mesh_.triangles[t])
        if (v == b) v = a;
      at_[a].push_back(t);
    }
    at_[b].clear();
    return true;
  }

  /// Whether a triangle keeps its side and some height when its corner moves.
  [[nodiscard]] bool survives(std::uint32_t t, std::uint32_t moved,
                              const Eigen::Vector3d& to_mm) const {
    std::array<Eigen::Vector3d, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) corner[k] = p(mesh_.triangles[t][k]);
    const Eigen::Vector3d before = area_vector_mm2(corner[0], corner[1], corner[2]);
    for (std::size_t k = 0; k < 3; ++k)
      if (mesh_.triangles[t][k] == moved) corner[k] = to_mm;
    const Eigen::Vector3d after = area_vector_mm2(corner[0], corner[1], corner[2]);
    const double longest_mm = longest_edge_mm(corner[0], corner[1], corner[2]);
    return after.dot(before) > 0.5 * after.norm() * before.norm() &&
           2 * after.norm() > 0.02 * longest_mm * longest_mm;
  }

  [[nodiscard]] bool flip_longest(std::uint32_t t) {
    std::size_t longest = 0;
    double longest_mm2 = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const double squared_mm2 =
          (p(mesh_.triangles[t][k]) - p(mesh_.triangles[t][(k + 1) % 3])).squaredNorm();
      if (squared_mm2 > longest_mm2) {
        longest_mm2 = squared_mm2;
        longest = k;
      }
    }
    const std::uint32_t a = mesh_.triangles[t][longest], b = mesh_.triangles[t][(longest + 1) % 3];
    std::array<std::uint32_t, 2> both{};
    if (!sides(a, b, both)) return false;
    const std::uint32_t other = both[0] == t ? both[1] : both[0];
    const std::uint32_t c = opposite(t, a, b), d = opposite(other, a, b);
    if (c == d || at_[a].size() <= 3 || at_[b].size() <= 3) return false;
    const std::vector<std::uint32_t> around = ring(c);
    if (std::binary_search(around.begin(), around.end(), d)) return false;
    const Triangle first{c, a, d}, second{d, b, c};
    const Eigen::Vector3d before =
        area_vector_mm2(p(a), p(b), p(c)) + area_vector_mm2(p(b), p(a), p(d));
    const Eigen::Vector3d n1 = area_vector_mm2(p(c), p(a), p(d)),
                          n2 = area_vector_mm2(p(d), p(b), p(c));
    const double cos_bound = 0.5 * before.norm();
    if (n1.dot(before) < cos_bound * n1.norm() || n2.dot(before) < cos_bound * n2.norm()) {
      return false;
    }
    const double now =
        std::min(height_share(mesh_.triangles[t]), height_share(mesh_.triangles[other]));
    if (std::min(height_share(first), height_share(second)) <= 1.1 * now) return false;
    mesh_.triangles[t] = first;
    mesh_.triangles[other] = second;
    std::erase(at_[b], t);
    std::erase(at_[a], other);
    at_[d].push_back(t);
    at_[c].push_back(other);
    return true;
  }

  Mesh& mesh_;
  std::vector<std::vector<std::uint32_t>> at_;  ///< triangles about each vertex
  std::vector<std::uint8_t> alive_;
};

}  // namespace

MeshCheck check_closed(const Mesh& mesh) {
  MeshCheck check;
  const std::size_t vertices = mesh.vertices_mm.size();
  const std::vector<EdgeUse> uses = sorted_edges(mesh);
  Sets components(mesh.triangles.size());
  std::size_t edges = 0;
  for (std::size_t first = 0; first < uses.size();) {
    std::size_t end = first, forward = 0;
    while (end < uses.size() && uses[end].low == uses[first].low &&
           uses[end].high == uses[first].high) {
      components.join(uses[first].triangle, uses[end].triangle);
      forward += uses[end].is_forward ? 1 : 0;
      ++end;
    }
    const std::size_t count = end - first;
    ++edges;
    if (count == 1) ++check.boundary_edges;
    if (count > 2) ++check.non_manifold_edges;
    if (count == 2 && forward != 1) ++check.inconsistent_edges;
    first = end;
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    if (components.find(static_cast<std::uint32_t>(t)) == t) ++check.components;

  // A vertex is manifold where its triangles hang together by the edges that run to it.
  std::vector<std::uint32_t> first_corner(vertices + 1, 0);
  for (const Triangle& t : mesh.triangles)
    for (const std::uint32_t v : t) ++first_corner[v + 1];
  for (std::size_t v = 0; v < vertices; ++v) first_corner[v + 1] += first_corner[v];
  std::vector<std::uint32_t> triangle_of(3 * mesh.triangles.size());
  std::vector<std::uint32_t> next(first_corner.begin(), first_corner.end() - 1);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    for (const std::uint32_t v : mesh.triangles[t])
      triangle_of[next[v]++] = static_cast<std::uint32_t>(t);
  for (std::size_t v = 0; v < vertices; ++v) {
    const std::size_t count = first_corner[v + 1] - first_corner[v];
    if (count == 0) {
      ++check.unused_vertices;
      continue;
    }
    Sets fans(count);
    std::size_t groups = count;
    for (std::uint32_t i = 0; i < count; ++i) {
      for (std::uint32_t j = 0; j < i; ++j) {
        const Triangle &a = mesh.triangles[triangle_of[first_corner[v] + i]],
                       &b = mesh.triangles[triangle_of[first_corner[v] + j]];
        const bool share = std::any_of(a.begin(), a.end(), [&](std::uint32_t w) {
          return w != v && std::find(b.begin(), b.end(), w) != b.end();
        });
        if (!share || fans.find(i) == fans.find(j)) continue;
        fans.join(i, j);
        --groups;
      }
    }
    if (groups > 1) ++check.non_manifold_vertices;
  }

  const Eigen::Vector3d origin = vertices == 0 ? Eigen::Vector3d::Zero() : mesh.vertices_mm[0];
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector3d &a = mesh.vertices_mm[t[0]], &b = mesh.vertices_mm[t[1]],
                          &c = mesh.vertices_mm[t[2]];
    const double area_mm2 = area_vector_mm2(a, b, c).norm();
    const double longest_mm = longest_edge_mm(a, b, c);
    // Written so that NaN counts.
    if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0] ||
        !(2 * area_mm2 > 1e-9 * longest_mm * longest_mm)) {
      ++check.degenerate_triangles;
    }
    check.area_mm2 += area_mm2;
    check.volume_mm3 += (a - origin).dot((b - origin).cross(c - origin)) / 6;
  }
  check.euler = static_cast<std::ptrdiff_t>(vertices - check.unused_vertices) -
                static_cast<std::ptrdiff_t>(edges) +
                static_cast<std::ptrdiff_t>(mesh.triangles.size());
  return check;
}

Result<Mesh> clean(Mesh mesh, const CleanOptions& options) {
  if (!(options.min_component_share >= 0 && options.min_component_share <= 1)) {
    return Error{
        Code::invalid,
        "min_component_share " + std::to_string(options.min_component_share) + " is outside 0 … 1"};
  }
  if (!(options.min_edge_mm >= 0) || !std::isfinite(options.min_edge_mm)) {
    return Error{Code::invalid,
                 "min_edge_mm " + std::to_string(options.min_edge_mm) + " is not 0 or more"};
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const std::uint32_t v : mesh.triangles[t]) {
      if (v >= mesh.vertices_mm.size()) {
        return Error{Code::invalid, "triangle " + std::to_string(t) + " names vertex " +
                                        std::to_string(v) + " of " +
                                        std::to_string(mesh.vertices_mm.size())};
      }
    }
  }
  if (!mesh.triangles.empty()) drop_components(mesh, options);
  if (mesh.triangles.empty()) return Error{Code::conflict, "no closed component is left"};
  if (options.min_edge_mm > 0) {
    Tidier tidier(mesh);
    tidier.collapse_below(options.min_edge_mm);
    tidier.flip_needles(kFlatTriangle);
    compact(mesh, tidier.alive());
  }
  return mesh;
}

void set_normals(Mesh& mesh) {
  std::vector<Eigen::Vector3d> sum(mesh.vertices_mm.size(), Eigen::Vector3d::Zero());
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector3d area =
        area_vector_mm2(mesh.vertices_mm[t[0]], mesh.vertices_mm[t[1]], mesh.vertices_mm[t[2]]);
    for (const std::uint32_t v : t) sum[v] += area;
  }
  mesh.normals.resize(sum.size());
  for (std::size_t v = 0; v < sum.size(); ++v) {
    const double length = sum[v].norm();
    mesh.normals[v] =
        length > 0 ? Eigen::Vector3f((sum[v] / length).cast<float>()) : Eigen::Vector3f::UnitZ();
  }
}

}  // namespace alhazen
