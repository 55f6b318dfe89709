#include "daemon/capture/preview.h"

#include <algorithm>
#include <utility>

#include "daemon/capture/freshness.h"
#include "reconstruct/pattern/draw.h"

namespace alhazen {
namespace {

Result<Time> show(DeviceSet& devices, const std::string& name, const Pattern& pattern,
                  const std::stop_token& stop) {
  Display* display = devices.display(name);
  if (display == nullptr) return Error{Code::invalid, "there is no display '" + name + "'"};
  const DisplayInfo& info = display->info();
  if (info.width_px < 1) return Error{Code::unavailable, "display " + name + " is not open"};
  return display->show(ALHAZEN_TRY(draw(pattern, info.width_px, info.height_px)), stop);
}

/// Makes every display black that can be; the last error.
Result<Time> all_black(DeviceSet& devices, const std::stop_token& stop) {
  Time steady{};
  for (const std::string& name : devices.names(DeviceKind::display)) {
    if (devices.display(name)->info().width_px < 1) continue;  // never was open
    steady = std::max(steady, ALHAZEN_TRY(show(devices, name, Pattern{}, stop)));
  }
  return steady;
}

Result<std::vector<PreviewFrame>> expose(DeviceSet& devices, Clock& clock,
                                         const std::vector<std::string>& names,
                                         const PreviewRequest& request,
                                         const std::stop_token& stop) {
  Time ended = clock.now();
  Micros readout{0};
  std::vector<std::string> triggered;
  std::optional<Error> trouble;
  for (const std::string& name : names) {
    Camera& camera = *devices.camera(name);
    CameraSettings settings = devices.preferred_settings(name);
    settings.exposure = request.exposure.value_or(settings.exposure);
    settings.gain_db = request.gain_db.value_or(settings.gain_db);
    settings.region = {};
    const auto set = camera.configure(settings);
    const auto end = set ? camera.trigger() : Result<Time>(set.error());
    if (!end) {
      trouble = end.error();
      break;
    }
    triggered.push_back(name);
    ended = std::max(ended, *end);
    readout = std::max(readout, camera.info().readout_max);
  }
  // Whatever was triggered is collected, so that no camera is left with a frame pending.
  std::vector<PreviewFrame> frames;
  for (const std::string& name : triggered) {
    auto frame = devices.camera(name)->wait_frame(ended + readout + kReadoutAllowance, stop);
    if (frame)
      frames.push_back({name, std::move(*frame)});
    else
      trouble = frame.error();
  }
  if (trouble) return *std::move(trouble);
  return frames;
}

}  // namespace

Result<std::vector<PreviewFrame>> take_preview(DeviceSet& devices, Clock& clock,
                                               const PreviewRequest& request,
                                               const std::stop_token& stop) {
  const std::vector<std::string> names =
      request.cameras.empty() ? devices.names(DeviceKind::camera) : request.cameras;
  for (const std::string& name : names)
    if (devices.camera(name) == nullptr)
      return Error{Code::invalid, "there is no camera '" + name + "'"};
  Time steady = ALHAZEN_TRY(all_black(devices, stop));
  if (request.display)
    steady = std::max(steady, ALHAZEN_TRY(show(devices, *request.display, request.pattern, stop)));
  auto frames = clock.sleep_until(steady, stop)
                    ? expose(devices, clock, names, request, stop)
                    : Result<std::vector<PreviewFrame>>(Error{Code::cancelled, "stop requested"});
  const auto dark = all_black(devices, {});
  if (frames && !dark) return dark.error();
  return frames;
}

}  // namespace alhazen
