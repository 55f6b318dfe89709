#include "reconstruct/report/compare.h"

#include <tbb/parallel_sort.h>

#include <Eigen/Dense>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <numeric>
#include <string>

#include "reconstruct/report/triangle_tree.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

constexpr double kNear_mm = 0.3, kClosed_mm = 1.0;  // of docs/design.md's protocol
constexpr double kDegree = std::numbers::pi / 180;

/// Runs body(i) for every i on all threads; false where it was stopped on the way.
template <class Body>
bool for_each(std::size_t count, const Run& run, const Body& body) {
  constexpr std::size_t kPoints = 256;  // a task's: well under a millisecond
  std::atomic<bool> is_stopped{false};
  for_each_index((count + kPoints - 1) / kPoints, [&](std::size_t task) {
    if (run.stopped()) is_stopped = true;
    if (is_stopped) return;
    const std::size_t end = std::min(count, (task + 1) * kPoints);
    for (std::size_t i = task * kPoints; i < end; ++i) body(i);
  });
  return !is_stopped;
}

Error cancelled() { return Error{Code::cancelled, "the comparison was stopped"}; }

Status check_mesh(const Mesh& mesh, const char* name) {
  if (mesh.triangles.empty()) return Error{Code::invalid, std::string(name) + " has no triangles"};
  for (const std::size_t size : {mesh.normals.size(), mesh.observed.size()}) {
    if (size != 0 && size != mesh.vertices_mm.size())
      return Error{Code::invalid, std::string(name) + " has a per-vertex list of " +
                                      std::to_string(size) + " values for " +
                                      std::to_string(mesh.vertices_mm.size()) + " vertices"};
  }
  for (const auto& triangle : mesh.triangles) {
    for (const std::uint32_t corner : triangle) {
      if (corner >= mesh.vertices_mm.size())
        return Error{Code::invalid, std::string(name) + " has an index out of range"};
    }
  }
  for (const auto& p : mesh.vertices_mm) {
    // The bound keeps squares and products of squares finite.
    if (!p.allFinite() || p.cwiseAbs().maxCoeff() > 1e9)
      return Error{Code::invalid, std::string(name) + " has a vertex that is not within 1e9 mm"};
  }
  return {};
}

bool is_observed(const Mesh& mesh, std::size_t vertex) {
  return mesh.observed.empty() || mesh.observed[vertex] != 0;
}

/// The smallest value that `share` of all do not exceed. REQUIRES: not empty.
double percentile(std::vector<double>& values, double share) {
  const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size())));
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(std::max<std::size_t>(rank, 1) - 1);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// REQUIRES: not empty.
DistanceFigures figures_of(std::vector<double> distances) {
  DistanceFigures figures;
  figures.count = distances.size();
  double squares = 0;
  for (const double d : distances) squares += d * d;
  figures.rms_mm = std::sqrt(squares / static_cast<double>(distances.size()));
  figures.max_mm = *std::max_element(distances.begin(), distances.end());
  figures.p99_mm = percentile(distances, 0.99);
  figures.p90_mm = percentile(distances, 0.90);
  return figures;
}

Eigen::Vector3d cross_of(const Mesh& mesh, std::size_t triangle) {
  const auto& [a, b, c] = mesh.triangles[triangle];
  return (mesh.vertices_mm[b] - mesh.vertices_mm[a])
      .cross(mesh.vertices_mm[c] - mesh.vertices_mm[a]);
}

/// On which side of a closed surface a point lies, by the pseudonormal of the nearest feature:
/// mean of the faces about an edge, angle-weighted mean about a vertex (Baerentzen and Aanaes,
/// IEEE TVCG 11(3), 2005). Face normals alone fail at sharp edges.
class Sides {
 public:
  explicit Sides(const Mesh& mesh) : mesh_(mesh) {
    const std::size_t triangles = mesh.triangles.size();
    face_.resize(triangles);
    vertex_.assign(mesh.vertices_mm.size(), Eigen::Vector3d::Zero());
    struct HalfEdge {
      std::uint64_t ends;  ///< both vertices, the smaller one above
      std::uint32_t side;  ///< 3 triangle + k: edge from corner k to the next
    };
    std::vector<HalfEdge> edges(3 * triangles);
    for (std::size_t t = 0; t < triangles; ++t) {
      face_[t] = cross_of(mesh, t).normalized();
      if (!face_[t].allFinite()) face_[t].setZero();
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t from = mesh.triangles[t][k], to = mesh.triangles[t][(k + 1) % 3];
        const std::uint32_t back = mesh.triangles[t][(k + 2) % 3];
        const Eigen::Vector3d u = mesh.vertices_mm[to] - mesh.vertices_mm[from];
        const Eigen::Vector3d v = mesh.vertices_mm[back] - mesh.vertices_mm[from];
        vertex_[from] += std::atan2(u.cross(v).norm(), u.dot(v)) * face_[t];
        edges[3 * t + k] = {std::uint64_t{std::min(from, to)} << 32U | std::max(from, to),
                            static_cast<std::uint32_t>(3 * t + k)};
      }
    }
    tbb::parallel_sort(edges.begin(), edges.end(), [](const HalfEdge& a, const HalfEdge& b) {
      return a.ends != b.ends ? a.ends < b.ends : a.side < b.side;
    });
    neighbour_.resize(3 * triangles);
    for (std::size_t t = 0; t < triangles; ++t) {
      for (std::size_t k = 0; k < 3; ++k)
        neighbour_[3 * t + k] = static_cast<std::uint32_t>(t);  // none: a border
    }
    for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
      if (edges[i].ends != edges[i + 1].ends) continue;
      neighbour_[edges[i].side] = edges[i + 1].side / 3;
      neighbour_[edges[i + 1].side] = edges[i].side / 3;
    }
  }

  /// +1 outside or on the surface, −1 inside.
  [[nodiscard]] double sign(const Eigen::Vector3d& p, const Nearest& at) const {
    return (p - at.point_mm).dot(normal(at)) < 0 ? -1.0 : 1.0;
  }

  /// Smooth normal of the surface at a point: interpolated where the mesh has normals.
  [[nodiscard]] Eigen::Vector3d smooth_normal(const Nearest& at) const {
    if (mesh_.normals.empty()) return face_[at.triangle];
    const auto& [a, b, c] = mesh_.triangles[at.triangle];
    const Eigen::Vector3d n = at.weights[0] * mesh_.normals[a].cast<double>() +
                              at.weights[1] * mesh_.normals[b].cast<double>() +
                              at.weights[2] * mesh_.normals[c].cast<double>();
    const double length = n.norm();
    return length > 0 ? Eigen::Vector3d(n / length) : face_[at.triangle];
  }

 private:
  [[nodiscard]] Eigen::Vector3d normal(const Nearest& at) const {
    const auto zeros = (at.weights.array() == 0).count();
    if (zeros == 0) return face_[at.triangle];
    Eigen::Index k = 0;
    if (zeros >= 2) {
      at.weights.maxCoeff(&k);
      return vertex_[mesh_.triangles[at.triangle][static_cast<std::size_t>(k)]];
    }
    at.weights.minCoeff(&k);  // the corner across; its edge begins at the next corner
    const std::size_t edge = (static_cast<std::size_t>(k) + 1) % 3;
    return face_[at.triangle] + face_[neighbour_[3 * at.triangle + edge]];
  }

  const Mesh& mesh_;
  std::vector<Eigen::Vector3d> face_, vertex_;
  std::vector<std::uint32_t> neighbour_;  ///< 3 triangle + k: across the edge from corner k
};

/// Number from 0 to 1 that follows from (seed, index) alone (the finaliser of SplitMix64).
double random_share(std::uint64_t seed, std::uint64_t index) {
  std::uint64_t z = seed * 0xd1342543de82ef95ULL + (index + 1) * 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27U)) * 0x94d049bb133111ebULL;
  z ^= z >> 31U;
  return static_cast<double>(z >> 11U) * 0x1p-53;
}

/// Points spread evenly over a mesh's area: one in each of `count` equal parts of the running area.
std::vector<Eigen::Vector3d> samples_of(const Mesh& mesh, const CompareOptions& options) {
  std::vector<double> area_before(mesh.triangles.size() + 1, 0.0);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
    area_before[t + 1] = area_before[t] + cross_of(mesh, t).norm() / 2;
  const double total = area_before.back();
  std::vector<Eigen::Vector3d> samples(options.samples);
  for (std::uint64_t i = 0; i < options.samples; ++i) {
    const double at = (static_cast<double>(i) + random_share(options.seed, 3 * i)) /
                      static_cast<double>(options.samples) * total;
    const auto after = std::upper_bound(area_before.begin() + 1, area_before.end() - 1, at);
    const auto& [a, b, c] =
        mesh.triangles[static_cast<std::size_t>(after - area_before.begin()) - 1];
    // Uniform over the triangle: the root makes up for its narrowing (Osada et al. 2002).
    const double r = std::sqrt(random_share(options.seed, 3 * i + 1));
    const double s = random_share(options.seed, 3 * i + 2);
    samples[i] = (1 - r) * mesh.vertices_mm[a] + r * (1 - s) * mesh.vertices_mm[b] +
                 r * s * mesh.vertices_mm[c];
  }
  return samples;
}

/// Centre of the sphere of known radius through points, by Gauss-Newton from their mean.
Result<SphereFit> fit_sphere(const std::vector<Eigen::Vector3d>& points, double radius_mm) {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const auto& p : points) centre += p;
  centre /= static_cast<double>(points.size());
  constexpr int kRounds = 200;  // a small cap of a sphere converges slowly
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const auto& p : points) {
      const Eigen::Vector3d d = p - centre;
      const double length = d.norm();
      if (length <= 0) continue;
      const Eigen::Vector3d n = d / length;
      normal += n * n.transpose();
      right += n * (length - radius_mm);
    }
    const Eigen::Vector3d step = normal.ldlt().solve(right);
    // The mean of a cap lies near its base, the centre a radius below: long steps overshoot.
    const double length = step.norm();
    if (!std::isfinite(length))
      return Error{Code::invalid, "the vertices fix no centre of a sphere"};
    centre += length > radius_mm ? Eigen::Vector3d(step * (radius_mm / length)) : step;
    if (length < 1e-12 * radius_mm) break;
  }
  std::vector<double> distances;
  distances.reserve(points.size());
  for (const auto& p : points) distances.push_back(std::abs((p - centre).norm() - radius_mm));
  return SphereFit{centre, figures_of(std::move(distances))};
}

}  // namespace

Result<Comparison> compare(const Mesh& mesh, const Mesh& reference, const CompareOptions& options,
                           const Run& run) {
  ALHAZEN_TRY(check_mesh(mesh, "the mesh"));
  ALHAZEN_TRY(check_mesh(reference, "the reference"));
  if (options.samples < 1000 || options.samples > 100'000'000)
    return Error{Code::invalid,
                 "samples = " + std::to_string(options.samples) + " is outside 1000 … 100000000"};
  constexpr std::string_view kStage = "compare";
  run.tell(kStage, 0);

  // Mesh → reference.
  Comparison comparison;
  const std::size_t vertices = mesh.vertices_mm.size();
  std::vector<double> distances(vertices), angles_deg(vertices);
  comparison.signed_mm.resize(vertices);
  {
    const TriangleTree tree(reference);
    const Sides sides(reference);
    run.tell(kStage, 0.3);
    const bool is_done = for_each(vertices, run, [&](std::size_t i) {
      const Eigen::Vector3d& p = mesh.vertices_mm[i];
      const Nearest at = *tree.nearest(p);
      distances[i] = at.distance_mm;
      comparison.signed_mm[i] = static_cast<float>(sides.sign(p, at) * at.distance_mm);
      if (mesh.normals.empty()) return;
      const Eigen::Vector3d n = mesh.normals[i].cast<double>(), m = sides.smooth_normal(at);
      angles_deg[i] = std::atan2(n.cross(m).norm(), n.dot(m)) / kDegree;
    });
    if (!is_done) return cancelled();
  }
  run.tell(kStage, 0.5);
  std::vector<double> observed, observed_angles;
  for (std::size_t i = 0; i < vertices; ++i) {
    if (!is_observed(mesh, i)) continue;
    observed.push_back(distances[i]);
    observed_angles.push_back(angles_deg[i]);
    comparison.bias_mm += static_cast<double>(comparison.signed_mm[i]);
  }
  if (!observed.empty()) {
    const auto count = static_cast<double>(observed.size());
    comparison.bias_mm /= count;
    comparison.observed = figures_of(std::move(observed));
    if (!mesh.normals.empty()) {
      const double sum = std::accumulate(observed_angles.begin(), observed_angles.end(), 0.0);
      comparison.observed_normals = NormalFigures{sum / count, percentile(observed_angles, 0.9)};
    }
  }
  comparison.all = figures_of(std::move(distances));

  // Reference → mesh: even samples for the shares, its own vertices too for the maximum.
  const std::vector<Eigen::Vector3d> samples = samples_of(reference, options);
  std::vector<std::uint32_t> observed_triangles;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& [a, b, c] = mesh.triangles[t];
    if (is_observed(mesh, a) && is_observed(mesh, b) && is_observed(mesh, c))
      observed_triangles.push_back(static_cast<std::uint32_t>(t));
  }
  const TriangleTree closed_tree(mesh);
  const TriangleTree observed_tree(mesh, observed_triangles);
  run.tell(kStage, 0.6);
  std::vector<double> back(samples.size() + reference.vertices_mm.size());
  std::vector<std::uint8_t> is_near(samples.size());
  const bool is_done = for_each(back.size(), run, [&](std::size_t i) {
    const bool is_sample = i < samples.size();
    const auto& p = is_sample ? samples[i] : reference.vertices_mm[i - samples.size()];
    back[i] = closed_tree.nearest(p)->distance_mm;
    if (is_sample) is_near[i] = observed_tree.nearest(p, kNear_mm).has_value() ? 1 : 0;
  });
  if (!is_done) return cancelled();
  const auto sample_count = static_cast<double>(samples.size());
  comparison.completeness_0_3mm =
      static_cast<double>(std::count(is_near.begin(), is_near.end(), 1)) / sample_count;
  const auto samples_end = back.begin() + static_cast<std::ptrdiff_t>(samples.size());
  comparison.coverage_1mm =
      static_cast<double>(
          std::count_if(back.begin(), samples_end, [](double d) { return d <= kClosed_mm; })) /
      sample_count;
  const double vertex_max = *std::max_element(back.begin(), back.end());
  back.resize(samples.size());
  comparison.reference_to_mesh = figures_of(std::move(back));
  comparison.reference_to_mesh.max_mm = vertex_max;
  comparison.hausdorff_mm = std::max(comparison.all.max_mm, vertex_max);
  run.tell(kStage, 1);
  return comparison;
}

Result<SphereComparison> compare_sphere(const Mesh& mesh, double radius_mm) {
  if (!(radius_mm > 0) || !std::isfinite(radius_mm))
    return Error{Code::invalid, "a sphere's radius must be above 0 mm"};
  constexpr std::size_t kLeast = 4;
  if (mesh.vertices_mm.size() < kLeast)
    return Error{Code::invalid, "the mesh has fewer than 4 vertices"};
  SphereComparison comparison;
  comparison.all = ALHAZEN_TRY(fit_sphere(mesh.vertices_mm, radius_mm));
  std::vector<Eigen::Vector3d> observed;
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    if (is_observed(mesh, i)) observed.push_back(mesh.vertices_mm[i]);
  }
  if (observed.size() >= kLeast) comparison.observed = ALHAZEN_TRY(fit_sphere(observed, radius_mm));
  return comparison;
}

}  // namespace alhazen
