#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "reconstruct/geometry/rig.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/normals/normal_map.h"
#include "reconstruct/normals/photometric_stereo.h"

/// Views of a mesh as cameras see it: normal maps and shaded pictures, by Embree, written apart
/// from reconstruct/. For tests and experiments only.
namespace alhazen::views {

/// Where a ray meets the mesh.
struct Hit {
  Eigen::Vector3d point_mm;
  Eigen::Vector3d normal;  ///< unit, outward; interpolated where the mesh has normals
  std::uint32_t triangle = 0;
  Eigen::Vector3d weights;  ///< of the triangle's corners
};

/// A mesh that rays can be shot at. Immutable, thread-safe.
class Target {
 public:
  /// REQUIRES: indices within the vertices.
  explicit Target(const Mesh& mesh);
  Target(const Target&) = delete;
  Target& operator=(const Target&) = delete;
  ~Target();

  [[nodiscard]] std::optional<Hit> first_hit(const Eigen::Vector3d& origin_mm,
                                             const Eigen::Vector3d& direction) const;
  /// Whether anything is met between 1 µm · 20 and `reach_mm`.
  [[nodiscard]] bool is_blocked(const Eigen::Vector3d& origin_mm, const Eigen::Vector3d& direction,
                                double reach_mm) const;
  [[nodiscard]] const Mesh& mesh() const noexcept { return mesh_; }

 private:
  struct Scene;
  Mesh mesh_;
  std::unique_ptr<Scene> scene_;
};

/// Cameras that look at `centre_mm` from `distance_mm` away, one per elevation, all at azimuth 0
/// (they see a turning object); `pixel_mm` on the object, `sensor_px` wide and high.
[[nodiscard]] Rig ring_of_cameras(const std::vector<double>& elevations_rad, double distance_mm,
                                  double pixel_mm, int sensor_px, const Eigen::Vector3d& centre_mm);

/// The exact normals at pixel centres. A pixel is background where neither its centre nor any of
/// its corners sees the mesh, unknown where only some do.
[[nodiscard]] NormalMap render_normals(const Target& target, const Rig& rig, NormalMapKey key,
                                       double angle_rad);

/// How the simulated surface answers light.
struct Paint {
  double albedo = 0.7;
  double gloss = 0;      ///< strength of the lobe (Blinn-Phong, normalised)
  double exponent = 60;  ///< its sharpness
};
/// By a point of the object frame.
using PaintAt = Paint (*)(const Eigen::Vector3d& p_object_mm);

/// What a camera sees under each of several lights that are fixed to the rig.
struct ShadedView {
  LightStack stack;  ///< lights in the camera frame
  NormalMap truth;   ///< its labels make the stack's mask
};
struct ShadingOptions {
  double exposure = 1;   ///< full scale for a white surface lit straight on is 1/exposure
  double noise = 0.002;  ///< standard deviation, share of full scale
  int bits = 10;         ///< of the sensor
  std::uint32_t seed = 1;
};
/// `lights_rig`: unit directions towards far lights. Cast shadows are traced; light that bounces
/// between parts of the object is not.
[[nodiscard]] ShadedView render_shaded(const Target& target, const Rig& rig, NormalMapKey key,
                                       double angle_rad,
                                       const std::vector<Eigen::Vector3d>& lights_rig,
                                       PaintAt paint, const ShadingOptions& options);

}  // namespace alhazen::views
