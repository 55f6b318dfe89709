#include "reconstruct/scan/manifest.h"

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <set>

#include "alhazen/caught.h"
#include "reconstruct/pattern/draw.h"
#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/scan/json_fields.h"
#include "reconstruct/scan/limits.h"

namespace alhazen {
namespace {

using nlohmann::json;
using Ordered = nlohmann::ordered_json;

// Bounds of what a manifest may say. They are far beyond any rig and keep hostile files small.
constexpr std::size_t kLongestText = 4096;
constexpr std::size_t kMostStops = 100'000, kMostDisplays = 64, kMostCameras = 256;
constexpr std::size_t kMostPatterns = 1024, kMostStacks = 1'000'000;
constexpr double kMaxAngle_rad = 1e4, kMaxLength_mm = 1e6;
constexpr double kMaxGain_db = 200;

constexpr std::array<const char*, 2> kCodings = {"gray", "gray_phase"};
constexpr std::array<const char*, 4> kKeepFrames = {"none", "failed", "sample", "all"};
constexpr std::array<const char*, 4> kKinds = {"white", "black", "gray", "phase"};
constexpr std::array<const char*, 2> kAxes = {"u", "v"};

template <class Enum, std::size_t kCount>
Result<Enum> one_of(JsonFields& fields, const char* key,
                    const std::array<const char*, kCount>& words) {
  const std::string word = ALHAZEN_TRY(fields.text(key, kLongestText));
  std::string all;
  for (std::size_t i = 0; i < kCount; ++i) {
    if (word == words[i]) return static_cast<Enum>(i);
    all += (i == 0 ? "" : ", ") + std::string(words[i]);
  }
  return fields.complaint(key, "one of " + all);
}

template <class Enum, std::size_t kCount>
const char* word_of(Enum value, const std::array<const char*, kCount>& words) {
  return words[static_cast<std::size_t>(value)];
}

bool is_device_name(std::string_view name) {
  return !name.empty() && name.size() <= limits::kNameBytes && name.front() != '.' &&
         std::ranges::all_of(name, [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '-' || c == '_' || c == '.';
         });
}

Result<std::string> device_name(JsonFields& fields) {
  std::string name = ALHAZEN_TRY(fields.text("name", kLongestText));
  if (!is_device_name(name)) {
    return fields.complaint("name", "1 to 64 of a-z A-Z 0-9 - _ . and not begin with a dot");
  }
  return name;
}

Result<Pattern> parse_pattern(JsonFields fields, const PlannedDisplay& display) {
  Pattern pattern;
  pattern.kind = ALHAZEN_TRY(one_of<PatternKind>(fields, "kind", kKinds));
  if (pattern.kind == PatternKind::gray || pattern.kind == PatternKind::phase) {
    pattern.axis = ALHAZEN_TRY(one_of<Axis>(fields, "axis", kAxes));
  }
  const int side_px = pattern.axis == Axis::u ? display.width_px : display.height_px;
  if (pattern.kind == PatternKind::gray) {
    pattern.bit = ALHAZEN_TRY(fields.small("bit", 0, gray_bits(side_px) - 1));
    pattern.inverted = ALHAZEN_TRY(fields.flag("inverted"));
  } else if (pattern.kind == PatternKind::phase) {
    pattern.period_px = ALHAZEN_TRY(fields.small("period_px", 2, kMaxDisplaySide_px));
    pattern.steps = ALHAZEN_TRY(fields.small("steps", 3, 64));
    pattern.step = ALHAZEN_TRY(fields.small("step", 0, pattern.steps - 1));
  }
  ALHAZEN_TRY(fields.all_known());
  return pattern;
}

Ordered json_of(const Pattern& pattern) {
  Ordered out = {{"kind", word_of(pattern.kind, kKinds)}};
  if (pattern.kind == PatternKind::gray || pattern.kind == PatternKind::phase) {
    out["axis"] = word_of(pattern.axis, kAxes);
  }
  if (pattern.kind == PatternKind::gray) {
    out["bit"] = pattern.bit;
    out["inverted"] = pattern.inverted;
  } else if (pattern.kind == PatternKind::phase) {
    out["period_px"] = pattern.period_px;
    out["steps"] = pattern.steps;
    out["step"] = pattern.step;
  }
  return out;
}

Result<PlannedDisplay> parse_display(JsonFields fields) {
  PlannedDisplay display;
  display.name = ALHAZEN_TRY(device_name(fields));
  display.width_px = ALHAZEN_TRY(fields.small("width_px", kMinDisplaySide_px, kMaxDisplaySide_px));
  display.height_px =
      ALHAZEN_TRY(fields.small("height_px", kMinDisplaySide_px, kMaxDisplaySide_px));
  display.gamma = ALHAZEN_TRY(fields.number("gamma", kMinGamma, kMaxGamma));
  const json& patterns = *ALHAZEN_TRY(fields.list("patterns", 1, kMostPatterns));
  for (std::size_t i = 0; i < patterns.size(); ++i) {
    display.patterns.push_back(
        ALHAZEN_TRY(parse_pattern(ALHAZEN_TRY(fields.entry("patterns", patterns, i)), display)));
  }
  ALHAZEN_TRY(fields.all_known());
  return display;
}

Result<PlannedCamera> parse_camera(JsonFields fields) {
  PlannedCamera camera;
  camera.name = ALHAZEN_TRY(device_name(fields));
  camera.settings.exposure =
      Micros(ALHAZEN_TRY(fields.integer("exposure_us", 1, limits::kExposure_us)));
  camera.settings.gain_db = ALHAZEN_TRY(fields.number("gain_db", -kMaxGain_db, kMaxGain_db));
  JsonFields region = ALHAZEN_TRY(fields.object("region"));
  camera.settings.region.x = ALHAZEN_TRY(region.small("x", 0, limits::kSide_px));
  camera.settings.region.y = ALHAZEN_TRY(region.small("y", 0, limits::kSide_px));
  camera.settings.region.width = ALHAZEN_TRY(region.small("width", 1, limits::kSide_px));
  camera.settings.region.height = ALHAZEN_TRY(region.small("height", 1, limits::kSide_px));
  ALHAZEN_TRY(region.all_known());
  ALHAZEN_TRY(fields.all_known());
  return camera;
}

Result<Stop> parse_stop(JsonFields fields, std::size_t position) {
  Stop stop;
  // Indices are positions, so that a stop can be found without a search and none is there twice.
  const int index = static_cast<int>(position);
  stop.index = ALHAZEN_TRY(fields.small("index", index, index));
  stop.wanted_rad = ALHAZEN_TRY(fields.number("wanted_rad", -kMaxAngle_rad, kMaxAngle_rad));
  ALHAZEN_TRY(fields.all_known());
  return stop;
}

Result<Volume> parse_volume(JsonFields fields) {
  Volume volume;
  const json& centre = *ALHAZEN_TRY(fields.list("centre_mm", 3, 3));
  for (int i = 0; i < 3; ++i) {
    const json& x = centre[static_cast<std::size_t>(i)];
    if (!x.is_number() || !(std::abs(x.get<double>()) <= kMaxLength_mm)) {
      return fields.complaint("centre_mm", "three numbers in [-1e6, 1e6]");
    }
    volume.centre_mm[i] = x.get<double>();
  }
  volume.edge_mm = ALHAZEN_TRY(fields.number("edge_mm", 1e-3, kMaxLength_mm));
  ALHAZEN_TRY(fields.all_known());
  return volume;
}

/// File names are made of display and camera name joined by '_': two pairs must not meet in one.
Status names_are_distinct(const Manifest& manifest) {
  std::set<std::string> displays, cameras, files;
  for (const PlannedDisplay& display : manifest.displays) {
    if (!displays.insert(display.name).second) {
      return Error{Code::invalid, "key 'displays' names '" + display.name + "' twice"};
    }
  }
  for (const PlannedCamera& camera : manifest.cameras) {
    if (!cameras.insert(camera.name).second) {
      return Error{Code::invalid, "key 'cameras' names '" + camera.name + "' twice"};
    }
    for (const PlannedDisplay& display : manifest.displays) {
      if (!files.insert(display.name + "_" + camera.name).second) {
        return Error{Code::invalid, "keys 'displays' and 'cameras' hold names that join to '" +
                                        display.name + "_" + camera.name + "' twice"};
      }
    }
  }
  return {};
}

bool is_scan_id(std::string_view id) {
  return !id.empty() && id.size() <= limits::kNameBytes && std::ranges::all_of(id, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  });
}

}  // namespace

Result<Manifest> Manifest::parse(std::string_view text) {
  const json document = ALHAZEN_TRY(
      caught(Code::invalid, "manifest", [&] { return json::parse(text.begin(), text.end()); }));
  JsonFields fields = ALHAZEN_TRY(JsonFields::make(document, "", Code::invalid));
  Manifest manifest;
  manifest.format = ALHAZEN_TRY(fields.small("format", 1, 1));
  manifest.scan_id = ALHAZEN_TRY(fields.text("scan_id", kLongestText));
  if (!is_scan_id(manifest.scan_id)) return fields.complaint("scan_id", "1 to 64 of a-z 0-9 -");
  manifest.created_at = ALHAZEN_TRY(fields.text("created_at", limits::kNameBytes));
  manifest.object_id = ALHAZEN_TRY(fields.text("object_id", kLongestText));
  manifest.note = ALHAZEN_TRY(fields.text("note", kLongestText));
  manifest.operator_name = ALHAZEN_TRY(fields.text("operator", kLongestText));
  manifest.software_version = ALHAZEN_TRY(fields.text("software_version", kLongestText));
  manifest.rig_hash = ALHAZEN_TRY(fields.text("rig_hash", limits::kNameBytes));
  manifest.coding = ALHAZEN_TRY(one_of<Coding>(fields, "coding", kCodings));
  manifest.keep_frames = ALHAZEN_TRY(one_of<KeepFrames>(fields, "keep_frames", kKeepFrames));
  manifest.volume = ALHAZEN_TRY(parse_volume(ALHAZEN_TRY(fields.object("volume"))));
  manifest.level = ALHAZEN_TRY(fields.small("level", 1, 16));
  const json& stops = *ALHAZEN_TRY(fields.list("stops", 1, kMostStops));
  for (std::size_t i = 0; i < stops.size(); ++i) {
    manifest.stops.push_back(
        ALHAZEN_TRY(parse_stop(ALHAZEN_TRY(fields.entry("stops", stops, i)), i)));
  }
  const json& displays = *ALHAZEN_TRY(fields.list("displays", 1, kMostDisplays));
  for (std::size_t i = 0; i < displays.size(); ++i) {
    manifest.displays.push_back(
        ALHAZEN_TRY(parse_display(ALHAZEN_TRY(fields.entry("displays", displays, i)))));
  }
  const json& cameras = *ALHAZEN_TRY(fields.list("cameras", 1, kMostCameras));
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    manifest.cameras.push_back(
        ALHAZEN_TRY(parse_camera(ALHAZEN_TRY(fields.entry("cameras", cameras, i)))));
  }
  ALHAZEN_TRY(fields.all_known());
  if (stops.size() * displays.size() * cameras.size() > kMostStacks) {
    return Error{Code::invalid,
                 "keys 'stops', 'displays' and 'cameras' make " +
                     std::to_string(stops.size() * displays.size() * cameras.size()) +
                     " light maps; they must make at most " + std::to_string(kMostStacks)};
  }
  ALHAZEN_TRY(names_are_distinct(manifest));
  return manifest;
}

std::string Manifest::to_json() const {
  Ordered stop_list = Ordered::array(), display_list = Ordered::array(),
          camera_list = Ordered::array();
  for (const Stop& stop : stops) {
    stop_list.push_back({{"index", stop.index}, {"wanted_rad", stop.wanted_rad}});
  }
  for (const PlannedDisplay& display : displays) {
    Ordered patterns = Ordered::array();
    for (const Pattern& pattern : display.patterns) patterns.push_back(json_of(pattern));
    display_list.push_back({{"name", display.name},
                            {"width_px", display.width_px},
                            {"height_px", display.height_px},
                            {"gamma", display.gamma},
                            {"patterns", std::move(patterns)}});
  }
  for (const PlannedCamera& camera : cameras) {
    const Region& region = camera.settings.region;
    camera_list.push_back(
        {{"name", camera.name},
         {"exposure_us", camera.settings.exposure.count()},
         {"gain_db", camera.settings.gain_db},
         {"region",
          {{"x", region.x}, {"y", region.y}, {"width", region.width}, {"height", region.height}}}});
  }
  const Ordered document = {
      {"format", format},
      {"scan_id", scan_id},
      {"created_at", created_at},
      {"object_id", object_id},
      {"note", note},
      {"operator", operator_name},
      {"software_version", software_version},
      {"rig_hash", rig_hash},
      {"coding", word_of(coding, kCodings)},
      {"keep_frames", word_of(keep_frames, kKeepFrames)},
      {"volume",
       {{"centre_mm", {volume.centre_mm.x(), volume.centre_mm.y(), volume.centre_mm.z()}},
        {"edge_mm", volume.edge_mm}}},
      {"level", level},
      {"stops", std::move(stop_list)},
      {"displays", std::move(display_list)},
      {"cameras", std::move(camera_list)}};
  // Operators may type anything: bytes that are no UTF-8 are replaced, not refused.
  return document.dump(1, ' ', false, Ordered::error_handler_t::replace) + "\n";
}

}  // namespace alhazen
