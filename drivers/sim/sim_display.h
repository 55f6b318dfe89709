#pragma once

#include <memory>
#include <utility>

#include "alhazen/display.h"
#include "drivers/sim/claim.h"

namespace alhazen::sim {

/// A display of the simulated world.
class SimDisplay final : public Display {
 public:
  /// `index` is the display's place in World::scene().
  SimDisplay(std::unique_ptr<DeviceClaim> claim, std::size_t index);

  [[nodiscard]] const DisplayInfo& info() const noexcept override { return info_; }
  Result<Time> show(const Picture& picture, std::stop_token stop) noexcept override;
  [[nodiscard]] Readings readings() const noexcept override;

 private:
  std::unique_ptr<DeviceClaim> claim_;
  std::size_t index_;
  DisplayInfo info_;
  std::uint64_t shown_ = 0;
};

}  // namespace alhazen::sim
