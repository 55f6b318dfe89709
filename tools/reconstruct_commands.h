#pragma once

#include <filesystem>
#include <optional>

#include "alhazen/result.h"
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

/// alhazen-reconstruct report
struct ReportArgs {
  std::filesystem::path scan;       ///< with mesh.ply and report.json
  std::filesystem::path reference;  ///< empty where there is none
  std::filesystem::path out;        ///< empty: into the scan directory
};
Status report_again(const ReportArgs& args, const Run& run);

/// alhazen-reconstruct compare
struct CompareArgs {
  std::filesystem::path mesh;
  std::filesystem::path reference;         ///< empty where a sphere is the reference
  std::optional<double> sphere_radius_mm;  ///< instead of a reference
  bool as_json = false;
};
Status compare_meshes(const CompareArgs& args, const Run& run);

}  // namespace alhazen
