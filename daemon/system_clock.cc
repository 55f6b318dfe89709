#include "daemon/system_clock.h"

#include <condition_variable>
#include <mutex>
#include <utility>

namespace alhazen {

Time SystemClock::now() const noexcept {
  return std::chrono::time_point_cast<Micros>(std::chrono::steady_clock::now());
}

bool SystemClock::sleep_until(Time when, std::stop_token stop) noexcept {
  // Every sleeper has its own condition: nobody but its stop token wakes it.
  std::mutex mutex;
  std::condition_variable_any nothing;
  std::unique_lock lock(mutex);
  nothing.wait_until(lock, stop, std::chrono::time_point_cast<std::chrono::nanoseconds>(when),
                     [] { return false; });
  return !stop.stop_requested();
}

}  // namespace alhazen
