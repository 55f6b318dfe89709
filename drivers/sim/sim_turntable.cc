#include "drivers/sim/sim_turntable.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

namespace alhazen::sim {

SimTurntable::SimTurntable(std::unique_ptr<DeviceClaim> claim) : claim_(std::move(claim)) {
  const TableTruth& table = claim_->world().scene().table;
  info_ = {"simulated turntable",
           claim_->id(),
           table.min_rad,
           table.max_rad,
           table.position_error_rad + table.encoder_step_rad / 2,
           table.speed_rad_s,
           table.acceleration_rad_s2};
}

Status SimTurntable::home(Time deadline, std::stop_token stop) noexcept {
  const auto fault = ALHAZEN_TRY(claim_->enter("home", stop));
  homed_ = false;
  if (fault) {
    if (!claim_->clock().sleep_until(deadline, stop))
      return Error{Code::cancelled, "stopped while homing"};
    return Error{Code::timeout, "the turntable did not find its reference"};
  }
  // The reference is passed and then approached from below, as every angle of a scan is.
  constexpr double kRunUpRad = 2 * std::numbers::pi / 180;
  const double backlash = claim_->world().scene().table.backlash_rad;
  ALHAZEN_TRY(turn(-kRunUpRad - backlash, deadline, stop));
  ALHAZEN_TRY(turn(0, deadline, stop));
  homed_ = true;
  return {};
}

Result<double> SimTurntable::move_to(double angle_rad, Time deadline,
                                     std::stop_token stop) noexcept {
  const auto fault = ALHAZEN_TRY(claim_->enter("move_to", stop));
  const bool endless = info_.min_rad == info_.max_rad;
  constexpr double kMostRad = 1e6;
  const double low = endless ? -kMostRad : info_.min_rad, high = endless ? kMostRad : info_.max_rad;
  if (!(angle_rad >= low && angle_rad <= high))
    return Error{Code::invalid, "angle " + std::to_string(angle_rad) +
                                    " rad is not within the travel of " + std::to_string(low) +
                                    " … " + std::to_string(high) + " rad"};
  if (!homed_) return Error{Code::conflict, "the turntable has not been homed"};
  if (fault) {
    if (!claim_->clock().sleep_until(deadline, stop))
      return Error{Code::cancelled, "stopped while turning"};
    return Error{Code::timeout, "the turntable did not answer until the deadline"};
  }
  ALHAZEN_TRY(turn(angle_rad, deadline, stop));
  return claim_->world().encoder_rad(claim_->clock().now());
}

Status SimTurntable::turn(double angle_rad, Time deadline, std::stop_token stop) {
  Clock& clock = claim_->clock();
  halted_ = false;
  const Time rest = claim_->world().turn(angle_rad, clock.now());
  // Short naps, so that a halt from another thread is noticed.
  constexpr Micros kNap{20'000};
  while (clock.now() < std::min(rest, deadline)) {
    if (!clock.sleep_until(std::min({rest, deadline, clock.now() + kNap}), stop)) {
      claim_->world().halt(clock.now());
      return Error{Code::cancelled, "stopped while turning"};
    }
    if (halted_) return Error{Code::cancelled, "the turntable was halted"};
  }
  if (clock.now() < rest)
    return Error{Code::timeout, "the turntable was not at rest at the deadline, " +
                                    std::to_string((rest - deadline).count()) + " us early"};
  return {};
}

void SimTurntable::halt() noexcept {
  halted_ = true;
  claim_->world().halt(claim_->clock().now());
}

Readings SimTurntable::readings() const noexcept {
  constexpr double kDegFromRad = 180 / std::numbers::pi;
  return {
      {"angle", kDegFromRad * claim_->world().encoder_rad(claim_->clock().now()), "deg", false}};
}

}  // namespace alhazen::sim
