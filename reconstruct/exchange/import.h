#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/decode/decoder.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/run.h"
#include "reconstruct/scan/frame_log.h"
#include "reconstruct/scan/frame_table.h"
#include "reconstruct/scan/scan.h"

namespace alhazen {

/// Where the pictures of a table lie, and how they are decoded.
struct PictureSource {
  std::filesystem::path folder;  ///< of the table: its files are relative to it
  int bits = 0;  ///< significant bits of a pixel, 8 … 16; 0: all that the file has
  DecodeOptions decode;
};

/// The light map of the pictures of one stack; up to eight of them are read at once. `frames`, if
/// not null, gets a record of each picture (all but step, stop and pattern).
/// Fails: as read_image() and Decoder, naming the line; invalid (a picture is not of `camera_px`,
///        where that is not empty), cancelled. Uses the caller's TBB arena.
[[nodiscard]] Result<LightMap> decode_stack(const TableStack& stack, const PictureSource& source,
                                            int display_width_px, int display_height_px,
                                            const CameraModel* camera,
                                            std::vector<FrameRecord>* frames, const Run& run);

/// What a scan recorded elsewhere does not tell itself.
struct ImportOptions {
  std::string scan_id;  ///< empty: made of the directory's name
  std::string object_id, note, operator_name, created_at, software_version;
  Volume volume;
  int level = 8;
  /// Stacks that cannot be decoded are left out and named, instead of ending the import.
  bool leaves_out_bad = false;
};

/// What came of an import.
struct Imported {
  std::size_t light_maps = 0;  ///< that the scan directory holds now
  std::size_t decoded = 0;     ///< of them, by this import
  std::vector<std::string> warnings;
};

/// Makes a scan directory of the pictures that a table lists: manifest, rig, light maps,
/// frames.jsonl with the pictures' checksums (the pictures themselves stay where they are). Stops
/// are numbered anew from 0 where the table's numbers have gaps. Names, sizes and files are checked
/// before the first picture is decoded. A directory of the same import that a crash or a failure
/// left is gone on with. Fails: invalid (a camera or display that the rig does not have, pictures
/// of another size than
///        its camera, a stop of two angles), unavailable (a file is missing), conflict (the
///        directory is of something else), else as decode_stack(), Scan and the table's reader.
[[nodiscard]] Result<Imported> import_scan(const Rig& rig, const std::filesystem::path& table,
                                           const std::filesystem::path& directory,
                                           const PictureSource& source,
                                           const ImportOptions& options, const Run& run);

}  // namespace alhazen
