// Whatever the bytes of a light map: an error, or no more pixels than the file has bytes for. The
// checksum is judged last, so that header, channels and values are all reached without a right one.
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "reconstruct/scan/light_map_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto map = alhazen::parse_light_map({reinterpret_cast<const char*>(data), size});
  if (map) {
    ALHAZEN_CHECK(map->u_px.size() == map->size_px());
    ALHAZEN_CHECK(map->size_px() * sizeof(float) <= size);
  }
  return 0;
}
