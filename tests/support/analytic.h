#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <variant>
#include <vector>

#include "reconstruct/geometry/rig.h"
#include "reconstruct/scan/light_map.h"

/// Exact light maps of simple mirrors: a third geometry, written apart from reconstruct/ and from
/// drivers/sim, by which both are judged. For tests only.
namespace alhazen::analytic {

/// Mirrors, object frame.
struct Sphere {
  Eigen::Vector3d centre_mm{0, 0, 50};
  double radius_mm = 25;
};
/// Its axis is z.
struct Torus {
  Eigen::Vector3d centre_mm{0, 0, 50};
  double ring_mm = 25, tube_mm = 10;
};
/// A half space below the plane; the normal points out of it.
struct Plane {
  Eigen::Vector3d point_mm{0, 0, 50};
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
};
using Shape = std::variant<Sphere, Torus, Plane>;

/// Signed distance, positive outside.
[[nodiscard]] double distance_mm(const Shape& shape, const Eigen::Vector3d& p_mm);
/// Outward normal of the level set through a point.
[[nodiscard]] Eigen::Vector3d normal(const Shape& shape, const Eigen::Vector3d& p_mm);

/// What the code adds to exact positions.
struct Coding {
  /// Positions are rounded to the middle of the finest Gray cell that survives the blur: the
  /// largest power of two not above footprint / 3.2 display pixels, at least one pixel.
  bool gray = false;
  double noise_px = 0;       ///< standard deviation added to u and v
  double outlier_share = 0;  ///< share of the positions replaced by uniform ones
  std::uint32_t seed = 1;    ///< of noise and outliers
};

/// How large a rig is wanted.
struct RigSize {
  int cameras = 11;        ///< on an arc from 5° to 85° above the plate, 650 mm away
  double pixel_mm = 0.15;  ///< of a camera, on the object
  int sensor_px = 1024;
  bool has_distortion = true;
  bool has_above = true;      ///< a third display, above
  bool tablet_turns = false;  ///< the display below is mounted on the turntable
};

/// A rig like the thesis's: a monitor "side", a tablet "below" and a monitor "above", all facing
/// the middle of the default volume; a slightly tilted, shifted axis.
[[nodiscard]] Rig make_rig(const RigSize& size = {});

/// How far a calibration lies from the truth: standard deviations, as `alhazen-world rig` draws
/// them.
struct RigError {
  double camera_px = 0.05;       ///< of where a camera sees things: its turn about its three axes
  double display_mm = 0.1;       ///< each coordinate of a display's middle
  double display_rad = 3.49e-4;  ///< its turn about its three axes: 0.02°
  double axis_mm = 0.005;        ///< where the turntable's axis stands, across it
  std::uint32_t seed = 1;
};
[[nodiscard]] Rig with_error(const Rig& rig, const RigError& error);

/// The light map of one display seen by one camera, exact but for `coding`. Pixels whose corners
/// do not all see the same thing are Label::mixed; reflections that meet the mirror again are
/// Label::second_bounce without a position.
/// `region` of the sensor; empty: the whole one.
[[nodiscard]] LightMap light_map(const Rig& rig, const Shape& shape, const StackKey& key,
                                 double angle_rad, const Coding& coding, Region region = {});

/// The region of `camera` that shows a ball of `radius_mm` about `centre_mm` (object frame) at
/// every angle of the turntable, cut at the sensor's edge.
[[nodiscard]] Region region_of(const Rig& rig, const CameraModel& camera,
                               const Eigen::Vector3d& centre_mm, double radius_mm);

/// Every light map of a scan of `stops` equal steps, in order of stop, display, camera, cropped
/// to the ball. Two threads render, the caller's calls the sink.
void scan(const Rig& rig, const Shape& shape, int stops, const Coding& coding,
          const Eigen::Vector3d& ball_centre_mm, double ball_radius_mm,
          const std::function<void(LightMap)>& sink);

}  // namespace alhazen::analytic
