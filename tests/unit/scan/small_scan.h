#pragma once

#include <cmath>
#include <limits>
#include <string>

#include "reconstruct/pattern/sequence.h"
#include "reconstruct/scan/frame_log.h"
#include "reconstruct/scan/light_map.h"
#include "reconstruct/scan/manifest.h"

namespace alhazen {

/// A scan of two stops, two displays of 8 × 4 px and two cameras of 4 × 3 px.
inline Manifest small_manifest() {
  Manifest manifest;
  manifest.scan_id = "bunny-1";
  manifest.created_at = "2026-01-02T03:04:05Z";
  manifest.object_id = "bunny";
  manifest.operator_name = "ibn";
  manifest.software_version = "0.1.0";
  manifest.rig_hash = "0123456789abcdef";
  manifest.stops = {{0, 0}, {1, 0.5}};
  for (const char* name : {"north", "below"}) {
    manifest.displays.push_back({name, 8, 4, *make_sequence(Coding::gray, 8, 4)});
  }
  for (const char* name : {"left", "right"}) {
    CameraSettings settings;
    settings.region = {5, 7, 4, 3};
    manifest.cameras.push_back({name, settings});
  }
  return manifest;
}

/// A light map as a decoder could have made it, with every label in it.
inline LightMap small_light_map(const StackKey& key) {
  constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
  LightMap map;
  map.key = key;
  map.angle_rad = 0.1 + 0.2;
  map.region = {5, 7, 4, 3};
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    map.label.push_back(static_cast<Label>(i % 6));
    const auto x = static_cast<float>(i);
    const bool is_position = map.is_position(i);
    map.u_px.push_back(is_position ? x / 3 : kNothing);
    map.v_px.push_back(is_position ? x / 7 : kNothing);
    map.sigma_u_px.emplace_back(is_position ? 0.25F + x : kNothing);
    map.sigma_v_px.emplace_back(is_position ? 0.5F + x : kNothing);
    map.contrast.push_back(static_cast<std::uint8_t>(20 * i));
    map.bit_u.push_back(static_cast<std::uint8_t>(i % 4));
    map.bit_v.push_back(static_cast<std::uint8_t>(i));
  }
  return map;
}

inline FrameRecord small_record(std::uint64_t step) {
  FrameRecord record;
  record.step = step;
  record.camera = "left";
  record.display = "north";
  record.stop = 1;
  record.pattern = 4;
  record.angle_rad = 0.1 + 0.2;
  record.settings.region = {5, 7, 4, 3};
  record.settings.gain_db = 1.5;
  record.exposure_begin_us = -12;
  record.device_counter = std::numeric_limits<std::uint64_t>::max();
  record.attempt = 2;
  record.checksum = "00ff00ff00ff00ff";
  return record;
}

}  // namespace alhazen
