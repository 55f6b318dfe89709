#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "alhazen/driver.h"
#include "alhazen/result.h"
#include "alhazen/settings.h"
#include "daemon/devices/loader.h"

namespace alhazen {

/// [driver.NAME] of a configuration: one instance of a driver.
struct DriverSpec {
  std::string name, use;
  Settings settings;
  std::string place = {};  ///< for messages: "/etc/alhazen/rig.toml:18"

  /// "driver lab", as errors name it.
  [[nodiscard]] Error blame(Error error) const {
    error = std::move(error).in("driver " + name);
    return place.empty() ? error : std::move(error).in(place);
  }
};

/// [camera.NAME], [display.NAME] or [turntable.NAME]: a device and the driver instance that opens
/// it.
struct DeviceSpec {
  std::string name, driver;
  Settings settings;
  CameraSettings preferred;  ///< cameras: exposure and gain where a request leaves them open
  std::string place = {};    ///< for messages: "/etc/alhazen/rig.toml:35"
};

struct DeviceSpecs {
  std::vector<DriverSpec> drivers;
  std::vector<DeviceSpec> cameras, displays, turntables;
};

enum class DeviceKind : std::uint8_t { camera, display, turntable };
[[nodiscard]] constexpr std::string_view name_of(DeviceKind kind) noexcept {
  return kind == DeviceKind::camera    ? "camera"
         : kind == DeviceKind::display ? "display"
                                       : "turntable";
}

/// absent: could not be opened so far; lost: answered `unavailable` and was not reopened since.
enum class DeviceState : std::uint8_t { absent, ready, lost };
[[nodiscard]] constexpr std::string_view name_of(DeviceState state) noexcept {
  return state == DeviceState::absent ? "absent" : state == DeviceState::ready ? "ready" : "lost";
}

/// What is known about a device, without asking it.
struct DeviceDescription {
  DeviceKind kind = DeviceKind::camera;
  std::string name, driver, use;  ///< driver: the instance; use: which module
  DeviceState state = DeviceState::absent;
  std::string trouble;                                        ///< why it is not ready
  std::variant<CameraInfo, DisplayInfo, TurntableInfo> info;  ///< of the last time it was open
  CameraSettings camera_settings;  ///< cameras: in force, or preferred before the first configure
  Readings readings;               ///< as of the last refresh_readings()
  std::uint64_t calls = 0, failures = 0;
  std::uint32_t reopened = 0;
};

/// A device call that has not returned yet: whom to name when the rig lane hangs.
struct CallInProgress {
  std::string device, call;
  std::chrono::steady_clock::time_point since;
};

/// The opened devices by name, each behind a guard: argument ranges, the calling thread, how long a
/// call took, error context ("camera left / wait_frame"), log; configure() does nothing where
/// nothing would change.
///
/// Thread: device calls and reopen() belong to the thread of bind_to_this_thread() (the rig lane).
///         halt_all(), describe() and call_in_progress() are thread-safe.
class DeviceSet {
 public:
  /// Opens every driver and every device. A device that is not there is `absent`, not an error: the
  /// daemon lives and says so. The calling thread is the owner until another binds itself.
  /// Fails: invalid, unsupported (wrong configuration, a driver that does not fit), naming the
  ///        table; unavailable where a driver itself cannot start.
  [[nodiscard]] static Result<std::unique_ptr<DeviceSet>> open(const DeviceSpecs& specs,
                                                               Loader& loader, const Host& host);
  DeviceSet(const DeviceSet&) = delete;
  DeviceSet& operator=(const DeviceSet&) = delete;
  ~DeviceSet();

  /// The caller's thread owns the devices from now on. REQUIRES: no call in progress.
  void bind_to_this_thread() noexcept;

  /// A device by name, or null. The pointer stays valid, over reopen() too; an absent or lost
  /// device answers `unavailable`.
  [[nodiscard]] Camera* camera(std::string_view name) const;
  [[nodiscard]] Display* display(std::string_view name) const;
  [[nodiscard]] Turntable* turntable(std::string_view name) const;
  /// The rig's turntable: the only one. Null where none is configured.
  [[nodiscard]] Turntable* turntable() const;
  /// Names in the order of the configuration.
  [[nodiscard]] std::vector<std::string> names(DeviceKind kind) const;
  [[nodiscard]] CameraSettings preferred_settings(std::string_view camera) const;

  /// Closes and opens a device again. Fails: invalid (no such device), and as its driver does.
  Status reopen(std::string_view name);

  /// Stops every turntable. Thread-safe, never blocks on a device.
  void halt_all() noexcept;

  /// Asks every ready device for its readings, for describe(). Never blocks.
  void refresh_readings();
  /// From memory. Thread-safe.
  [[nodiscard]] std::vector<DeviceDescription> describe() const;
  /// Thread-safe.
  [[nodiscard]] std::optional<CallInProgress> call_in_progress() const;
  /// Every device is ready.
  [[nodiscard]] bool all_ready() const;

 private:
  struct State;
  explicit DeviceSet(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

}  // namespace alhazen
