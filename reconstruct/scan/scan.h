#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/scan/frame_log.h"
#include "reconstruct/scan/light_map.h"
#include "reconstruct/scan/manifest.h"

namespace alhazen {

/// A scan directory: the border between capture and reconstruction. What is not in it does not
/// exist. Every file is written aside, synced and renamed; a line of frames.jsonl follows its data.
///
/// Thread: thread-bound (one writer); reading functions are const and reentrant.
/// Layout: reconstruct/README.md.
class Scan {
 public:
  /// Makes the directory with manifest.json and rig.json. Fails: conflict (it exists), exhausted,
  /// unavailable.
  [[nodiscard]] static Result<Scan> create(const std::filesystem::path& directory,
                                           Manifest manifest, Rig rig);
  /// Opens an existing one; a torn last line of frames.jsonl is cut off. Fails: unavailable,
  /// corrupt, invalid.
  [[nodiscard]] static Result<Scan> open(const std::filesystem::path& directory);

  [[nodiscard]] const std::filesystem::path& directory() const noexcept { return directory_; }
  [[nodiscard]] const Manifest& manifest() const noexcept { return manifest_; }
  [[nodiscard]] const Rig& rig() const noexcept { return rig_; }

  /// Keys of the light maps that are safe on disk, sorted.
  [[nodiscard]] Result<std::vector<StackKey>> light_maps() const;
  [[nodiscard]] Result<LightMap> load_light_map(const StackKey& key) const;
  /// Makes a light map safe, then the records of the frames it came from.
  Status commit(const LightMap& map, std::span<const FrameRecord> frames);

  /// Stores one picture (PNG, 16 bit where needed) under frames/; returns its path relative to the
  /// directory.
  Result<std::string> store_frame(const FrameRecord& record, const Image& image);

  [[nodiscard]] Result<FrameLog> frame_log() const;

 private:
  Scan(std::filesystem::path directory, Manifest manifest, Rig rig)
      : directory_(std::move(directory)), manifest_(std::move(manifest)), rig_(std::move(rig)) {}
  std::filesystem::path directory_;
  Manifest manifest_;
  Rig rig_;
};

}  // namespace alhazen
