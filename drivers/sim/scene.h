#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "alhazen/clock.h"
#include "alhazen/result.h"
#include "drivers/sim/lens.h"
#include "drivers/sim/rigid.h"

namespace alhazen::sim {

/// A camera as it truly is.
struct CameraTruth {
  std::string id;
  int width_px = 0, height_px = 0;
  Lens lens;
  Rigid camera_from_rig;
};

/// The sensor that all cameras of a world share.
struct SensorTruth {
  int bits = 8;             ///< 8, 12 or 16
  double full_well_e = 0;   ///< electrons at which a pixel saturates
  double read_noise_e = 0;  ///< standard deviation
  bool shot_noise = true;
  double black_level_share = 0;   ///< digital value without light, share of white
  Micros saturation_exposure{0};  ///< a white display (radiance 1) fills the well in this time
  Micros exposure_min{0}, exposure_max{0};
  double gain_max_db = 0;
  Micros readout{0};  ///< from the end of an exposure to the frame's arrival
};

enum class Fixed : std::uint8_t { to_rig, to_turntable };

/// A display as it truly is. Its point for pixel (u, v) is origin + u·u_mm + v·v_mm, in the rig
/// frame, or in the object frame where it is fixed to the turntable.
struct DisplayTruth {
  std::string id;
  int width_px = 0, height_px = 0;
  Vec3 origin_mm, u_mm, v_mm;
  Fixed fixed = Fixed::to_rig;
  double gamma = 1;        ///< light = value^gamma
  double black_share = 0;  ///< light of a black pixel, share of a white one
  double refresh_hz = 60;
  Micros latency{0};   ///< from show() to the first refresh that can carry the picture
  Micros response{0};  ///< then the light goes from the old picture to the new one in this time
};

struct TableTruth {
  Vec3 point_mm = Vec3::Zero(), direction = Vec3::UnitZ();
  double speed_rad_s = 0, acceleration_rad_s2 = 0;
  double backlash_rad = 0;        ///< the table lags by this when it is approached from above
  double position_error_rad = 0;  ///< largest error of a resting position, a function of the angle
  double wobble_rad = 0;          ///< largest tilt of the axis, a function of the angle
  double encoder_step_rad = 0;
  double min_rad = 0, max_rad = 0;  ///< travel; equal: endless
};

enum class Form : std::uint8_t { sphere, torus, pits, mesh };

/// The object that is scanned: stands on z = 0, centred on the axis, in the object frame.
struct ObjectTruth {
  Form form = Form::sphere;
  double radius_mm = 0;                           ///< sphere
  double ring_radius_mm = 0, tube_radius_mm = 0;  ///< torus, lying
  Vec3 block_mm = Vec3::Zero();                   ///< block with pits: length x, width y, height z
  int pit_count = 0;                              ///< in a row along x; depths grow evenly
  double pit_radius_mm = 0, pit_depth_max_mm = 0;
  /// Closed mesh; the world may leave file and size to whoever starts it.
  std::filesystem::path mesh;
  double size_mm = 0;    ///< its longest edge (of the bounding box)
  std::string up = "z";  ///< which axis of the file points up
  std::size_t min_triangles = 0;
  double crease_rad = 0;
  double reflectance = 0;  ///< of the mirror, each bounce
  double diffuse = 0;      ///< albedo of a Lambertian rest
};

/// What carries the object: an upright cylinder below z = 0 about the axis.
struct HolderTruth {
  double radius_mm = 0, length_mm = 0;
  double albedo = 0;  ///< in the ambient light; displays' light on it is not followed
};

enum class FaultKind : std::uint8_t { timeout, corrupt, stale, lost, lost_for_good, slow };

/// Scripted misbehaviour of one device.
struct FaultRule {
  std::string device;
  std::string on;  ///< counts the calls of this name only ("wait_frame"); empty: every call
  std::int64_t call = 1;
  FaultKind kind = FaultKind::timeout;
  bool once = true;  ///< the call alone; false: and every later one
  Micros delay{0};   ///< slow
};

struct RendererTruth {
  int samples_across = 4;        ///< sub-pixel samples of an uneven pixel: this squared
  int path_depth = 3;            ///< mirror bounces followed
  std::size_t memory_bytes = 0;  ///< what kept light transport may occupy
};

/// What the person starting a world may set without editing its file.
struct SceneOverrides {
  std::optional<std::filesystem::path> object_mesh;
  std::optional<double> object_size_mm;
  std::optional<std::string> object_up;
  std::optional<std::uint64_t> seed;
};

/// The whole truth about a simulated rig, as its world file tells it. Lengths in mm, rig frame.
struct Scene {
  std::uint64_t seed = 1;
  RendererTruth renderer;
  double ambient = 0;  ///< radiance from everywhere around; a white display has 1
  ObjectTruth object;
  HolderTruth holder;
  SensorTruth sensor;
  TableTruth table;
  std::vector<CameraTruth> cameras;
  std::vector<DisplayTruth> displays;
  std::vector<FaultRule> faults;

  /// Reads a world file. Its keys are described in config/worlds/README.md.
  /// Fails: unavailable (cannot be read), invalid (file, line, key and range of the first mistake).
  [[nodiscard]] static Result<Scene> load(const std::filesystem::path& file,
                                          const SceneOverrides& overrides = {});
};

inline constexpr double kSmallestSizeMm = 1, kLargestSizeMm = 1000;

}  // namespace alhazen::sim
