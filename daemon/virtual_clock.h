#pragma once

#include <atomic>
#include <cstdint>
#include <stop_token>

#include "alhazen/clock.h"

namespace alhazen {

/// Time that jumps: sleeping until t makes it max(now, t), at once. Only the rig lane and drivers
/// sleep on it; queues, polls and watchdogs keep to real time. Thread-safe.
class VirtualClock final : public Clock {
 public:
  /// Starts at one hour, so that instants before the start of a scan can be told.
  explicit VirtualClock(Time start = Time(std::chrono::hours(1))) noexcept
      : now_us_(start.time_since_epoch().count()) {}

  [[nodiscard]] Time now() const noexcept override {
    return Time(Micros(now_us_.load(std::memory_order_acquire)));
  }
  [[nodiscard]] bool sleep_until(Time when, std::stop_token stop) noexcept override;

 private:
  std::atomic<Micros::rep> now_us_;
};

}  // namespace alhazen
