#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "alhazen/result.h"
#include "drivers/sim/rigid.h"
#include "drivers/sim/scene.h"
#include "reconstruct/mesh_io/mesh.h"

namespace alhazen::sim {

/// A half line of the object frame: unit direction.
struct SightLine {
  Vec3 origin_mm, direction;
};

/// Where a sight line first meets the object.
struct SurfaceHit {
  double distance_mm = std::numeric_limits<double>::infinity();  ///< infinite: it does not
  Vec3 point_mm;
  Vec3 normal;  ///< outward, what the mirror obeys
  Vec3 face;    ///< outward, of the flat piece itself: decides what is above and below
};

/// A ball of the object frame; several cover the object, to know which pixels can see it at all.
struct Ball {
  Vec3 centre_mm;
  double radius_mm = 0;
};

/// The true surface of the object, object frame, mm. Sphere and torus are exact; meshes are Loop
/// limit surfaces on at least ObjectTruth::min_triangles triangles, and that is the truth.
/// Immutable, thread-safe.
class Shape {
 public:
  /// Fails: what reading or subdividing the mesh fails with, naming the file.
  [[nodiscard]] static Result<Shape> make(const ObjectTruth& object);

  /// First hits of `lines`, ignoring those within `kSkinMm` of their origins. Any number at once;
  /// neighbours in the list should be neighbours in space.
  /// REQUIRES: hits.size() == lines.size().
  void intersect(std::span<const SightLine> lines, std::span<SurfaceHit> hits) const;

  [[nodiscard]] const std::vector<Ball>& cover() const noexcept { return cover_; }

  /// The surface as triangles with vertex normals: the subdivided mesh itself, or sphere and torus
  /// cut finely (sagitta below 0.1 µm for 25 mm).
  [[nodiscard]] Mesh truth() const;

  /// Reflected light starts this far from the surface, so that it does not meet it again by
  /// rounding.
  static constexpr double kSkinMm = 2e-3;

  struct Triangles;

 private:
  struct Sphere {
    double radius_mm = 0;
    void intersect(const SightLine& line, SurfaceHit& hit) const;
  };
  struct Torus {
    double ring_mm = 0, tube_mm = 0;
    void intersect(const SightLine& line, SurfaceHit& hit) const;
  };

  Form form_ = Form::sphere;
  Sphere sphere_;
  Torus torus_;
  std::shared_ptr<const Triangles> triangles_;
  std::vector<Ball> cover_;
};

}  // namespace alhazen::sim
