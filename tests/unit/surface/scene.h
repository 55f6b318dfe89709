#pragma once

#include <tbb/global_control.h>

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <random>
#include <vector>

#include "reconstruct/surface/indicator.h"
#include "reconstruct/surface/signed_distance.h"
#include "reconstruct/vote/normal_field.h"
#include "reconstruct/vote/octree.h"

namespace alhazen::scene {

/// Analytic surfaces and what an ideal voting stage would say about them.
using Distance = std::function<double(const Eigen::Vector3d&)>;

#if defined(__SANITIZE_THREAD__)
/// Octrees are built by TBB, whose hand-overs the thread sanitizer takes for races, millions of
/// them: one thread there. The stages under test use two that it understands (vote/parallel.h).
inline const tbb::global_control kOneThread(tbb::global_control::max_allowed_parallelism, 1);
#endif

inline const Volume kVolume{Eigen::Vector3d(3, -2, 40), 64};

/// Distances about the volume's centre, mm, positive outside.
inline Distance sphere(double radius_mm) {
  return
      [radius_mm](const Eigen::Vector3d& p) { return (p - kVolume.centre_mm).norm() - radius_mm; };
}
inline Distance torus(double ring_mm, double tube_mm) {
  return [=](const Eigen::Vector3d& p) {
    const Eigen::Vector3d q = p - kVolume.centre_mm;
    return std::hypot(std::hypot(q.x(), q.y()) - ring_mm, q.z()) - tube_mm;
  };
}

inline Eigen::Vector3d gradient(const Distance& f, const Eigen::Vector3d& p) {
  constexpr double kStep = 1e-5;
  Eigen::Vector3d g;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d d = kStep * Eigen::Vector3d::Unit(axis);
    g[axis] = (f(p + d) - f(p - d)) / (2 * kStep);
  }
  return g.normalized();
}

inline Octree refined_near(const Distance& distance_mm, int coarse, int fine, double band_leaves) {
  Octree octree = Octree::uniform(kVolume, coarse);
  for (int level = coarse + 1; level <= fine; ++level) {
    std::vector<std::uint8_t> target(octree.size());
    for (std::size_t i = 0; i < octree.size(); ++i) {
      const bool is_near =
          std::abs(distance_mm(octree.centre_mm(i))) < band_leaves * octree.edge_mm(i);
      target[i] = static_cast<std::uint8_t>(is_near ? level : coarse);
    }
    octree = octree.adapted(target);
  }
  return octree;
}

/// N = ∇d, c = exp(−d²/2σ²); normals turned by noise of `noise_rad` per axis.
inline NormalField field(const Octree& octree, const Distance& distance_mm, double sigma_mm,
                         double noise_rad = 0) {
  NormalField out;
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0, 1);
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Eigen::Vector3d p = octree.centre_mm(i);
    const double d = distance_mm(p) / sigma_mm;
    const Eigen::Vector3d noise(normal(random), normal(random), normal(random));
    out.normal.push_back((gradient(distance_mm, p) + noise_rad * noise).normalized().cast<float>());
    out.consistency.push_back(static_cast<float>(std::exp(-0.5 * d * d)));
    out.support.push_back(10);
    out.votes.push_back(20);
    out.free_space.push_back(0);
  }
  return out;
}

/// The set that is inside by the distance, as a cut would give it.
inline Indicator inside(const Octree& octree, const Distance& distance_mm) {
  Indicator cut;
  for (std::size_t i = 0; i < octree.size(); ++i)
    cut.u.push_back(distance_mm(octree.centre_mm(i)) < 0 ? 1.0F : 0.0F);
  return cut;
}

/// Exact normals and depths within a leaf of the surface.
inline SurfaceSamples samples(const Octree& octree, const Distance& distance_mm) {
  SurfaceSamples out;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Eigen::Vector3d p = octree.centre_mm(i);
    const double d = distance_mm(p);
    out.normal.push_back(gradient(distance_mm, p).cast<float>());
    out.offset_mm.push_back(static_cast<float>(d));
    out.weight.push_back(std::abs(d) < octree.edge_mm(i) ? 1e4F : 0.0F);
  }
  return out;
}

}  // namespace alhazen::scene
