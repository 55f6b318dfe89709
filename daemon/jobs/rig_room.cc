#include "daemon/jobs/rig_room.h"

#include <chrono>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "daemon/capture/freshness.h"
#include "reconstruct/scan/image_file.h"

namespace alhazen {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

class Checks {
 public:
  void add(std::string name, bool ok, std::string detail) {
    all_ok_ = all_ok_ && ok;
    rows_.push_back({{"name", std::move(name)}, {"ok", ok}, {"detail", std::move(detail)}});
  }
  [[nodiscard]] std::shared_ptr<const json> result() && {
    return std::make_shared<const json>(json{{"ok", all_ok_}, {"checks", std::move(rows_)}});
  }

 private:
  bool all_ok_ = true;
  json rows_ = json::array();
};

std::string panel_text(int width_px, int height_px) {
  return std::to_string(width_px) + " x " + std::to_string(height_px) + " px";
}

void check_readings(const DeviceDescription& device, Checks& checks) {
  for (const Reading& reading : device.readings)
    if (reading.warn)
      checks.add(device.name + " " + reading.name, false,
                 std::to_string(reading.value) + " " + reading.unit);
}

/// Settings that were asked for and those that the device says it set: devices round, so a
/// thousandth is equal.
bool is_near(const CameraSettings& wanted, const CameraSettings& set) {
  const auto exposure = static_cast<double>(wanted.exposure.count());
  return std::abs(static_cast<double>(set.exposure.count()) - exposure) <= 1 + exposure / 1000 &&
         std::abs(set.gain_db - wanted.gain_db) <= 0.1;
}

void check_camera(DeviceSet& devices, const Rig& rig, const DeviceDescription& about,
                  Checks& checks) {
  const auto& info = std::get<CameraInfo>(about.info);
  if (const CameraModel* model = rig.camera(about.name); model == nullptr)
    checks.add(about.name + " calibration", false, "the rig file does not have this camera");
  else
    checks.add(about.name + " calibration",
               model->width_px == info.width_px && model->height_px == info.height_px,
               "sensor " + panel_text(info.width_px, info.height_px) + ", calibrated " +
                   panel_text(model->width_px, model->height_px));
  CameraSettings wanted = devices.preferred_settings(about.name);
  wanted.region = {0, 0, info.width_px, info.height_px};
  const auto set = devices.camera(about.name)->configure(wanted);
  if (!set)
    checks.add(about.name + " settings", false, set.error().text());
  else
    checks.add(about.name + " settings", is_near(wanted, *set),
               "exposure " + std::to_string(set->exposure.count()) + " us, wanted " +
                   std::to_string(wanted.exposure.count()) + " us");
}

/// One frame of every camera that is ready, all at once, as a scan takes them: whether each says
/// when its exposure began (clock) and delivers in the time that its info promises (bandwidth).
Status check_frames(RigRoom& room, const std::vector<std::string>& cameras,
                    const std::stop_token& stop, Checks& checks) {
  DeviceSet& devices = room.devices();
  Clock& clock = room.clock();
  struct Taken {
    std::string camera;
    Time triggered{}, ends{};
  };
  std::vector<Taken> pending;
  for (const std::string& camera : cameras) {
    const Time triggered = clock.now();
    const auto ends = devices.camera(camera)->trigger();
    if (ends)
      pending.push_back({camera, triggered, *ends});
    else
      checks.add(camera + " trigger", false, ends.error().text());
  }
  bool cancelled = false;
  for (const Taken& taken : pending) {
    Camera& camera = *devices.camera(taken.camera);
    const Micros allowed = camera.info().readout_max + kReadoutAllowance;
    // All are collected, whatever happened to one: none may be left with a frame pending.
    const auto frame = camera.wait_frame(taken.ends + allowed, stop);
    if (!frame) {
      cancelled = cancelled || frame.error().code == Code::cancelled;
      checks.add(taken.camera + " bandwidth", false, frame.error().text());
      continue;
    }
    char text[80];
    std::snprintf(text, sizeof text, "%.2f MB within %.0f ms of their exposure",
                  static_cast<double>(frame->image.bytes().size()) / 1e6,
                  static_cast<double>(allowed.count()) / 1e3);
    checks.add(taken.camera + " bandwidth", true, text);
    const auto off = std::chrono::duration_cast<Micros>(frame->exposure_begin - taken.triggered);
    checks.add(taken.camera + " clock", off >= -kClockTolerance && off <= kReadoutAllowance,
               "its exposure began " + std::to_string(off.count()) + " us after the trigger");
  }
  if (cancelled) return Error{Code::cancelled, "stop requested"};
  return {};
}

void check_display(const Rig& rig, const DeviceDescription& about, Checks& checks) {
  const auto& info = std::get<DisplayInfo>(about.info);
  if (const DisplayModel* model = rig.display(about.name); model == nullptr)
    checks.add(about.name + " calibration", false, "the rig file does not have this display");
  else
    checks.add(about.name + " calibration",
               model->width_px == info.width_px && model->height_px == info.height_px,
               "panel " + panel_text(info.width_px, info.height_px) + ", calibrated " +
                   panel_text(model->width_px, model->height_px));
}

}  // namespace

Status RigRoom::open() {
  devices_ = ALHAZEN_TRY(DeviceSet::open(specs_, loader_, Host{clock_, log_}));
  devices_->bind_to_this_thread();
  return {};
}

void RigRoom::close() {
  if (devices_) devices_->halt_all();
  devices_.reset();
}

Result<std::shared_ptr<const json>> check_rig(RigRoom& room, const Rig& rig,
                                              const fs::path& rig_file,
                                              const fs::path& data_directory,
                                              const std::stop_token& stop) {
  DeviceSet& devices = room.devices();
  Checks checks;
  for (const DeviceDescription& before : devices.describe()) {
    if (stop.stop_requested()) return Error{Code::cancelled, "stop requested"};
    if (before.state == DeviceState::ready) {
      checks.add(before.name + " open", true, "ready");
      continue;
    }
    const Status opened = devices.reopen(before.name);
    checks.add(before.name + " open", static_cast<bool>(opened),
               opened ? "opened again" : opened.error().text());
  }
  devices.refresh_readings();
  std::vector<std::string> cameras;
  for (const DeviceDescription& about : devices.describe()) {
    if (stop.stop_requested()) return Error{Code::cancelled, "stop requested"};
    if (about.state != DeviceState::ready) continue;
    if (about.kind == DeviceKind::camera) {
      check_camera(devices, rig, about, checks);
      cameras.push_back(about.name);
    }
    if (about.kind == DeviceKind::display) check_display(rig, about, checks);
    check_readings(about, checks);
  }
  ALHAZEN_TRY(check_frames(room, cameras, stop, checks));

  std::error_code error;
  const fs::space_info space = fs::space(data_directory, error);
  // Below a gigabyte not even a small scan fits.
  constexpr std::uintmax_t kLeastBytes = 1'000'000'000;
  checks.add("disk", !error && space.available >= kLeastBytes,
             error ? error.message()
                   : std::to_string(space.available / 1'000'000) + " MB free in " +
                         data_directory.string());
  const auto written = fs::last_write_time(rig_file, error);
  if (error) {
    checks.add("calibration age", false, rig_file.string() + ": " + error.message());
  } else {
    const auto age =
        std::chrono::duration_cast<std::chrono::hours>(fs::file_time_type::clock::now() - written);
    checks.add("calibration age", true, std::to_string(age.count() / 24) + " days");
  }
  return std::move(checks).result();
}

Result<std::shared_ptr<const json>> take_pictures(RigRoom& room, const PreviewRequest& request,
                                                  const fs::path& folder,
                                                  const std::function<void(Noted)>& say,
                                                  const std::stop_token& stop) {
  const std::vector<PreviewFrame> frames =
      ALHAZEN_TRY(take_preview(room.devices(), room.clock(), request, stop));
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    return Error{Code::unavailable, "cannot make '" + folder.string() + "': " + error.message()};
  json files = json::object();
  for (const PreviewFrame& taken : frames) {
    const fs::path file = folder / (taken.camera + ".png");
    ALHAZEN_TRY(write_image(taken.frame.image, file));
    files[taken.camera] = file.string();
    say({"preview.camera",
         std::make_shared<const json>(json{{"camera", taken.camera},
                                           {"file", file.string()},
                                           {"exposure_us", taken.frame.settings.exposure.count()},
                                           {"gain_db", taken.frame.settings.gain_db}})});
  }
  return std::make_shared<const json>(json{{"files", std::move(files)}});
}

}  // namespace alhazen
