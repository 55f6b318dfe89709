#include "daemon/virtual_clock.h"

namespace alhazen {

bool VirtualClock::sleep_until(Time when, std::stop_token stop) noexcept {
  if (stop.stop_requested()) return false;
  const Micros::rep wanted = when.time_since_epoch().count();
  Micros::rep now = now_us_.load(std::memory_order_acquire);
  while (now < wanted && !now_us_.compare_exchange_weak(now, wanted, std::memory_order_acq_rel)) {
  }
  return true;
}

}  // namespace alhazen
