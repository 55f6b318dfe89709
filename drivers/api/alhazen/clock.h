#pragma once

#include <chrono>
#include <stop_token>

namespace alhazen {

/// Duration in microseconds: exposures, latencies, deadlines.
using Micros = std::chrono::microseconds;

/// An instant on the host's monotonic time line (or on the virtual one of a simulated rig).
using Time = std::chrono::time_point<std::chrono::steady_clock, Micros>;

/// Where time comes from. Thread-safe.
///
/// The daemon lends either the system's steady clock or a virtual one that jumps, so that a scan of
/// hours runs as fast as it can be rendered. Nothing that moves a device may ask any other clock.
class Clock {
 public:
  virtual ~Clock() = default;
  [[nodiscard]] virtual Time now() const noexcept = 0;
  /// True once `when` has been reached; false as soon as `stop` is requested.
  [[nodiscard]] virtual bool sleep_until(Time when, std::stop_token stop) noexcept = 0;
};

}  // namespace alhazen
