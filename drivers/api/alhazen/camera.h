#pragma once

#include <stop_token>
#include <string>

#include "alhazen/clock.h"
#include "alhazen/device.h"
#include "alhazen/image.h"
#include "alhazen/result.h"

namespace alhazen {

/// Constant facts of an opened camera.
struct CameraInfo {
  std::string model, serial;
  int width_px = 0, height_px = 0;  ///< whole sensor
  int bits = 8;
  Micros exposure_min{0}, exposure_max{0};
  double gain_min_db = 0, gain_max_db = 0;
  /// Longest time from the end of an exposure to the frame's arrival; the sequencer's deadline.
  Micros readout_max{0};
};

/// A camera. Open means armed for software trigger.
///
/// Thread: thread-bound to the rig lane. Every call is defined at all times: at the wrong moment it
/// fails with `conflict`. A lost camera answers `unavailable` until it is opened again.
class Camera {
 public:
  virtual ~Camera() = default;
  [[nodiscard]] virtual const CameraInfo& info() const noexcept = 0;

  /// Sets what the next frames are taken with.
  /// Returns: what was really set (devices round).
  /// Fails:   invalid (out of range; nothing changed), conflict (a frame is pending), unavailable
  virtual Result<CameraSettings> configure(const CameraSettings& wanted) noexcept = 0;

  /// Exposes one frame. Returns at once.
  /// Returns: the moment its exposure will have ended (the next picture may be shown from then).
  /// Fails:   conflict (a frame is pending), timeout, unavailable
  virtual Result<Time> trigger() noexcept = 0;

  /// Waits for the frame of the last trigger().
  /// Fails:   timeout      nothing arrived until `deadline`; the camera can be triggered again
  ///          corrupt      the frame is incomplete (lost packets); it has been dropped
  ///          unavailable  the camera is gone; reopen it
  ///          cancelled    `stop` was requested
  ///          conflict     nothing was triggered
  virtual Result<Frame> wait_frame(Time deadline, std::stop_token stop) noexcept = 0;

  /// Never blocks.
  [[nodiscard]] virtual Readings readings() const noexcept = 0;
};

}  // namespace alhazen
