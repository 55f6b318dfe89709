// Whatever the bytes of VIEWS.csv and LIGHTS.csv: an error, or entries within range.
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "reconstruct/normals/normal_tables.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  if (const auto views = alhazen::parse_views(text)) {
    for (const alhazen::ViewEntry& view : *views) ALHAZEN_CHECK(!view.file.empty());
  }
  if (const auto lights = alhazen::parse_lights(text)) {
    for (const alhazen::LightEntry& entry : *lights) {
      ALHAZEN_CHECK(entry.light.vector.norm() > 0 && entry.light.intensity > 0);
    }
  }
  return 0;
}
