// Whatever the bytes of a frames.jsonl: an error, or records that survive their own round trip in
// as many bytes as are said to be valid.
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "reconstruct/scan/frame_log.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto log = alhazen::parse_frame_log(text);
  if (!log) return 0;
  ALHAZEN_CHECK(log->valid_bytes <= size);
  ALHAZEN_CHECK(alhazen::parse_frame_log(text.substr(0, log->valid_bytes))->records.size() ==
                log->records.size());
  for (const alhazen::FrameRecord& record : log->records) {
    const std::string line = to_line(record);
    ALHAZEN_CHECK(to_line(*alhazen::parse_frame_record(line)) == line);
  }
  return 0;
}
