#pragma once

#include <memory>
#include <optional>
#include <utility>

#include "alhazen/camera.h"
#include "drivers/sim/claim.h"

namespace alhazen::sim {

/// A camera of the simulated world.
class SimCamera final : public Camera {
 public:
  /// `index` is the camera's place in World::scene().
  SimCamera(std::unique_ptr<DeviceClaim> claim, std::size_t index);
  ~SimCamera() override;

  [[nodiscard]] const CameraInfo& info() const noexcept override { return info_; }
  Result<CameraSettings> configure(const CameraSettings& wanted) noexcept override;
  Result<Time> trigger() noexcept override;
  Result<Frame> wait_frame(Time deadline, std::stop_token stop) noexcept override;
  [[nodiscard]] Readings readings() const noexcept override;

 private:
  Frame develop();
  void drop();

  std::unique_ptr<DeviceClaim> claim_;
  std::size_t index_;
  CameraInfo info_;
  CameraSettings settings_;
  std::optional<Time> begin_;  // of the exposure whose frame is pending
  std::optional<Frame> last_;  // what a stale answer repeats
  std::uint64_t frames_ = 0, dropped_ = 0;
};

}  // namespace alhazen::sim
