#pragma once

#include <stop_token>

#include "alhazen/clock.h"

namespace alhazen {

/// The monotonic time of the machine. Thread-safe.
class SystemClock final : public Clock {
 public:
  [[nodiscard]] Time now() const noexcept override;
  [[nodiscard]] bool sleep_until(Time when, std::stop_token stop) noexcept override;
};

}  // namespace alhazen
