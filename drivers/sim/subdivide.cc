#include "drivers/sim/subdivide.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <utility>

namespace alhazen::sim {
namespace {

using Vec3 = Eigen::Vector3d;

/// Beyond this the finer meshes no longer fit the budget of a rig simulation.
constexpr std::size_t kMostTriangles = 16'000'000;

/// A closed triangle mesh by its half edges: half edge 3t + c runs from corner c of triangle t to
/// the next corner, counter-clockwise seen from outside.
struct HalfEdges {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::uint32_t> twin;     // per half edge
  std::vector<std::uint8_t> sharp;     // per half edge, equal for twins
  std::vector<std::uint32_t> leaving;  // per vertex: one half edge that starts there

  [[nodiscard]] std::uint32_t from(std::uint32_t h) const { return triangles[h / 3][h % 3]; }
  [[nodiscard]] std::uint32_t to(std::uint32_t h) const { return from(next(h)); }
  [[nodiscard]] static std::uint32_t next(std::uint32_t h) { return h % 3 == 2 ? h - 2 : h + 1; }
  [[nodiscard]] static std::uint32_t previous(std::uint32_t h) {
    return h % 3 == 0 ? h + 2 : h - 1;
  }
  /// The next half edge leaving the same vertex, counter-clockwise.
  [[nodiscard]] std::uint32_t around(std::uint32_t h) const { return twin[previous(h)]; }
};

std::string edge_text(std::uint32_t a, std::uint32_t b) {
  return "between vertices " + std::to_string(a) + " and " + std::to_string(b);
}

/// Drops vertices that no triangle uses, and turns the mesh outside out where its volume is
/// negative.
Result<HalfEdges> tidy(const Mesh& mesh) {
  HalfEdges out;
  if (mesh.triangles.size() < 4)
    return Error{Code::invalid, "the mesh has " + std::to_string(mesh.triangles.size()) +
                                    " triangles; a closed one has at least 4"};
  if (mesh.triangles.size() > kMostTriangles)
    return Error{Code::invalid, "the mesh has " + std::to_string(mesh.triangles.size()) +
                                    " triangles; at most " + std::to_string(kMostTriangles) +
                                    " are possible"};
  constexpr std::uint32_t kUnused = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> index(mesh.vertices_mm.size(), kUnused);
  double volume = 0;
  for (auto triangle : mesh.triangles) {
    if (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0])
      return Error{Code::invalid,
                   "a triangle uses vertex " +
                       std::to_string(triangle[0] == triangle[1] ? triangle[0] : triangle[2]) +
                       " twice; the mesh must be a closed manifold"};
    volume += mesh.vertices_mm[triangle[0]].dot(
        mesh.vertices_mm[triangle[1]].cross(mesh.vertices_mm[triangle[2]]));
    for (auto& corner : triangle) {
      if (index[corner] == kUnused) {
        index[corner] = static_cast<std::uint32_t>(out.vertices.size());
        out.vertices.push_back(mesh.vertices_mm[corner]);
      }
      corner = index[corner];
    }
    out.triangles.push_back(triangle);
  }
  if (volume < 0)
    for (auto& triangle : out.triangles) std::swap(triangle[1], triangle[2]);
  return out;
}

/// Finds each half edge's twin. Fails where an edge has not exactly two triangles, side by side.
Status join(HalfEdges& mesh) {
  const auto count = static_cast<std::uint32_t>(3 * mesh.triangles.size());
  std::vector<std::pair<std::uint64_t, std::uint32_t>> edges;
  edges.reserve(count);
  for (std::uint32_t h = 0; h < count; ++h) {
    const std::uint64_t a = mesh.from(h), b = mesh.to(h);
    edges.emplace_back(std::min(a, b) << 32 | std::max(a, b), h);
  }
  std::sort(edges.begin(), edges.end());
  mesh.twin.resize(count);
  std::size_t open = 0;
  std::uint32_t first_open = 0;
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t end = i + 1;
    while (end < edges.size() && edges[end].first == edges[i].first) ++end;
    const std::uint32_t h = edges[i].second;
    if (end - i == 1) {
      if (open++ == 0) first_open = h;
    } else if (end - i > 2) {
      return Error{Code::invalid, "not a manifold: " + std::to_string(end - i) +
                                      " triangles meet at the edge " +
                                      edge_text(mesh.from(h), mesh.to(h))};
    } else {
      const std::uint32_t other = edges[i + 1].second;
      if (mesh.from(h) == mesh.from(other))
        return Error{Code::invalid, "the triangles at the edge " +
                                        edge_text(mesh.from(h), mesh.to(h)) +
                                        " face opposite ways"};
      mesh.twin[h] = other;
      mesh.twin[other] = h;
    }
    i = end;
  }
  if (open > 0)
    return Error{Code::invalid, "the mesh is not closed: " + std::to_string(open) +
                                    " edges belong to one triangle only, the first " +
                                    edge_text(mesh.from(first_open), mesh.to(first_open))};
  return {};
}

void find_leaving(HalfEdges& mesh) {
  mesh.leaving.resize(mesh.vertices.size());
  for (std::uint32_t h = 0; h < mesh.twin.size(); ++h) mesh.leaving[mesh.from(h)] = h;
}

/// Fails where two fans of triangles touch in one vertex only.
Status check_fans(const HalfEdges& mesh) {
  std::vector<std::uint32_t> corners(mesh.vertices.size());
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t corner : triangle) ++corners[corner];
  for (std::uint32_t v = 0; v < mesh.vertices.size(); ++v) {
    std::uint32_t fan = 0, h = mesh.leaving[v];
    do {
      ++fan;
      h = mesh.around(h);
    } while (h != mesh.leaving[v] && fan <= corners[v]);
    if (fan != corners[v])
      return Error{Code::invalid, "not a manifold: parts of the surface touch in vertex " +
                                      std::to_string(v) + " only"};
  }
  return {};
}

void mark_creases(HalfEdges& mesh, double crease_rad) {
  std::vector<Vec3> facing(mesh.triangles.size());
  for (std::size_t t = 0; t < facing.size(); ++t) {
    const auto& [a, b, c] = mesh.triangles[t];
    facing[t] = (mesh.vertices[b] - mesh.vertices[a])
                    .cross(mesh.vertices[c] - mesh.vertices[a])
                    .normalized();
  }
  const double bound = std::cos(crease_rad);
  mesh.sharp.resize(mesh.twin.size());
  for (std::uint32_t h = 0; h < mesh.twin.size(); ++h)
    mesh.sharp[h] = facing[h / 3].dot(facing[mesh.twin[h] / 3]) < bound;
}

/// What surrounds a vertex: its neighbours counter-clockwise and where edges are sharp.
struct Ring {
  std::vector<std::uint32_t> edges;  // half edges that leave the vertex
  std::vector<std::size_t> creases;  // places in `edges` that are sharp

  void gather(const HalfEdges& mesh, std::uint32_t vertex) {
    edges.clear();
    creases.clear();
    std::uint32_t h = mesh.leaving[vertex];
    do {
      if (mesh.sharp[h]) creases.push_back(edges.size());
      edges.push_back(h);
      h = mesh.around(h);
    } while (h != mesh.leaving[vertex]);
  }
  [[nodiscard]] const Vec3& neighbour(const HalfEdges& mesh, std::size_t i) const {
    return mesh.vertices[mesh.to(edges[i % edges.size()])];
  }
};

double loop_beta(std::size_t valence) {
  const double n = static_cast<double>(valence);
  const double c = 0.375 + 0.25 * std::cos(2 * std::numbers::pi / n);
  return (0.625 - c * c) / n;
}

HalfEdges refine(const HalfEdges& coarse) {
  HalfEdges fine;
  const std::size_t faces = coarse.triangles.size();
  fine.vertices.resize(coarse.vertices.size());
  fine.vertices.reserve(coarse.vertices.size() + faces * 3 / 2);
  Ring ring;
  for (std::uint32_t v = 0; v < coarse.vertices.size(); ++v) {
    const Vec3& p = coarse.vertices[v];
    ring.gather(coarse, v);
    if (ring.creases.size() > 2) {
      fine.vertices[v] = p;
    } else if (ring.creases.size() == 2) {
      fine.vertices[v] = 0.75 * p + 0.125 * (ring.neighbour(coarse, ring.creases[0]) +
                                             ring.neighbour(coarse, ring.creases[1]));
    } else {
      const double beta = loop_beta(ring.edges.size());
      Vec3 sum = Vec3::Zero();
      for (std::size_t i = 0; i < ring.edges.size(); ++i) sum += ring.neighbour(coarse, i);
      fine.vertices[v] = (1 - static_cast<double>(ring.edges.size()) * beta) * p + beta * sum;
    }
  }
  std::vector<std::uint32_t> middle(coarse.twin.size());
  for (std::uint32_t h = 0; h < coarse.twin.size(); ++h) {
    const std::uint32_t other = coarse.twin[h];
    if (other < h) continue;
    const Vec3 ends = coarse.vertices[coarse.from(h)] + coarse.vertices[coarse.to(h)];
    const Vec3 sides = coarse.vertices[coarse.to(HalfEdges::next(h))] +
                       coarse.vertices[coarse.to(HalfEdges::next(other))];
    middle[h] = middle[other] = static_cast<std::uint32_t>(fine.vertices.size());
    fine.vertices.push_back(coarse.sharp[h] ? Vec3(0.5 * ends)
                                            : Vec3(0.375 * ends + 0.125 * sides));
  }
  // Triangle t becomes 4t + c at its corner c and 4t + 3 in the middle.
  fine.triangles.resize(4 * faces);
  fine.twin.resize(12 * faces);
  fine.sharp.assign(12 * faces, 0);
  for (std::uint32_t t = 0; t < faces; ++t) {
    for (std::uint32_t c = 0; c < 3; ++c) {
      const std::uint32_t h = 3 * t + c, last = 3 * t + (c + 2) % 3;
      const std::uint32_t corner = 4 * t + c;
      fine.triangles[corner] = {coarse.triangles[t][c], middle[h], middle[last]};
      // The inner edge of the corner's triangle and of the middle one.
      const std::uint32_t inner = 3 * corner + 1, across = 3 * (4 * t + 3) + (c + 2) % 3;
      fine.twin[inner] = across;
      fine.twin[across] = inner;
      // The two halves of h; each half's twin is the other half of h's twin.
      const std::uint32_t first = 3 * corner, second = 3 * (4 * t + (c + 1) % 3) + 2;
      const std::uint32_t other = coarse.twin[h], other_t = other / 3, other_c = other % 3;
      fine.twin[first] = 3 * (4 * other_t + (other_c + 1) % 3) + 2;
      fine.twin[second] = 3 * (4 * other_t + other_c);
      fine.sharp[first] = fine.sharp[second] = coarse.sharp[h];
    }
    fine.triangles[4 * t + 3] = {middle[3 * t], middle[3 * t + 1], middle[3 * t + 2]};
  }
  find_leaving(fine);
  return fine;
}

/// Normal of the limit surface beside a crease: the fan of triangles from `edges[begin]` over
/// `faces` triangles, both ends sharp.
Vec3 sector_normal(const HalfEdges& mesh, const Ring& ring, const Vec3& p, std::size_t begin,
                   std::size_t faces) {
  const Vec3& start = ring.neighbour(mesh, begin);
  const Vec3& end = ring.neighbour(mesh, begin + faces);
  Vec3 inward;  // across the crease, into the fan
  if (faces == 1) {
    inward = start + end - 2 * p;
  } else if (faces == 2) {
    inward = ring.neighbour(mesh, begin + 1) - p;
  } else {
    const double angle = std::numbers::pi / static_cast<double>(faces);
    inward = -std::sin(angle) * (start + end);
    for (std::size_t i = 1; i < faces; ++i)
      inward += (2 - 2 * std::cos(angle)) * std::sin(static_cast<double>(i) * angle) *
                ring.neighbour(mesh, begin + i);
  }
  return (start - end).cross(inward);
}

/// Mean normal of the fan's triangles: what is left at corners, where the limit has no tangent
/// plane.
Vec3 fan_normal(const HalfEdges& mesh, const Ring& ring, const Vec3& p, std::size_t begin,
                std::size_t faces) {
  Vec3 sum = Vec3::Zero();
  for (std::size_t i = 0; i < faces; ++i)
    sum += (ring.neighbour(mesh, begin + i) - p).cross(ring.neighbour(mesh, begin + i + 1) - p);
  return sum;
}

SmoothMesh limit(HalfEdges&& mesh) {
  SmoothMesh out;
  const std::size_t count = mesh.vertices.size();
  out.vertices.resize(count);
  out.normals.resize(count);
  out.corner_normals = mesh.triangles;
  Ring ring;
  for (std::uint32_t v = 0; v < count; ++v) {
    const Vec3& p = mesh.vertices[v];
    ring.gather(mesh, v);
    const std::size_t n = ring.edges.size();
    Vec3 sum = Vec3::Zero(), along = Vec3::Zero(), across = Vec3::Zero();
    for (std::size_t i = 0; i < n; ++i) {
      const double angle = 2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(n);
      const Vec3& q = ring.neighbour(mesh, i);
      sum += q;
      along += std::cos(angle) * q;
      across += std::sin(angle) * q;
    }
    if (ring.creases.size() < 2) {
      const double weight = 1 / (0.375 / loop_beta(n) + static_cast<double>(n));
      out.vertices[v] = (1 - static_cast<double>(n) * weight) * p + weight * sum;
      out.normals[v] = along.cross(across).normalized().cast<float>();
      continue;
    }
    const bool is_corner = ring.creases.size() > 2;
    out.vertices[v] = is_corner ? p
                                : Vec3(2.0 / 3 * p + 1.0 / 6 *
                                                         (ring.neighbour(mesh, ring.creases[0]) +
                                                          ring.neighbour(mesh, ring.creases[1])));
    Vec3 mean = Vec3::Zero();
    for (std::size_t s = 0; s < ring.creases.size(); ++s) {
      const std::size_t begin = ring.creases[s];
      const std::size_t end =
          s + 1 < ring.creases.size() ? ring.creases[s + 1] : ring.creases[0] + n;
      const Vec3 flat = fan_normal(mesh, ring, p, begin, end - begin).normalized();
      Vec3 normal =
          is_corner ? flat : sector_normal(mesh, ring, p, begin, end - begin).normalized();
      // A fan of one flat triangle has no direction across: its mask vanishes or turns over.
      if (!normal.allFinite() || normal.dot(flat) < 0.5) normal = flat;
      mean += normal;
      const auto index = static_cast<std::uint32_t>(out.normals.size());
      out.normals.emplace_back(normal.cast<float>());
      for (std::size_t i = begin; i < end; ++i) {
        const std::uint32_t h = ring.edges[i % n];
        out.corner_normals[h / 3][h % 3] = index;
      }
    }
    out.normals[v] = mean.normalized().cast<float>();
  }
  out.triangles = std::move(mesh.triangles);
  return out;
}

}  // namespace

Result<SmoothMesh> subdivide(const Mesh& mesh, std::size_t min_triangles, double crease_rad) {
  HalfEdges now = ALHAZEN_TRY(tidy(mesh));
  ALHAZEN_TRY(join(now));
  find_leaving(now);
  ALHAZEN_TRY(check_fans(now));
  mark_creases(now, crease_rad);
  std::size_t wanted = now.triangles.size();
  while (wanted < min_triangles) wanted *= 4;
  if (wanted > kMostTriangles)
    return Error{Code::invalid, std::to_string(min_triangles) + " triangles are more than the " +
                                    std::to_string(kMostTriangles) + " possible"};
  while (now.triangles.size() < wanted) now = refine(now);
  return limit(std::move(now));
}

}  // namespace alhazen::sim
