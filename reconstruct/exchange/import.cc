#include "reconstruct/exchange/import.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "reconstruct/scan/image_file.h"
#include "reconstruct/scan/safe_file.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxTableBytes = std::uint64_t{1} << 30;
/// Pictures of a stack that are read at once: as many as a Decoder holds anyway.
constexpr std::size_t kAtOnce = 8;
/// Angles of one stop by several cameras and displays may differ so much: an encoder's noise.
constexpr double kSameAngle_rad = 0.1 * std::numbers::pi / 180;

std::string name_of(const StackKey& key) {
  return "stop " + std::to_string(key.stop) + ", display " + key.display + ", camera " + key.camera;
}

Status check_size(const Image& image, const CameraModel& camera) {
  if (image.width() == camera.width_px && image.height() == camera.height_px) return {};
  return Error{Code::invalid, "a picture of " + std::to_string(image.width()) + " x " +
                                  std::to_string(image.height()) + " px, but the rig's camera '" +
                                  camera.name + "' has " + std::to_string(camera.width_px) + " x " +
                                  std::to_string(camera.height_px) + " px"};
}

template <class Devices>
std::string names_of(const Devices& devices) {
  std::string names;
  for (const auto& device : devices) names += (names.empty() ? "" : ", ") + device.name;
  return names;
}

/// A stop of the table, and its number there.
struct TableStop {
  int number = 0, line = 0;
  double angle_rad = 0;
};

/// What the table says of the whole scan.
struct Plan {
  std::vector<TableStack> stacks;
  std::vector<TableStop> stops;  ///< in the order of their numbers
  std::map<std::string, std::vector<Pattern>, std::less<>> patterns;  ///< of each display
  std::map<std::string, Micros, std::less<>> exposures;               ///< of each camera
  [[nodiscard]] int index_of(int number) const {
    const auto at = std::ranges::lower_bound(stops, number, {}, &TableStop::number);
    return static_cast<int>(at - stops.begin());
  }
};

Result<Plan> plan_of(std::vector<TableFrame> frames) {
  Plan plan;
  plan.stacks = stacks_of(std::move(frames));
  std::map<int, TableStop> stops;
  for (const TableStack& stack : plan.stacks) {
    const int line = stack.frames.front().line;
    const auto [stop, is_new] =
        stops.try_emplace(stack.key.stop, TableStop{stack.key.stop, line, stack.angle_rad});
    if (!(std::abs(stack.angle_rad - stop->second.angle_rad) <= kSameAngle_rad)) {
      constexpr double kDeg = 180 / std::numbers::pi;
      return Error{Code::invalid, "stop " + std::to_string(stack.key.stop) + " has the angles " +
                                      std::to_string(stop->second.angle_rad * kDeg) +
                                      " deg (line " + std::to_string(stop->second.line) + ") and " +
                                      std::to_string(stack.angle_rad * kDeg) + " deg (line " +
                                      std::to_string(line) + "); a stop is one angle"};
    }
    std::vector<Pattern>& shown = plan.patterns[stack.key.display];
    Micros& exposure = plan.exposures[stack.key.camera];
    for (const TableFrame& frame : stack.frames) {
      if (std::ranges::find(shown, frame.pattern) == shown.end()) shown.push_back(frame.pattern);
      exposure = std::max(exposure, frame.exposure);
    }
  }
  for (const auto& [number, stop] : stops) plan.stops.push_back(stop);
  return plan;
}

/// Whatever can be known to be wrong before a picture is decoded.
Status check(const Plan& plan, const Rig& rig, const PictureSource& source,
             const ImportOptions& options) {
  std::set<std::string_view> seen;  // cameras whose picture size is known to be right
  for (const TableStack& stack : plan.stacks) {
    const std::string line = "line " + std::to_string(stack.frames.front().line);
    const CameraModel* camera = rig.camera(stack.key.camera);
    if (camera == nullptr) {
      return Error{Code::invalid, line + ": the rig has no camera '" + stack.key.camera +
                                      "'; it has " + names_of(rig.cameras)};
    }
    if (rig.display(stack.key.display) == nullptr) {
      return Error{Code::invalid, line + ": the rig has no display '" + stack.key.display +
                                      "'; it has " + names_of(rig.displays)};
    }
    for (const TableFrame& frame : stack.frames) {
      std::error_code error;
      if (options.leaves_out_bad || fs::is_regular_file(source.folder / frame.file, error))
        continue;
      return Error{Code::unavailable, "line " + std::to_string(frame.line) +
                                          ": there is no file '" +
                                          (source.folder / frame.file).string() + "'"};
    }
    if (seen.contains(camera->name)) continue;
    const TableFrame& first = stack.frames.front();
    const auto image = read_image(source.folder / first.file, source.bits);
    if (!image && options.leaves_out_bad) continue;
    if (!image) return image.error().in(line);
    ALHAZEN_TRY(check_size(*image, *camera).in(line));
    seen.insert(camera->name);
  }
  return {};
}

/// A name made of what a file system allows: [a-z0-9-]{1,64}.
std::string scan_id_of(const fs::path& directory) {
  const fs::path name =
      directory.has_filename() ? directory.filename() : directory.parent_path().filename();
  std::string id;
  for (const char c : name.string()) {
    const bool is_good = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
    if (is_good) {
      id += c;
    } else if (c >= 'A' && c <= 'Z') {
      id += static_cast<char>(c - 'A' + 'a');
    } else if (!id.empty() && id.back() != '-') {
      id += '-';
    }
    if (id.size() == 64) break;
  }
  return id.empty() ? "imported" : id;
}

Manifest manifest_of(const Plan& plan, const Rig& rig, const fs::path& directory,
                     const ImportOptions& options) {
  Manifest manifest;
  manifest.scan_id = options.scan_id.empty() ? scan_id_of(directory) : options.scan_id;
  manifest.created_at = options.created_at;
  manifest.object_id = options.object_id;
  manifest.note = options.note;
  manifest.operator_name = options.operator_name;
  manifest.software_version = options.software_version;
  manifest.rig_hash = rig.hash();
  manifest.volume = options.volume;
  manifest.level = options.level;
  for (std::size_t i = 0; i < plan.stops.size(); ++i)
    manifest.stops.push_back({static_cast<int>(i), plan.stops[i].angle_rad});
  for (const DisplayModel& display : rig.displays) {
    const auto shown = plan.patterns.find(display.name);
    if (shown == plan.patterns.end()) continue;
    manifest.displays.push_back(
        {display.name, display.width_px, display.height_px, shown->second, display.gamma});
    if (std::ranges::any_of(shown->second,
                            [](const Pattern& p) { return p.kind == PatternKind::phase; }))
      manifest.coding = Coding::gray_phase;
  }
  for (const CameraModel& camera : rig.cameras) {
    const auto exposure = plan.exposures.find(camera.name);
    if (exposure == plan.exposures.end()) continue;
    CameraSettings settings;
    settings.exposure = std::max(exposure->second, Micros(1));  // 0: nobody noted it
    settings.region = {0, 0, camera.width_px, camera.height_px};
    manifest.cameras.push_back({camera.name, settings});
  }
  return manifest;
}

std::vector<std::string> warnings_of(const Plan& plan, const Rig& rig) {
  std::vector<std::string> warnings;
  for (const CameraModel& camera : rig.cameras) {
    if (!plan.exposures.contains(camera.name))
      warnings.push_back("the table has no picture of the rig's camera '" + camera.name + "'");
  }
  for (const DisplayModel& display : rig.displays) {
    if (!plan.patterns.contains(display.name))
      warnings.push_back("the table has no picture of the rig's display '" + display.name + "'");
  }
  std::string gaps;
  for (std::size_t i = 1; i < plan.stops.size(); ++i) {
    const int last = plan.stops[i - 1].number, next = plan.stops[i].number;
    if (next == last + 1) continue;
    gaps += (gaps.empty() ? "" : ", ") + std::to_string(last + 1);
    if (next > last + 2) gaps += " to " + std::to_string(next - 1);
  }
  if (!gaps.empty())
    warnings.push_back("the table lacks stop " + gaps + "; the stops are numbered anew from 0");
  return warnings;
}

/// The directory of an import that was begun, or a new one.
Result<Scan> open_or_create(const fs::path& directory, Manifest manifest, const Rig& rig) {
  std::error_code error;
  if (!fs::exists(directory / "manifest.json", error))
    return Scan::create(directory, std::move(manifest), rig);
  Scan scan = ALHAZEN_TRY(Scan::open(directory).in(directory.string()));
  manifest.created_at = scan.manifest().created_at;
  if (manifest.to_json() != scan.manifest().to_json() || rig.hash() != scan.rig().hash()) {
    return Error{Code::conflict, "scan directory '" + directory.string() +
                                     "' holds another scan, or one of another rig or table"};
  }
  return scan;
}

}  // namespace

Result<LightMap> decode_stack(const TableStack& stack, const PictureSource& source,
                              int display_width_px, int display_height_px,
                              const CameraModel* camera, std::vector<FrameRecord>* frames,
                              const Run& run) {
  std::vector<Pattern> sequence;
  for (const TableFrame& frame : stack.frames) sequence.push_back(frame.pattern);
  std::optional<Decoder> decoder;
  for (std::size_t begin = 0; begin < stack.frames.size(); begin += kAtOnce) {
    if (run.stopped()) return Error{Code::cancelled, "decoding was interrupted"};
    const std::size_t count = std::min(kAtOnce, stack.frames.size() - begin);
    std::vector<Result<Image>> images(count, Error{Code::internal, "not read"});
    for_each_index(count, [&](std::size_t k) {
      const TableFrame& frame = stack.frames[begin + k];
      images[k] = read_image(source.folder / frame.file, source.bits)
                      .in("line " + std::to_string(frame.line));
    });
    for (std::size_t k = 0; k < count; ++k) {
      const TableFrame& frame = stack.frames[begin + k];
      const std::string line = "line " + std::to_string(frame.line);
      if (!images[k]) return std::move(images[k].error());
      const Image& image = *images[k];
      const Region region{0, 0, image.width(), image.height()};
      if (camera != nullptr) ALHAZEN_TRY(check_size(image, *camera).in(line));
      if (!decoder) {
        decoder =
            ALHAZEN_TRY(Decoder::make(source.decode, stack.key, stack.angle_rad, region,
                                      image.bits(), display_width_px, display_height_px, sequence));
      }
      ALHAZEN_TRY(decoder->add(frame.pattern, image).in(line));
      if (frames == nullptr) continue;
      FrameRecord record;
      record.camera = stack.key.camera;
      record.display = stack.key.display;
      record.angle_rad = stack.angle_rad;
      record.settings = {frame.exposure, 0, region};
      record.checksum = checksum(image);
      frames->push_back(std::move(record));
    }
  }
  if (!decoder) return Error{Code::invalid, "a stack without pictures"};
  return std::move(*decoder).finish();
}

Result<Imported> import_scan(const Rig& rig, const fs::path& table, const fs::path& directory,
                             const PictureSource& source, const ImportOptions& options,
                             const Run& run) {
  const std::string where = table.filename().string();
  const std::string text = ALHAZEN_TRY(read_file(table, kMaxTableBytes));
  const Plan plan = ALHAZEN_TRY(plan_of(ALHAZEN_TRY(parse_frame_table(text).in(where))).in(where));
  ALHAZEN_TRY(check(plan, rig, source, options).in(where));
  Scan scan =
      ALHAZEN_TRY(open_or_create(directory, manifest_of(plan, rig, directory, options), rig));
  const std::vector<StackKey> present = ALHAZEN_TRY(scan.light_maps());

  Imported imported;
  imported.warnings = warnings_of(plan, rig);
  imported.light_maps = present.size();
  std::uint64_t step = 0;
  for (std::size_t i = 0; i < plan.stacks.size(); ++i) {
    run.tell("import", static_cast<double>(i) / static_cast<double>(plan.stacks.size()));
    TableStack stack = plan.stacks[i];
    const std::string name = where + ", " + name_of(stack.key);
    stack.key.stop = plan.index_of(stack.key.stop);
    const std::uint64_t first_step = step;
    step += stack.frames.size();
    if (std::ranges::find(present, stack.key) != present.end()) continue;
    const DisplayModel& display = *rig.display(stack.key.display);
    std::vector<FrameRecord> frames;
    const auto map = decode_stack(stack, source, display.width_px, display.height_px,
                                  rig.camera(stack.key.camera), &frames, run)
                         .in(name);
    if (!map && options.leaves_out_bad && map.error().code != Code::cancelled) {
      imported.warnings.push_back("left out: " + map.error().text());
      continue;
    }
    if (!map) return map.error();
    const std::vector<Pattern>& shown = plan.patterns.find(stack.key.display)->second;
    for (std::size_t k = 0; k < frames.size(); ++k) {
      frames[k].step = first_step + k;
      frames[k].stop = stack.key.stop;
      frames[k].pattern =
          static_cast<int>(std::ranges::find(shown, stack.frames[k].pattern) - shown.begin());
    }
    ALHAZEN_TRY(scan.commit(*map, frames));
    ++imported.decoded;
    ++imported.light_maps;
  }
  run.tell("import", 1);
  return imported;
}

}  // namespace alhazen
