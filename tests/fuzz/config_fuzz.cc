// Configurations and plan presets come from people: any bytes must end in a value or a complaint.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "daemon/config.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(bytes), size);
  const auto config = alhazen::Config::parse(text, "/etc/alhazen/rig.toml");
  if (!config && config.error().what.find("/etc/alhazen/rig.toml") == std::string::npos)
    std::abort();  // a complaint must name the file
  if (config)
    for (const alhazen::DeviceSpec& camera : config->devices.cameras)
      if (camera.preferred.exposure < alhazen::Micros{1}) std::abort();
  const auto preset = alhazen::parse_preset(text, "/etc/alhazen/plans/any.toml");
  if (preset && preset->choices.stops && *preset->choices.stops < 1) std::abort();
  return 0;
}
