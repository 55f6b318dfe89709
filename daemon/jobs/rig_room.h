#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "alhazen/clock.h"
#include "alhazen/driver.h"
#include "alhazen/result.h"
#include "daemon/capture/preview.h"
#include "daemon/devices/device_set.h"
#include "daemon/devices/loader.h"
#include "daemon/jobs/event_queue.h"
#include "reconstruct/geometry/rig.h"

namespace alhazen {

/// What the rig lane works with: the devices, and the clock they live by.
///
/// Thread: thread-bound (rig lane), but for what DeviceSet itself lets others do.
class RigRoom {
 public:
  RigRoom(DeviceSpecs specs, Loader loader, Clock& clock, Log& log)
      : specs_(std::move(specs)), loader_(std::move(loader)), clock_(clock), log_(log) {}

  /// Opens every device. Fails: as DeviceSet::open().
  Status open();
  /// Halts and closes every device.
  void close();

  /// REQUIRES: open() succeeded.
  [[nodiscard]] DeviceSet& devices() {
    ALHAZEN_CHECK(devices_ != nullptr);
    return *devices_;
  }
  [[nodiscard]] Clock& clock() noexcept { return clock_; }
  [[nodiscard]] Log& log() noexcept { return log_; }

 private:
  DeviceSpecs specs_;
  Loader loader_;
  Clock& clock_;
  Log& log_;
  std::unique_ptr<DeviceSet> devices_;
};

/// Work of the job `check`: opens what is missing, reads back settings, takes a frame of every
/// camera (bandwidth, clock), compares sizes with the calibrated rig, looks at disk and calibration
/// age.
/// Returns: {ok, checks: [{name, ok, detail}]}; a check that fails is no error.
/// Fails: cancelled. Caller: rig lane.
[[nodiscard]] Result<std::shared_ptr<const nlohmann::json>> check_rig(
    RigRoom& room, const Rig& rig, const std::filesystem::path& rig_file,
    const std::filesystem::path& data_directory, const std::stop_token& stop);

/// Work of the job `preview`: takes a picture of each camera and renames it into `folder` as
/// CAMERA.png; `say` hears of each.
/// Fails: as take_preview() and write_image(). Caller: rig lane.
[[nodiscard]] Result<std::shared_ptr<const nlohmann::json>> take_pictures(
    RigRoom& room, const PreviewRequest& request, const std::filesystem::path& folder,
    const std::function<void(Noted)>& say, const std::stop_token& stop);

}  // namespace alhazen
