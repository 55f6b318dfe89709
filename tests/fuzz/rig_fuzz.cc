// Whatever the bytes of a rig.json: an error or a rig that survives its own round trip.
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "reconstruct/geometry/rig.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto rig = alhazen::Rig::parse({reinterpret_cast<const char*>(data), size});
  if (rig) ALHAZEN_CHECK(alhazen::Rig::parse(rig->to_json())->hash() == rig->hash());
  return 0;
}
