#pragma once

#include <atomic>
#include <memory>
#include <utility>

#include "alhazen/turntable.h"
#include "drivers/sim/claim.h"

namespace alhazen::sim {

/// The turntable of the simulated world. After a timeout it goes on turning to where it was sent,
/// as a real one does whose answer was lost; after a stop request it is halted.
class SimTurntable final : public Turntable {
 public:
  explicit SimTurntable(std::unique_ptr<DeviceClaim> claim);

  [[nodiscard]] const TurntableInfo& info() const noexcept override { return info_; }
  Status home(Time deadline, std::stop_token stop) noexcept override;
  Result<double> move_to(double angle_rad, Time deadline, std::stop_token stop) noexcept override;
  void halt() noexcept override;
  [[nodiscard]] Readings readings() const noexcept override;

 private:
  Status turn(double angle_rad, Time deadline, std::stop_token stop);

  std::unique_ptr<DeviceClaim> claim_;
  TurntableInfo info_;
  bool homed_ = false;
  std::atomic<bool> halted_ = false;
};

}  // namespace alhazen::sim
