#pragma once

#include <stop_token>
#include <string>

#include "alhazen/clock.h"
#include "alhazen/device.h"
#include "alhazen/result.h"

namespace alhazen {

/// Constant facts of an opened turntable.
struct TurntableInfo {
  std::string model, serial;
  double min_rad = 0, max_rad = 0;  ///< travel; equal: endless
  double repeatability_rad = 0;
  double speed_rad_s = 0, acceleration_rad_s2 = 0;  ///< for the estimate of a plan
};

/// Turns the object. Positive angles turn right-handed about the axis. Thread-bound to the rig lane
/// but for halt().
class Turntable {
 public:
  virtual ~Turntable() = default;
  [[nodiscard]] virtual const TurntableInfo& info() const noexcept = 0;

  /// Finds the reference position. Fails: timeout, unavailable, cancelled (the table is halted).
  virtual Status home(Time deadline, std::stop_token stop) noexcept = 0;

  /// Turns to `angle_rad` and waits until the table is at rest.
  /// Returns: the measured angle, rad.
  /// Fails:   invalid (out of travel), conflict (not homed), timeout, unavailable, cancelled
  virtual Result<double> move_to(double angle_rad, Time deadline,
                                 std::stop_token stop) noexcept = 0;

  /// Stops at once. Thread-safe, any time, never blocks.
  virtual void halt() noexcept = 0;

  /// Never blocks.
  [[nodiscard]] virtual Readings readings() const noexcept = 0;
};

}  // namespace alhazen
