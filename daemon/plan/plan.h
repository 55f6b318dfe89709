#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/camera.h"
#include "alhazen/display.h"
#include "alhazen/result.h"
#include "alhazen/turntable.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/scan/manifest.h"

namespace alhazen {

/// Limits of a plan, the same for requests and presets.
inline constexpr int kMaxStops = 360;
inline constexpr int kMinLevel = 4, kMaxLevel = 11;
inline constexpr double kMinEdgeMm = 1, kMaxEdgeMm = 2000, kMaxCentreMm = 2000;

/// How to scan, as far as somebody said so: a preset or a request. What is left open comes from the
/// preset, then from the default noted here.
struct PlanChoices {
  std::optional<int> stops;  ///< 1 … 360, evenly over the full turn; default 12
  std::optional<std::vector<double>> angles_deg;  ///< instead of stops: 1 … 360 rising angles
  std::optional<std::vector<std::string>> displays, cameras;  ///< default: all of the rig
  std::optional<Coding> coding;                               ///< default gray
  std::optional<Micros> exposure;  ///< for all cameras; default: the camera's own of the config
  std::optional<double> gain_db;   ///< likewise
  std::optional<bool> crop;        ///< cameras read out only what sees the volume; default true
  /// Cube that is reconstructed, object frame: edge 1 … 2000 mm, default 102.4; centre within
  /// ±2000 mm, default: standing on the plate, centred on the axis.
  std::optional<double> edge_mm;
  std::optional<Eigen::Vector3d> centre_mm;
  std::optional<int> level;               ///< 4 … 11; default 8
  std::optional<KeepFrames> keep_frames;  ///< default none
};

/// A named plan of config/plans/NAME.toml.
struct Preset {
  std::string name, summary;
  PlanChoices choices;
};

/// What becomes of the queue when this scan fails.
enum class OnError : std::uint8_t { stop, next };
/// A stack that cannot be taken after all retakes: fail the scan, or go on and list it as a gap.
enum class OnGap : std::uint8_t { fail, accept };

/// What an operator asks for (verb scan.submit).
struct ScanRequest {
  std::string object_id;            ///< [A-Za-z0-9._-]{1,64}
  std::string note, operator_name;  ///< at most 4096 and 64 bytes
  std::string preset;               ///< empty: defaults and `choices` alone
  PlanChoices choices;              ///< win over the preset
  OnError on_error = OnError::stop;
  OnGap on_gap = OnGap::fail;
};

/// Facts of the opened devices, as a plan needs them; made by facts_of().
struct CameraFacts {
  std::string name;
  CameraInfo info;
  CameraSettings preferred;  ///< exposure and gain of the configuration
};
struct DisplayFacts {
  std::string name;
  DisplayInfo info;
};
struct DeviceFacts {
  std::vector<CameraFacts> cameras;
  std::vector<DisplayFacts> displays;
  std::optional<TurntableInfo> turntable;
};

/// What a plan is stamped with; the caller knows the time, the plan does not.
struct PlanStamp {
  std::string scan_id;     ///< [a-z0-9-]{1,64}
  std::string created_at;  ///< ISO 8601 UTC
  std::string software_version;
};

/// Run-up before a stop that cannot be reached by turning on: every stop is approached by turning
/// in the positive direction, so backlash falls on the same side. 5°: above the backlash of any
/// worm drive.
inline constexpr double kRunUpRad = 0.08726646259971647;

/// One capture: one pattern on one display at one stop, a frame of every camera. Indices into the
/// manifest's lists.
struct Step {
  std::uint64_t index = 0;  ///< place in the plan
  int stop = 0, display = 0, pattern = 0;
  bool first_of_display = false, last_of_display = false;
  friend bool operator==(const Step&, const Step&) = default;
};

/// Compiles a request. Pure: equal arguments give equal plans.
///
/// Cameras' regions of interest hold the projection of the volume's cube at every stop, widened to
/// multiples of kRegionAlignPx.
/// Fails: invalid, naming key and allowed range (a name that rig or devices do not have, a number
///        out of range, sizes of rig and device that differ, a volume a camera does not see).
[[nodiscard]] Result<Manifest> make_plan(const ScanRequest& request,
                                         const std::vector<Preset>& presets, const Rig& rig,
                                         const DeviceFacts& devices, const PlanStamp& stamp);

/// Regions start and end on multiples of this (what area-scan sensors commonly demand), or at the
/// sensor's edge.
inline constexpr int kRegionAlignPx = 16;

/// The steps of a plan in order: stop → display → pattern. While one display shows patterns all
/// others are black.
[[nodiscard]] std::vector<Step> make_steps(const Manifest& plan);

}  // namespace alhazen
