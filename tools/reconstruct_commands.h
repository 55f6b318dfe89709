#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/decode/decoder.h"
#include "reconstruct/run.h"

namespace alhazen {

// The sub-commands of alhazen-reconstruct, each in its own file reconstruct_NAME.cc. Results go to
// standard output, progress to the Run.

/// alhazen-reconstruct info
struct InfoArgs {
  std::filesystem::path scan;
  bool has_maps = false;  ///< loads every light map and says what its pixels saw
  bool as_json = false;
};
Status show_scan(const InfoArgs& args, const Run& run);

/// alhazen-reconstruct run
struct RunArgs {
  std::filesystem::path scan;
  std::optional<int> level;         ///< instead of the scan's
  std::filesystem::path reference;  ///< empty where there is none
  std::filesystem::path out;        ///< empty: into the scan directory
};
Status run_reconstruction(const RunArgs& args, const Run& run);

/// alhazen-reconstruct report
struct ReportArgs {
  std::filesystem::path scan;       ///< with mesh.ply and report.json
  std::filesystem::path reference;  ///< empty where there is none
  std::filesystem::path out;        ///< empty: into the scan directory
};
Status report_again(const ReportArgs& args, const Run& run);
/// alhazen-reconstruct decode
struct DecodeArgs {
  std::filesystem::path frames;            ///< frames.csv; its pictures lie relative to it
  std::filesystem::path rig;               ///< empty: sizes of cameras are not checked
  std::filesystem::path out;               ///< folder of the light maps
  std::vector<std::string> display_sizes;  ///< "NAME=WxH", before the rig's
  int bits = 0;                            ///< significant bits of a pixel, 0: the file's
  DecodeOptions options;
};
/// Prints one JSON object a light map.
Status decode_frames(const DecodeArgs& args, const Run& run);

/// alhazen-reconstruct compare
struct CompareArgs {
  std::filesystem::path mesh;
  std::filesystem::path reference;         ///< empty where a sphere is the reference
  std::optional<double> sphere_radius_mm;  ///< instead of a reference
  bool as_json = false;
};
Status compare_meshes(const CompareArgs& args, const Run& run);

}  // namespace alhazen
