#include "drivers/sim/sim_display.h"

#include <string>

#include "alhazen/caught.h"

namespace alhazen::sim {

SimDisplay::SimDisplay(std::unique_ptr<DeviceClaim> claim, std::size_t index)
    : claim_(std::move(claim)), index_(index) {
  const DisplayTruth& display = claim_->world().scene().displays[index];
  info_ = {"simulated display", display.id, display.width_px, display.height_px,
           display.refresh_hz};
}

Result<Time> SimDisplay::show(const Picture& picture, std::stop_token stop) noexcept {
  const auto fault = ALHAZEN_TRY(claim_->enter("show", stop));
  if (stop.stop_requested()) return Error{Code::cancelled, "stopped before showing a picture"};
  if (picture.image.empty() || picture.image.width() != info_.width_px ||
      picture.image.height() != info_.height_px)
    return Error{Code::invalid, "the picture is " + std::to_string(picture.image.width()) + " x " +
                                    std::to_string(picture.image.height()) + " px; display " +
                                    claim_->id() + " has " + std::to_string(info_.width_px) +
                                    " x " + std::to_string(info_.height_px) + " px"};
  if (fault == FaultKind::timeout)
    return Error{Code::timeout, "display " + claim_->id() + " did not confirm the picture"};
  const DisplayTruth& display = claim_->world().scene().displays[index_];
  // A stale panel claims to show what it was given, and goes on with the old picture.
  if (fault == FaultKind::stale) return claim_->clock().now() + display.latency + display.response;
  return caught(Code::internal, "display " + claim_->id(), [&] {
    ++shown_;
    return claim_->world().show(index_, picture, claim_->clock().now());
  });
}

Readings SimDisplay::readings() const noexcept {
  return {{"pictures", static_cast<double>(shown_), "1", false}};
}

}  // namespace alhazen::sim
