#pragma once

#include <cstdint>
#include <string>

#include "drivers/sim/scene.h"

namespace alhazen::sim {

/// How far a calibrated rig lies from the true one: standard deviations, drawn with `seed`.
struct CalibrationError {
  double camera_px = 0;    ///< of where a camera sees things: its rotation about its three axes
  double display_mm = 0;   ///< each coordinate of a display's middle
  double display_rad = 0;  ///< its rotation about its three axes
  double axis_mm = 0;      ///< where the turntable's axis stands, across it
  std::uint64_t seed = 1;
};

/// The rig as a calibration would have found it: a rig.json (its format is described in
/// reconstruct/README.md). With a zero error it is exact.
[[nodiscard]] std::string calibrated_rig(const Scene& scene, const CalibrationError& error);

}  // namespace alhazen::sim
