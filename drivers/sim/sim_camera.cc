#include "drivers/sim/sim_camera.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "alhazen/caught.h"

namespace alhazen::sim {

SimCamera::SimCamera(std::unique_ptr<DeviceClaim> claim, std::size_t index)
    : claim_(std::move(claim)), index_(index) {
  const CameraTruth& camera = claim_->world().scene().cameras[index];
  const SensorTruth& sensor = claim_->world().scene().sensor;
  info_ = {"simulated camera", camera.id,           camera.width_px,     camera.height_px,
           sensor.bits,        sensor.exposure_min, sensor.exposure_max, 0,
           sensor.gain_max_db, sensor.readout};
  settings_.exposure = std::clamp(settings_.exposure, info_.exposure_min, info_.exposure_max);
  settings_.region = {0, 0, camera.width_px, camera.height_px};
}

SimCamera::~SimCamera() { claim_->world().cancel_exposure(index_); }

void SimCamera::drop() {
  begin_.reset();
  ++dropped_;
  claim_->world().cancel_exposure(index_);
}

Result<CameraSettings> SimCamera::configure(const CameraSettings& wanted) noexcept {
  const auto fault = ALHAZEN_TRY(claim_->enter("configure"));
  if (fault)
    return Error{Code::timeout, "camera " + claim_->id() + " did not answer to its settings"};
  if (begin_)
    return Error{Code::conflict, "a frame is pending; wait for it before changing the settings"};
  if (wanted.exposure < info_.exposure_min || wanted.exposure > info_.exposure_max)
    return Error{Code::invalid, "exposure " + std::to_string(wanted.exposure.count()) +
                                    " us is not within " +
                                    std::to_string(info_.exposure_min.count()) + " … " +
                                    std::to_string(info_.exposure_max.count()) + " us"};
  if (!(wanted.gain_db >= info_.gain_min_db && wanted.gain_db <= info_.gain_max_db))
    return Error{Code::invalid, "gain " + std::to_string(wanted.gain_db) + " dB is not within " +
                                    std::to_string(info_.gain_min_db) + " … " +
                                    std::to_string(info_.gain_max_db) + " dB"};
  Region region = wanted.region;
  if (region.width == 0 && region.height == 0) region = {0, 0, info_.width_px, info_.height_px};
  if (region.x < 0 || region.y < 0 || region.width < 1 || region.height < 1 ||
      region.x > info_.width_px - region.width || region.y > info_.height_px - region.height)
    return Error{Code::invalid,
                 "region " + std::to_string(region.width) + " x " + std::to_string(region.height) +
                     " at (" + std::to_string(region.x) + ", " + std::to_string(region.y) +
                     ") is not within the sensor of " + std::to_string(info_.width_px) + " x " +
                     std::to_string(info_.height_px) + " px"};
  // The amplifier has steps of a tenth of a decibel.
  settings_ = {wanted.exposure, std::round(wanted.gain_db * 10) / 10, region};
  return settings_;
}

Result<Time> SimCamera::trigger() noexcept {
  const auto fault = ALHAZEN_TRY(claim_->enter("trigger"));
  if (fault)
    return Error{Code::timeout, "camera " + claim_->id() + " did not answer to the trigger"};
  if (begin_)
    return Error{Code::conflict, "a frame is pending; wait for it before the next trigger"};
  begin_ = claim_->clock().now();
  claim_->world().begin_exposure(index_, *begin_);
  return *begin_ + settings_.exposure;
}

Result<Frame> SimCamera::wait_frame(Time deadline, std::stop_token stop) noexcept {
  if (!begin_ && !claim_->is_lost()) return Error{Code::conflict, "nothing was triggered"};
  const Time asked = claim_->clock().now();
  const auto entered = claim_->enter("wait_frame", stop);
  if (!entered) {
    if (begin_) drop();
    return entered.error();
  }
  // A slow answer comes as much later as it took to begin it.
  const Micros late = claim_->clock().now() - asked;
  const Time arrival = *begin_ + settings_.exposure + info_.readout_max + late;
  const bool in_time = *entered != FaultKind::timeout && arrival <= deadline;
  if (!claim_->clock().sleep_until(in_time ? arrival : deadline, stop)) {
    drop();
    return Error{Code::cancelled, "stopped while waiting for a frame of camera " + claim_->id()};
  }
  if (!in_time) {
    drop();
    return Error{Code::timeout, "no frame of camera " + claim_->id() + " until the deadline"};
  }
  if (*entered == FaultKind::corrupt) {
    drop();
    return Error{Code::corrupt, "a frame of camera " + claim_->id() + " is incomplete"};
  }
  if (*entered == FaultKind::stale && last_) {
    drop();
    return *last_;
  }
  return caught(Code::internal, "camera " + claim_->id(), [&] { return develop(); });
}

Frame SimCamera::develop() {
  Frame frame;
  frame.settings = settings_;
  frame.exposure_begin = *begin_;
  frame.exposure_end = *begin_ + settings_.exposure;
  begin_.reset();
  frame.image = claim_->world().expose(
      {index_, frame.exposure_begin, settings_.exposure, settings_.gain_db, settings_.region});
  frame.device_counter = claim_->world().next_frame(index_);
  ++frames_;
  last_ = frame;
  return frame;
}

Readings SimCamera::readings() const noexcept {
  return {{"frames", static_cast<double>(frames_), "1", false},
          {"frames dropped", static_cast<double>(dropped_), "1", dropped_ > 0}};
}

}  // namespace alhazen::sim
