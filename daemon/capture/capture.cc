#include "daemon/capture/capture.h"

#include <algorithm>
#include <chrono>
#include <set>
#include <utility>

#include "daemon/capture/sequencer.h"
#include "daemon/capture/writer.h"

namespace alhazen {
namespace {

std::string size_text(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height) + " px";
}

/// Every device of the plan is configured and has the plan's size. One that is not open at the
/// moment is no obstacle: the sequencer opens it again.
Status check_devices(const Manifest& plan, const DeviceSet& devices) {
  if (devices.turntable() == nullptr)
    return Error{Code::invalid, "no turntable is configured: a scan needs one"};
  for (const PlannedCamera& camera : plan.cameras) {
    const Camera* device = devices.camera(camera.name);
    if (device == nullptr)
      return Error{Code::invalid,
                   "the plan needs camera " + camera.name + ", which is not configured"};
    const CameraInfo& info = device->info();
    const Region& region = camera.settings.region;
    if (info.width_px > 0 &&
        (region.x + region.width > info.width_px || region.y + region.height > info.height_px))
      return Error{Code::invalid, "the plan's region of camera " + camera.name +
                                      " ends outside its sensor of " +
                                      size_text(info.width_px, info.height_px)};
  }
  for (const PlannedDisplay& display : plan.displays) {
    const Display* device = devices.display(display.name);
    if (device == nullptr)
      return Error{Code::invalid,
                   "the plan needs display " + display.name + ", which is not configured"};
    const DisplayInfo& info = device->info();
    if (info.width_px > 0 &&
        (info.width_px != display.width_px || info.height_px != display.height_px))
      return Error{Code::invalid, "the plan wants " +
                                      size_text(display.width_px, display.height_px) +
                                      " of display " + display.name + ", it has " +
                                      size_text(info.width_px, info.height_px)};
  }
  return {};
}

}  // namespace

void Hold::hold(HoldAt at, std::string reason) {
  const std::scoped_lock lock(mutex_);
  at_ = at;
  reason_ = std::move(reason);
}

void Hold::release() {
  {
    const std::scoped_lock lock(mutex_);
    at_.reset();
    reason_.clear();
  }
  released_.notify_all();
}

std::string Hold::reason() const {
  const std::scoped_lock lock(mutex_);
  return reason_;
}

bool Hold::wanted(HoldAt boundary) const {
  const std::scoped_lock lock(mutex_);
  return at_ && (*at_ == HoldAt::step || boundary == HoldAt::stop);
}

bool Hold::wait(std::stop_token stop) {
  std::unique_lock lock(mutex_);
  return released_.wait(lock, std::move(stop), [this] { return !at_; });
}

DeviceFacts facts_of(const DeviceSet& devices) {
  DeviceFacts facts;
  for (const DeviceDescription& device : devices.describe()) {
    if (const auto* camera = std::get_if<CameraInfo>(&device.info); camera && camera->width_px > 0)
      facts.cameras.push_back({device.name, *camera, devices.preferred_settings(device.name)});
    if (const auto* display = std::get_if<DisplayInfo>(&device.info);
        display && display->width_px > 0)
      facts.displays.push_back({device.name, *display});
    // A table has no size to tell whether it was open; its state does, and a reopened one keeps it.
    if (const auto* table = std::get_if<TurntableInfo>(&device.info);
        table && device.state != DeviceState::absent)
      facts.turntable = *table;
  }
  return facts;
}

Result<Captured> capture_scan(Scan& scan, DeviceSet& devices, Clock& clock,
                              const CaptureOptions& options, Hold& hold, const CaptureHooks& hooks,
                              const std::stop_token& stop) {
  if (options.queue_sets < 1 || options.queue_sets > 64)
    return Error{Code::invalid, "queue_sets is " + std::to_string(options.queue_sets) +
                                    "; it must be within [1, 64]"};
  const Manifest& plan = scan.manifest();
  ALHAZEN_TRY(check_devices(plan, devices));
  const std::vector<StackKey> maps = ALHAZEN_TRY(scan.light_maps());
  const std::set<StackKey> committed(maps.begin(), maps.end());
  const Time begin = clock.now();

  // The rig lane stops for its caller or because the writer cannot go on.
  std::stop_source halt;
  const std::stop_callback on_stop(stop, [&halt] { halt.request_stop(); });
  Writer writer(scan, options, hold, hooks, stop, halt);
  Sequencer sequencer(
      plan, devices, clock, options.on_gap, hold, hooks,
      [&](WriterItem item) { return writer.push(std::move(item), halt.get_token()); },
      halt.get_token());
  const Status taken = sequencer.run(committed);
  sequencer.make_safe();
  const Status written = writer.finish();
  if (stop.stop_requested()) return Error{Code::cancelled, "stop requested"};
  if (!written) return written.error();
  if (!taken) return taken.error();

  Captured captured = sequencer.done();
  captured.light_maps = writer.committed();
  captured.skipped = committed.size();
  captured.seconds = std::chrono::duration<double>(clock.now() - begin).count();
  return captured;
}

}  // namespace alhazen
