#pragma once

#include <stop_token>
#include <string>

#include "alhazen/clock.h"
#include "alhazen/device.h"
#include "alhazen/pattern.h"
#include "alhazen/result.h"

namespace alhazen {

/// Constant facts of an opened display.
struct DisplayInfo {
  std::string model, serial;
  int width_px = 0, height_px = 0;
  double refresh_hz = 0;
};

/// A screen used as a light source. Thread-bound to the rig lane.
class Display {
 public:
  virtual ~Display() = default;
  [[nodiscard]] virtual const DisplayInfo& info() const noexcept = 0;

  /// Puts a picture on the panel.
  /// Returns: the moment from which its light is steady. The driver knows its own latency and
  ///          response time; nobody else guesses a settling time.
  /// Fails:   invalid (picture size differs from info()), timeout, unavailable, cancelled
  virtual Result<Time> show(const Picture& picture, std::stop_token stop) noexcept = 0;

  /// Never blocks.
  [[nodiscard]] virtual Readings readings() const noexcept = 0;
};

}  // namespace alhazen
