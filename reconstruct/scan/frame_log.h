#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/image.h"
#include "alhazen/result.h"

namespace alhazen {

/// Where one frame that went into a light map came from: a line of frames.jsonl.
struct FrameRecord {
  std::uint64_t step = 0;  ///< index into the plan
  std::string camera, display;
  int stop = 0, pattern = 0;  ///< pattern: index into the display's sequence
  double angle_rad = 0;       ///< measured
  CameraSettings settings;
  std::int64_t exposure_begin_us = 0;  ///< on the daemon's monotonic time line
  std::uint64_t device_counter = 0;
  int attempt = 1;       ///< 1: first try
  std::string checksum;  ///< XXH3-64 of the pixels, 16 hex digits
  std::optional<std::string>
      file;  ///< relative to the scan directory; nothing where it is not kept
};

/// The record as JSON, without the line's end.
[[nodiscard]] std::string to_line(const FrameRecord& record);
/// Fails: corrupt, naming the key.
[[nodiscard]] Result<FrameRecord> parse_frame_record(std::string_view line);

/// What a frames.jsonl proves: its whole lines, and how many bytes they are (a torn last line is
/// cut off there).
struct FrameLog {
  std::vector<FrameRecord> records;
  std::uint64_t valid_bytes = 0;
};
/// Fails: corrupt with the line's number where a line before the last is damaged.
[[nodiscard]] Result<FrameLog> parse_frame_log(std::string_view text);

}  // namespace alhazen
