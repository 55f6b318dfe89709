#include "daemon/plan/estimate.h"

#include <algorithm>
#include <cmath>

namespace alhazen {
namespace {

/// Where a display does not tell its refresh rate.
constexpr double kUsualRefreshHz = 60.0;
/// Refresh periods from show() to steady light: one to reach the panel, one to settle.
constexpr double kRefreshesToSteady = 2.0;
/// A light map's file: five FLOAT and three UINT channels, uncompressed.
constexpr std::uint64_t kLightMapBytesPerPx = 8 * 4;
/// A running decoder: white, black, one frame of a pair at two bytes, both codes, margins, masks.
constexpr std::uint64_t kDecoderBytesPerPx = 24;
/// A light map in memory: five floats, a label and two bits.
constexpr std::uint64_t kMapBytesPerPx = 23;
/// Sets of frames alive at once: three queued, one with the writer, one with the sequencer.
constexpr std::uint64_t kLiveSets = 5;
/// KeepFrames::sample keeps one step in so many.
constexpr std::uint64_t kSampleStride = 16;

double seconds_of(Micros time) { return std::chrono::duration<double>(time).count(); }

/// Time of a turn from rest to rest with a trapezoidal speed profile.
double turn_s(double angle_rad, const TurntableInfo& table) {
  if (table.speed_rad_s <= 0) return 0;
  if (table.acceleration_rad_s2 <= 0) return angle_rad / table.speed_rad_s;
  const double ramp_rad = table.speed_rad_s * table.speed_rad_s / table.acceleration_rad_s2;
  if (angle_rad < ramp_rad) return 2 * std::sqrt(angle_rad / table.acceleration_rad_s2);
  return angle_rad / table.speed_rad_s + table.speed_rad_s / table.acceleration_rad_s2;
}

template <class Facts>
const Facts* find_facts(const std::vector<Facts>& all, const std::string& name) {
  const auto found =
      std::find_if(all.begin(), all.end(), [&](const Facts& f) { return f.name == name; });
  return found == all.end() ? nullptr : &*found;
}

}  // namespace

Estimate estimate(const Manifest& plan, const DeviceFacts& devices) {
  Estimate total;
  double exposure_s = 0, readout_s = 0;
  std::uint64_t set_bytes = 0, set_px = 0;
  std::vector<std::uint64_t> frame_bytes;
  for (const PlannedCamera& camera : plan.cameras) {
    const CameraFacts* facts = find_facts(devices.cameras, camera.name);
    exposure_s = std::max(exposure_s, seconds_of(camera.settings.exposure));
    const std::uint64_t px = static_cast<std::uint64_t>(camera.settings.region.width) *
                             static_cast<std::uint64_t>(camera.settings.region.height);
    frame_bytes.push_back(px * (facts != nullptr && facts->info.bits > 8 ? 2 : 1));
    if (facts != nullptr) readout_s = std::max(readout_s, seconds_of(facts->info.readout_max));
    set_bytes += frame_bytes.back();
    set_px += px;
  }

  const auto stops = static_cast<std::uint64_t>(plan.stops.size());
  double stop_s = 0, longest_step_hz = 0;
  for (const PlannedDisplay& display : plan.displays) {
    const DisplayFacts* facts = find_facts(devices.displays, display.name);
    const double refresh_hz =
        facts != nullptr && facts->info.refresh_hz > 0 ? facts->info.refresh_hz : kUsualRefreshHz;
    const double steady_s = kRefreshesToSteady / refresh_hz;
    // Pipelined: the next picture settles while the frames of the last are in transfer.
    const double step_s = exposure_s + std::max(steady_s, readout_s);
    stop_s += step_s * static_cast<double>(display.patterns.size()) + steady_s;
    longest_step_hz = std::max(longest_step_hz, 1 / step_s);
    total.steps += stops * display.patterns.size();
    if (exposure_s < 1 / refresh_hz)
      total.notes.push_back("exposure of " + std::to_string(std::lround(exposure_s * 1e6)) +
                            " us is shorter than a refresh of display " + display.name + " (" +
                            std::to_string(std::lround(1e6 / refresh_hz)) +
                            " us): brightness may differ from frame to frame");
  }
  total.seconds = stop_s * static_cast<double>(stops);
  if (devices.turntable) {
    double at_rad = plan.stops.empty() ? 0 : plan.stops.front().wanted_rad - kRunUpRad;
    for (const Stop& stop : plan.stops) {
      total.seconds += turn_s(stop.wanted_rad - at_rad, *devices.turntable);
      at_rad = stop.wanted_rad;
    }
  }

  total.frames = total.steps * plan.cameras.size();
  total.stacks = stops * plan.displays.size() * plan.cameras.size();
  total.bytes_disk = stops * plan.displays.size() * set_px * kLightMapBytesPerPx;
  const std::uint64_t kept_steps = plan.keep_frames == KeepFrames::all ? total.steps
                                   : plan.keep_frames == KeepFrames::sample
                                       ? (total.steps + kSampleStride - 1) / kSampleStride
                                       : 0;
  total.bytes_disk += kept_steps * set_bytes;
  total.bytes_memory = set_px * (kDecoderBytesPerPx + kMapBytesPerPx) + kLiveSets * set_bytes;
  for (std::size_t i = 0; i < plan.cameras.size(); ++i)
    total.links.push_back(
        {plan.cameras[i].name, static_cast<double>(frame_bytes[i]) * longest_step_hz / 1e6});
  return total;
}

}  // namespace alhazen
