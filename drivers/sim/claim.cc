#include "drivers/sim/claim.h"

namespace alhazen::sim {

Result<std::unique_ptr<DeviceClaim>> DeviceClaim::make(std::shared_ptr<World> world,
                                                       const Host& host, std::string id) {
  switch (world->claim(id)) {
    case World::Claim::granted:
      return std::unique_ptr<DeviceClaim>(new DeviceClaim(std::move(world), host, std::move(id)));
    case World::Claim::taken:
      return Error{Code::unavailable, "device " + id + " is open already"};
    case World::Claim::gone:
      break;
  }
  return Error{Code::unavailable, "device " + id + " does not answer"};
}

DeviceClaim::~DeviceClaim() { world_->release(id_); }

Result<std::optional<FaultKind>> DeviceClaim::enter(const std::string& call, std::stop_token stop) {
  const Error gone{Code::unavailable, "device " + id_ + " does not answer; open it again"};
  if (lost_) return gone;
  const std::optional<FaultRule> fault = world_->fault(id_, call);
  if (!fault) return std::optional<FaultKind>();
  host_.log.write(Severity::debug, "scripted fault for " + id_ + " at " + call);
  switch (fault->kind) {
    case FaultKind::lost_for_good:
      world_->lose_for_good(id_);
      [[fallthrough]];
    case FaultKind::lost:
      lost_ = true;
      return gone;
    case FaultKind::slow:
      if (!host_.clock.sleep_until(host_.clock.now() + fault->delay, std::move(stop)))
        return Error{Code::cancelled, "stopped while waiting for " + id_};
      return std::optional<FaultKind>();
    case FaultKind::timeout:
    case FaultKind::corrupt:
    case FaultKind::stale:
      break;
  }
  return std::optional(fault->kind);
}

}  // namespace alhazen::sim
