#include "reconstruct/scan/frame_log.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>

#include "alhazen/caught.h"
#include "reconstruct/scan/json_fields.h"
#include "reconstruct/scan/limits.h"

namespace alhazen {
namespace {

using nlohmann::json;

constexpr std::size_t kLongestPath = 1024;

bool is_checksum(std::string_view text) {
  return text.size() == 16 && std::ranges::all_of(text, [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

/// Inside the scan directory whatever the log says: no absolute path, no way up.
bool is_inside(std::string_view path) {
  return !path.empty() && path.front() != '/' && path.find("..") == std::string_view::npos &&
         path.find('\0') == std::string_view::npos;
}

}  // namespace

std::string to_line(const FrameRecord& record) {
  const Region& region = record.settings.region;
  const nlohmann::ordered_json line = {
      {"step", record.step},
      {"camera", record.camera},
      {"display", record.display},
      {"stop", record.stop},
      {"pattern", record.pattern},
      {"angle_rad", record.angle_rad},
      {"exposure_us", record.settings.exposure.count()},
      {"gain_db", record.settings.gain_db},
      {"region", {region.x, region.y, region.width, region.height}},
      {"exposure_begin_us", record.exposure_begin_us},
      {"device_counter", record.device_counter},
      {"attempt", record.attempt},
      {"checksum", record.checksum},
      {"file", record.file ? nlohmann::ordered_json(*record.file) : nlohmann::ordered_json()}};
  return line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

Result<FrameRecord> parse_frame_record(std::string_view line) {
  constexpr double kMax = std::numeric_limits<double>::max();
  constexpr int kMaxInt = std::numeric_limits<int>::max();
  constexpr std::int64_t kMaxTime = std::numeric_limits<std::int64_t>::max();
  const json document = ALHAZEN_TRY(
      caught(Code::corrupt, "frame record", [&] { return json::parse(line.begin(), line.end()); }));
  JsonFields fields = ALHAZEN_TRY(JsonFields::make(document, "", Code::corrupt));
  FrameRecord record;
  record.step = ALHAZEN_TRY(fields.counter("step"));
  record.camera = ALHAZEN_TRY(fields.text("camera", limits::kNameBytes));
  record.display = ALHAZEN_TRY(fields.text("display", limits::kNameBytes));
  record.stop = ALHAZEN_TRY(fields.small("stop", 0, kMaxInt));
  record.pattern = ALHAZEN_TRY(fields.small("pattern", 0, kMaxInt));
  record.angle_rad = ALHAZEN_TRY(fields.number("angle_rad", -kMax, kMax));
  record.settings.exposure =
      Micros(ALHAZEN_TRY(fields.integer("exposure_us", 0, limits::kExposure_us)));
  record.settings.gain_db = ALHAZEN_TRY(fields.number("gain_db", -kMax, kMax));
  const json& region = *ALHAZEN_TRY(fields.list("region", 4, 4));
  for (const json& side : region) {
    if (!side.is_number_unsigned() ||
        side.get<std::uint64_t>() > static_cast<std::uint64_t>(limits::kSide_px)) {
      return fields.complaint("region", "four whole numbers x, y, width, height in [0, 65535]");
    }
  }
  record.settings.region = {region[0].get<int>(), region[1].get<int>(), region[2].get<int>(),
                            region[3].get<int>()};
  record.exposure_begin_us = ALHAZEN_TRY(fields.integer("exposure_begin_us", -kMaxTime, kMaxTime));
  record.device_counter = ALHAZEN_TRY(fields.counter("device_counter"));
  record.attempt = ALHAZEN_TRY(fields.small("attempt", 1, kMaxInt));
  record.checksum = ALHAZEN_TRY(fields.text("checksum", limits::kNameBytes));
  if (!is_checksum(record.checksum)) {
    return fields.complaint("checksum", "16 lower-case hexadecimal digits");
  }
  if (!fields.is_null("file")) {
    record.file = ALHAZEN_TRY(fields.text("file", kLongestPath));
    if (!is_inside(*record.file)) {
      return fields.complaint("file", "null or a path inside the scan directory");
    }
  }
  ALHAZEN_TRY(fields.all_known());
  return record;
}

Result<FrameLog> parse_frame_log(std::string_view text) {
  FrameLog log;
  std::size_t begin = 0;
  for (std::size_t number = 1; begin < text.size(); ++number) {
    const std::size_t end = text.find('\n', begin);
    // Without its end a line was torn by a crash, even where it happens to be whole JSON.
    if (end == std::string_view::npos) break;
    Result<FrameRecord> record = parse_frame_record(text.substr(begin, end - begin));
    if (!record) {
      if (end + 1 == text.size()) break;
      return std::move(record.error()).in("line " + std::to_string(number));
    }
    log.records.push_back(*std::move(record));
    begin = end + 1;
    log.valid_bytes = begin;
  }
  return log;
}

}  // namespace alhazen
