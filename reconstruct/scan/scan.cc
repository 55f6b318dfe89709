#include "reconstruct/scan/scan.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <set>
#include <system_error>

#include "reconstruct/scan/image_file.h"
#include "reconstruct/scan/light_map_file.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxManifestBytes = std::uint64_t{64} << 20;
constexpr std::uint64_t kMaxFrameLogBytes = std::uint64_t{4} << 30;

std::string three_digits(int number) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%03d", number);
  return text.data();
}

}  // namespace

Result<Scan> Scan::create(const fs::path& directory, Manifest manifest, Rig rig) {
  // What was checked cannot be refused when the directory is opened again.
  manifest = ALHAZEN_TRY(Manifest::parse(manifest.to_json()));
  const fs::path target = directory.has_filename() ? directory : directory.parent_path();
  std::error_code error;
  if (fs::exists(target, error)) {
    return Error{Code::conflict, "scan directory '" + target.string() + "' exists already"};
  }
  // Made aside and renamed: a directory without its manifest never exists.
  const fs::path partial = aside(target);
  fs::remove_all(partial, error);
  for (const char* folder : {"frames", "light_maps"}) {
    fs::create_directories(partial / folder, error);
    if (error) {
      return Error{Code::unavailable,
                   "cannot make '" + (partial / folder).string() + "': " + error.message()};
    }
  }
  ALHAZEN_TRY(write_file_safely(partial / "manifest.json", manifest.to_json()));
  ALHAZEN_TRY(write_file_safely(partial / "rig.json", rig.to_json()));
  fs::rename(partial, target, error);
  if (error) {
    return Error{Code::conflict, "cannot make '" + target.string() + "': " + error.message()};
  }
  ALHAZEN_TRY(sync_folder(target.parent_path()));
  return Scan(target, std::move(manifest), std::move(rig));
}

Result<Scan> Scan::open(const fs::path& directory) {
  const std::string manifest_text =
      ALHAZEN_TRY(read_file(directory / "manifest.json", kMaxManifestBytes));
  Manifest manifest = ALHAZEN_TRY(Manifest::parse(manifest_text).in("manifest.json"));
  Rig rig = ALHAZEN_TRY(Rig::load(directory / "rig.json").in("rig.json"));
  Scan scan(directory, std::move(manifest), std::move(rig));
  const fs::path log_file = directory / "frames.jsonl";
  std::error_code error;
  if (fs::exists(log_file, error)) {
    const FrameLog log = ALHAZEN_TRY(scan.frame_log());
    if (fs::file_size(log_file, error) != log.valid_bytes) {
      ALHAZEN_TRY(cut_file(log_file, log.valid_bytes));
    }
  }
  return scan;
}

Result<std::vector<StackKey>> Scan::light_maps() const {
  std::error_code error;
  std::set<std::string> files;
  for (fs::directory_iterator i(directory_ / "light_maps", error), end; !error && i != end;
       i.increment(error)) {
    files.insert(i->path().filename().string());
  }
  if (error) {
    return Error{Code::unavailable,
                 "cannot list '" + (directory_ / "light_maps").string() + "': " + error.message()};
  }
  std::vector<StackKey> keys;
  for (const Stop& stop : manifest_.stops) {
    for (const PlannedDisplay& display : manifest_.displays) {
      for (const PlannedCamera& camera : manifest_.cameras) {
        StackKey key{stop.index, display.name, camera.name};
        if (files.contains(light_map_name(key))) keys.push_back(std::move(key));
      }
    }
  }
  std::ranges::sort(keys);
  return keys;
}

Result<LightMap> Scan::load_light_map(const StackKey& key) const {
  const fs::path file = directory_ / "light_maps" / light_map_name(key);
  LightMap map = ALHAZEN_TRY(read_light_map(file));
  if (map.key != key) {
    return Error{Code::corrupt, "'" + file.string() + "' holds the light map of " +
                                    light_map_name(map.key) + ": attributes and name disagree"};
  }
  return map;
}

Status Scan::commit(const LightMap& map, std::span<const FrameRecord> frames) {
  ALHAZEN_TRY(write_light_map(map, directory_ / "light_maps" / light_map_name(map.key)));
  std::string lines;
  for (const FrameRecord& frame : frames) lines += to_line(frame) + "\n";
  if (lines.empty()) return {};
  return append_to_file(directory_ / "frames.jsonl", lines);
}

Result<std::string> Scan::store_frame(const FrameRecord& record, const Image& image) {
  const std::string name = "frames/" + three_digits(record.stop) + "_" + record.display + "_" +
                           record.camera + "_" + three_digits(record.pattern) +
                           (record.attempt > 1 ? "_try" + std::to_string(record.attempt) : "") +
                           ".png";
  ALHAZEN_TRY(write_image(image, directory_ / name));
  return name;
}

Result<FrameLog> Scan::frame_log() const {
  const fs::path file = directory_ / "frames.jsonl";
  std::error_code error;
  if (!fs::exists(file, error)) return FrameLog{};  // no stack is safe yet
  const std::string text = ALHAZEN_TRY(read_file(file, kMaxFrameLogBytes));
  return parse_frame_log(text).in("frames.jsonl");
}

}  // namespace alhazen
