// Whatever the bytes of a manifest.json: an error or a manifest that survives its own round trip.
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "reconstruct/scan/manifest.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto manifest = alhazen::Manifest::parse({reinterpret_cast<const char*>(data), size});
  if (manifest) {
    ALHAZEN_CHECK(alhazen::Manifest::parse(manifest->to_json())->to_json() == manifest->to_json());
  }
  return 0;
}
