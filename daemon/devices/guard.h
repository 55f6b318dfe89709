#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "alhazen/driver.h"
#include "daemon/devices/device_set.h"

namespace alhazen {

/// What the guards of one device set share. `mutex` is the DeviceSet's lock: it protects every
/// guard's device pointer against halt_all() and every description against describe().
struct GuardContext {
  explicit GuardContext(const Host& lent) : host(lent), owner(std::this_thread::get_id()) {}
  Host host;
  mutable std::mutex mutex;
  std::atomic<std::thread::id> owner;
  std::optional<CallInProgress> in_progress;
};

/// A proxy in front of a device of one kind: there is a device behind it or there is none, calls
/// come from the owner's thread, take no longer than allowed, and errors tell where they come from.
template <class Device>
class Guard : public Device {
 public:
  using Open = std::function<Result<std::unique_ptr<Device>>()>;

  Guard(GuardContext& context, DeviceDescription description, Open open)
      : context_(context),
        description_(std::move(description)),
        label_(std::string(name_of(description_.kind)) + " " + description_.name),
        open_(std::move(open)) {}

  [[nodiscard]] const std::string& name() const noexcept { return description_.name; }

  /// Closes and opens the device. Owner's thread.
  Status reopen();
  /// From memory. Thread-safe.
  [[nodiscard]] DeviceDescription describe() const {
    const std::scoped_lock lock(context_.mutex);
    return description_;
  }
  /// Owner's thread.
  void refresh_readings();

  [[nodiscard]] Readings readings() const noexcept override {
    return device_ ? device_->readings() : Readings{};
  }

 protected:
  /// Runs `body` with the device. Fails: internal (wrong thread), unavailable (no device), and as
  /// `body` does. `until`: the call should have returned by then, or the log says so.
  template <class Body>
  auto call(const char* what, Time until, Body body) noexcept -> decltype(body(*this));
  [[nodiscard]] Error refusal(const char* what, std::string sentence) const {
    return Error{Code::invalid, std::move(sentence)}.in(what).in(label_);
  }
  [[nodiscard]] bool is_owner() const noexcept {
    return std::this_thread::get_id() == context_.owner.load(std::memory_order_relaxed);
  }
  [[nodiscard]] Error stranger(const char* what) const {
    return Error{Code::internal, "called from a thread that does not own the devices"}.in(what).in(
        label_);
  }
  /// A new device answers what the old one no longer remembers.
  virtual void forget() noexcept {}

  GuardContext& context_;
  DeviceDescription description_;  // written under context_.mutex
  const std::string label_;
  std::unique_ptr<Device> device_;  // written under context_.mutex

 private:
  void begin(const char* what) {
    const std::scoped_lock lock(context_.mutex);
    ++description_.calls;
    context_.in_progress =
        CallInProgress{description_.name, what, std::chrono::steady_clock::now()};
  }
  /// Notes how the call ended; the error seen from outside, if there is one.
  std::optional<Error> end(const char* what, Time until, const Error* error);

  Open open_;
};

class GuardedCamera final : public Guard<Camera> {
 public:
  using Guard::Guard;
  [[nodiscard]] const CameraInfo& info() const noexcept override;
  Result<CameraSettings> configure(const CameraSettings& wanted) noexcept override;
  Result<Time> trigger() noexcept override;
  Result<Frame> wait_frame(Time deadline, std::stop_token stop) noexcept override;

 private:
  void forget() noexcept override { wanted_.reset(); }
  std::optional<CameraSettings> wanted_;  // what `set_` answers
  CameraSettings set_;
};

class GuardedDisplay final : public Guard<Display> {
 public:
  using Guard::Guard;
  [[nodiscard]] const DisplayInfo& info() const noexcept override;
  Result<Time> show(const Picture& picture, std::stop_token stop) noexcept override;
};

class GuardedTurntable final : public Guard<Turntable> {
 public:
  using Guard::Guard;
  [[nodiscard]] const TurntableInfo& info() const noexcept override;
  Status home(Time deadline, std::stop_token stop) noexcept override;
  Result<double> move_to(double angle_rad, Time deadline, std::stop_token stop) noexcept override;
  void halt() noexcept override;
};

}  // namespace alhazen
