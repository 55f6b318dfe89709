#pragma once

#include <memory>
#include <string>
#include <utility>

#include "alhazen/driver.h"
#include "drivers/sim/world.h"

namespace alhazen::sim {

/// One opened device's hold on the world: nobody else may open it meanwhile, and scripted faults
/// reach it through here. Thread-bound to the rig lane.
class DeviceClaim {
 public:
  /// Fails: unavailable (open already, or lost for good).
  [[nodiscard]] static Result<std::unique_ptr<DeviceClaim>> make(std::shared_ptr<World> world,
                                                                 const Host& host, std::string id);
  ~DeviceClaim();
  DeviceClaim(const DeviceClaim&) = delete;
  DeviceClaim& operator=(const DeviceClaim&) = delete;

  /// Counts a call and lets the faults act that strike before it: a lost device, and a slow answer.
  /// Returns: the fault that the call itself must act out (timeout, corrupt, stale), if any.
  /// Fails:   unavailable (lost), cancelled
  Result<std::optional<FaultKind>> enter(const std::string& call, std::stop_token stop = {});

  [[nodiscard]] World& world() const noexcept { return *world_; }
  [[nodiscard]] Clock& clock() const noexcept { return host_.clock; }
  [[nodiscard]] const std::string& id() const noexcept { return id_; }
  [[nodiscard]] bool is_lost() const noexcept { return lost_; }

 private:
  DeviceClaim(std::shared_ptr<World> world, const Host& host, std::string id)
      : world_(std::move(world)), host_(host), id_(std::move(id)) {}

  std::shared_ptr<World> world_;
  Host host_;
  std::string id_;
  bool lost_ = false;
};

}  // namespace alhazen::sim
