#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/driver.h"
#include "alhazen/result.h"
#include "daemon/devices/device_set.h"
#include "daemon/plan/plan.h"

namespace alhazen {

enum class ClockKind : std::uint8_t { system, virtual_time };

/// Everything the daemon is told. Keys: config/README.md. Paths are absolute or start from the
/// folder of the configuration file.
struct Config {
  std::filesystem::path file;
  std::filesystem::path data_directory;          ///< scans/ and the index live here
  std::filesystem::path rig_file;                ///< calibrated rig.json
  std::filesystem::path plan_folder;             ///< presets
  std::filesystem::path driver_folder;           ///< empty: see main.cc
  std::filesystem::path preview_directory;       ///< where preview pictures are renamed into
  std::string control_endpoint, event_endpoint;  ///< ZeroMQ: ipc://… or tcp://…
  ClockKind clock = ClockKind::system;
  Severity log_level = Severity::info;
  DeviceSpecs devices;

  /// Reads text that stands in `file`. Touches no other file. Hostile input welcome.
  /// Fails: invalid, with file, line, key and allowed range.
  [[nodiscard]] static Result<Config> parse(std::string_view text,
                                            const std::filesystem::path& file);
  /// Fails: as parse(); unavailable where it cannot be read; invalid where a file or folder it
  /// names does not exist.
  [[nodiscard]] static Result<Config> load(const std::filesystem::path& file);
};

/// One plan preset. Fails: invalid, with file, line, key and allowed range.
[[nodiscard]] Result<Preset> parse_preset(std::string_view text, const std::filesystem::path& file);
/// All of a folder (*.toml), by name. Fails: as parse_preset(); unavailable.
[[nodiscard]] Result<std::vector<Preset>> load_presets(const std::filesystem::path& folder);

/// The virtual clock is refused unless every loaded driver keeps to Host::clock.
/// Fails: invalid, naming the driver.
[[nodiscard]] Status check_clock(const Config& config, Loader& loader);

}  // namespace alhazen
