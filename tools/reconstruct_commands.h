#pragma once

#include <filesystem>
#include <optional>

#include "alhazen/result.h"
#include "reconstruct/run.h"

namespace alhazen {

// The sub-commands of alhazen-reconstruct, each in its own file reconstruct_NAME.cc. Results go to
// standard output, progress to the Run.

/// alhazen-reconstruct compare
struct CompareArgs {
  std::filesystem::path mesh;
  std::filesystem::path reference;         ///< empty where a sphere is the reference
  std::optional<double> sphere_radius_mm;  ///< instead of a reference
  bool as_json = false;
};
Status compare_meshes(const CompareArgs& args, const Run& run);

}  // namespace alhazen
