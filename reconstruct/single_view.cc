#include "reconstruct/single_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "reconstruct/mesh/clean.h"
#include "reconstruct/mesh/contour.h"
#include "reconstruct/surface/normal_integration.h"
#include "reconstruct/surface/signed_distance.h"
#include "reconstruct/vote/normal_view.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;

constexpr int kFirstLevel = 4, kLeastLevel = 5;
/// Finest leaves on each side of the surface: what signed_distance() works in, and one to spare.
constexpr int kBandLeaves = 6;
/// The flat back lies so many finest leaves behind the deepest point.
constexpr double kBackLeaves = 6;
/// Depths of integrate_normals() are this good against each other, in leaves: they pull the surface
/// where they are, and slopes smooth them.
constexpr double kSigmaLeaves = 0.1;
/// Leaves this far from the surface know a normal and a depth.
constexpr double kNearLeaves = 2;

/// The integrated surface, asked by points of the object frame.
class Relief {
 public:
  Relief(const CameraModel& camera, Pose camera_from_object, const NormalMap& map, DepthMap depth)
      : camera_(camera), pose_(std::move(camera_from_object)), map_(map), depth_(std::move(depth)) {
    for (const float z : depth_.depth_mm) {
      if (std::isfinite(z)) deepest_mm_ = std::max(deepest_mm_, static_cast<double>(z));
    }
  }

  /// What the view knows of the sight line through a point.
  struct Seen {
    double gap_mm = 0;     ///< from the point to the surface along the camera's z; positive: before
    double offset_mm = 0;  ///< signed distance of the point from the surface's plane
    Vector3d normal_object;
  };
  /// Nothing where the sight line misses the object.
  [[nodiscard]] std::optional<Seen> look(const Vector3d& p_object_mm) const {
    const Vector3d p = pose_ * p_object_mm;
    const auto pixel = camera_.project(p);
    if (!pixel) return std::nullopt;
    const double x = pixel->x() - map_.region.x, y = pixel->y() - map_.region.y;
    const double column = std::floor(x), row = std::floor(y);
    if (!(column >= 0 && row >= 0 && column + 1 < map_.region.width &&
          row + 1 < map_.region.height)) {
      return std::nullopt;
    }
    const double fx = x - column, fy = y - row;
    Vector3d normal = Vector3d::Zero();
    double depth_mm = 0, weights = 0, nearest = 0;
    for (int k = 0; k < 4; ++k) {
      const int dx = k % 2, dy = k / 2;
      const auto i = (static_cast<std::size_t>(row) + static_cast<std::size_t>(dy)) *
                         static_cast<std::size_t>(map_.region.width) +
                     static_cast<std::size_t>(column) + static_cast<std::size_t>(dx);
      if (!std::isfinite(depth_.depth_mm[i])) continue;
      const double weight = (dx == 1 ? fx : 1 - fx) * (dy == 1 ? fy : 1 - fy);
      normal += weight * map_.normal[i].cast<double>();
      depth_mm += weight * static_cast<double>(depth_.depth_mm[i]);
      weights += weight;
      nearest = std::max(nearest, weight);
    }
    // Outside of the outline, by the pixel that is nearest.
    if (weights < 0.5 || nearest <= 0 || !(normal.norm() > 0.1)) return std::nullopt;
    depth_mm /= weights;
    normal.normalize();
    const Vector3d surface = p * (depth_mm / p.z());
    return Seen{depth_mm - p.z(), (p - surface).dot(normal), pose_.rotation.transpose() * normal};
  }
  [[nodiscard]] bool is_inside(const Vector3d& p_object_mm, double back_mm) const {
    const auto seen = look(p_object_mm);
    return seen && seen->gap_mm <= 0 && (pose_ * p_object_mm).z() <= deepest_mm_ + back_mm;
  }
  /// Whether the camera sees it as something else than a slope along its sight line.
  [[nodiscard]] bool is_facing(const Vector3d& p_object_mm, const Vector3d& normal_object,
                               double min_cosine) const {
    const Vector3d sight = (pose_ * p_object_mm).normalized();
    return -(pose_.rotation * normal_object).dot(sight) > min_cosine;
  }

 private:
  const CameraModel& camera_;
  Pose pose_;
  const NormalMap& map_;
  DepthMap depth_;
  double deepest_mm_ = 0;
};

Indicator inside_of(const Octree& octree, const Relief& relief, double back_mm) {
  Indicator cut;
  cut.u.resize(octree.size());
  for_blocks(octree.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      cut.u[i] = relief.is_inside(octree.centre_mm(i), back_mm) ? 1.0F : 0.0F;
    }
  });
  return cut;
}

/// Wants `level` within `leaves` steps over faces of the cut and coarse leaves elsewhere.
std::vector<std::uint8_t> wanted_levels(const Octree& octree, const std::vector<Face>& faces,
                                        const Indicator& cut, int level, int leaves) {
  std::vector<std::uint8_t> wanted(octree.size(), static_cast<std::uint8_t>(kFirstLevel));
  for (const Face& face : faces) {
    if (cut.u[face.a] != cut.u[face.b]) {
      wanted[face.a] = wanted[face.b] = static_cast<std::uint8_t>(level);
    }
  }
  for (int step = 1; step < leaves; ++step) {
    std::vector<std::uint8_t> next = wanted;
    for (const Face& face : faces) {
      const std::uint8_t most = std::max(wanted[face.a], wanted[face.b]);
      next[face.a] = std::max(next[face.a], most);
      next[face.b] = std::max(next[face.b], most);
    }
    wanted = std::move(next);
  }
  return wanted;
}

}  // namespace

Result<Reconstructed> reconstruct_single_view(const Rig& rig, const NormalMap& map,
                                              const Volume& volume, int level,
                                              const Options& options, const Run& run) {
  // Both check what they are given.
  static_cast<void>(ALHAZEN_TRY(Reconstruction::make(rig, volume, level, options)));
  static_cast<void>(ALHAZEN_TRY(make_normal_view(map, rig, options.vote)));
  if (level < kLeastLevel) {
    return Error{Code::invalid, "level is " + std::to_string(level) + ", allowed 5 to 11"};
  }
  Reconstructed result{{}, Octree::uniform(volume, kFirstLevel), {}, {}, {}, {}, {}, 0, 0, 0};
  result.normal_maps = 1;
  const CameraModel& camera = *rig.camera(map.key.camera);
  const Pose camera_from_object =
      camera.camera_from_rig * rig.turntable.rig_from_object(map.angle_rad);
  const double centre_depth_mm = (camera_from_object * volume.centre_mm).z();
  if (!(centre_depth_mm > 0)) {
    return Error{Code::invalid, "the volume's centre lies behind camera '" + camera.name + "'"};
  }
  StageClock clock;
  const auto finish_stage = [&](const char* stage) {
    result.times.push_back(clock.read(stage));
    clock = StageClock();
  };
  DepthMap depth = ALHAZEN_TRY(integrate_normals(map, camera, centre_depth_mm, {}, run));
  const Relief relief(camera, camera_from_object, map, std::move(depth));
  finish_stage("integrate");

  const double edge_mm = volume.edge_mm / static_cast<double>(1 << level);
  const double back_mm = kBackLeaves * edge_mm;
  for (int to = kFirstLevel + 1; to <= level; ++to) {
    // A coarse leaf may hide what its centre does not meet, so each level looks twice.
    for (int pass = 0; pass < 2; ++pass) {
      if (run.stopped()) return Error{Code::cancelled, "the reconstruction was stopped"};
      run.tell("octree", (to - kFirstLevel - 1 + 0.5 * pass) / (level - kFirstLevel));
      const Indicator cut = inside_of(result.octree, relief, back_mm);
      result.octree = result.octree.adapted(
          wanted_levels(result.octree, result.octree.faces(), cut, to, kBandLeaves));
    }
  }
  const std::size_t size = result.octree.size();
  const std::vector<Face> faces = result.octree.faces();
  result.indicator = inside_of(result.octree, relief, back_mm);
  result.field.normal.assign(size, Eigen::Vector3f::Zero());
  result.field.consistency.assign(size, 0);
  result.field.support.assign(size, 0);
  result.field.votes.assign(size, 0);
  result.field.free_space.assign(size, 0);
  result.field.no_surface.assign(size, 0);
  result.divergence.assign(size, 0);
  SurfaceSamples samples;
  samples.normal.assign(size, Eigen::Vector3f::Zero());
  samples.offset_mm.assign(size, 0);
  samples.weight.assign(size, 0);
  for_blocks(size, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (result.octree.leaves()[i].level < level) continue;
      const Vector3d p = result.octree.centre_mm(i);
      const auto seen = relief.look(p);
      if (!seen || std::abs(seen->offset_mm) > kNearLeaves * edge_mm ||
          !relief.is_facing(p, seen->normal_object, options.vote.min_cosine)) {
        continue;
      }
      samples.normal[i] = seen->normal_object.cast<float>();
      samples.offset_mm[i] = static_cast<float>(seen->offset_mm);
      samples.weight[i] = static_cast<float>(1 / (kSigmaLeaves * edge_mm * kSigmaLeaves * edge_mm));
      result.field.normal[i] = samples.normal[i];
      result.field.consistency[i] = 1;
      result.field.votes[i] = 1;
    }
  });
  finish_stage("octree");
  SignedDistance distance = ALHAZEN_TRY(
      signed_distance(result.octree, faces, result.indicator, samples, options.surface, run));
  finish_stage("surface");
  LeafFacts facts;
  facts.consistency = result.field.consistency;
  facts.observed.assign(size, 0);
  facts.depth_sigma_mm.assign(size, 0);
  for (std::size_t i = 0; i < size; ++i) {
    if (samples.weight[i] <= 0 || distance.in_band[i] == 0) continue;
    const double off_mm =
        std::abs(static_cast<double>(distance.value_mm[i]) - samples.offset_mm[i]);
    facts.observed[i] = off_mm <= 3 * kSigmaLeaves * edge_mm ? 1 : 0;
    facts.depth_sigma_mm[i] = static_cast<float>(kSigmaLeaves * edge_mm);
  }
  result.mesh = ALHAZEN_TRY(contour(result.octree, distance.value_mm, run));
  CleanOptions cleaning;
  cleaning.min_edge_mm = 0.05 * edge_mm;
  result.mesh = ALHAZEN_TRY(clean(std::move(result.mesh), cleaning));
  annotate(result.octree, facts, result.mesh);
  finish_stage("mesh");
  return result;
}

}  // namespace alhazen
