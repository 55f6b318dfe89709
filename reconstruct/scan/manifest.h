#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/clock.h"
#include "alhazen/image.h"
#include "alhazen/pattern.h"
#include "alhazen/result.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {

/// Which pictures stay on disk once their light map is safe: `failed` keeps those of steps that
/// were retaken, `sample` one step in sixteen.
enum class KeepFrames : std::uint8_t { none, failed, sample, all };

/// The cube that is reconstructed, object frame.
struct Volume {
  Eigen::Vector3d centre_mm{0, 0, 51.2};
  double edge_mm = 102.4;
};

/// One resting position of the turntable.
struct Stop {
  int index = 0;
  double wanted_rad = 0;
};

struct PlannedCamera {
  std::string name;
  CameraSettings settings;  ///< region as really used: never empty
};

struct PlannedDisplay {
  std::string name;
  int width_px = 0, height_px = 0;
  std::vector<Pattern> patterns;  ///< in the order shown
  double gamma = 2.2;             ///< light = value^gamma
};

/// What a scan directory is about: written once, before the first capture, never changed. It holds
/// the compiled plan, so that a resumed scan never computes it anew.
struct Manifest {
  int format = 1;
  std::string scan_id, created_at;  ///< id: [a-z0-9-]{1,64}; ISO 8601 UTC
  std::string object_id, note, operator_name;
  std::string software_version, rig_hash;
  Coding coding = Coding::gray;
  KeepFrames keep_frames = KeepFrames::none;
  Volume volume;
  int level = 8;  ///< finest octree level: leaf edge = volume.edge_mm / 2^level
  std::vector<Stop> stops;
  std::vector<PlannedDisplay> displays;
  std::vector<PlannedCamera> cameras;

  /// Fails: invalid, naming key and allowed range.
  [[nodiscard]] static Result<Manifest> parse(std::string_view text);
  [[nodiscard]] std::string to_json() const;
};

}  // namespace alhazen
