// Whatever the bytes of a frames.csv: an error, or frames that all come back in some stack.
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "reconstruct/scan/frame_table.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto frames = alhazen::parse_frame_table({reinterpret_cast<const char*>(data), size});
  if (!frames) return 0;
  std::size_t count = 0;
  for (const alhazen::TableStack& stack : alhazen::stacks_of(*frames)) {
    count += stack.frames.size();
  }
  ALHAZEN_CHECK(count == frames->size());
  return 0;
}
