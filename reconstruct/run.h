#pragma once

#include <functional>
#include <stop_token>
#include <string_view>

namespace alhazen {

/// What every stage is lent: whether to go on, and whom to tell how far it is. Stages run in the
/// caller's TBB arena. `progress` may be called from any thread of it.
struct Run {
  std::stop_token stop;
  /// (stage, share done 0 … 1); empty: nobody listens.
  std::function<void(std::string_view stage, double share)> progress;

  [[nodiscard]] bool stopped() const noexcept { return stop.stop_requested(); }
  void tell(std::string_view stage, double share) const {
    if (progress) progress(stage, share);
  }
};

}  // namespace alhazen
