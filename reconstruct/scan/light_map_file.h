#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "alhazen/result.h"
#include "reconstruct/scan/light_map.h"

namespace alhazen {

/// "003_north_left.exr": stop, display, camera.
[[nodiscard]] std::string light_map_name(const StackKey& key);

/// OpenEXR, run-length coded (most of a map says nothing), data window = region of interest; FLOAT
/// u v, HALF sigma_u_px sigma_v_px contrast label bit_u bit_v; attributes stop, display, camera,
/// angle_rad, xxh3_64 (over the rest). Fails: invalid (a list's length is not the region's),
/// exhausted, unavailable.
[[nodiscard]] Status write_light_map(const LightMap& map, const std::filesystem::path& file);

/// Hostile input welcome. Fails: unavailable, corrupt (naming channel or attribute).
[[nodiscard]] Result<LightMap> read_light_map(const std::filesystem::path& file);
/// The same from memory. Fails: corrupt.
[[nodiscard]] Result<LightMap> parse_light_map(std::string_view bytes);

}  // namespace alhazen
