#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "drivers/sim/scene.h"
#include "reconstruct/pattern/sequence.h"
#include "reconstruct/run.h"
#include "reconstruct/scan/scan.h"

namespace alhazen::experiment {

/// What is scanned, and how.
struct ScanRecipe {
  std::string world;              ///< file of config/worlds without its ending
  sim::SceneOverrides overrides;  ///< object mesh, size, up
  Coding coding = Coding::gray;
  int stops = 24;
  int level = 9;
  double edge_mm = 102.4;
};

/// A scan directory under `cache` as the daemon would leave it, with the exact calibration: every
/// frame is rendered, exposed with noise and quantisation, and decoded. Made once a recipe; what is
/// there and complete is opened. Runs without the daemon's devices and clock, for it has no faults.
/// Fails: as Scene::load, make_plan, Scan; cancelled.
[[nodiscard]] Result<Scan> simulated_scan(const std::filesystem::path& cache,
                                          const ScanRecipe& recipe, const Run& run);

/// Replaces a share of the positions by places evenly spread over the display, as a decoder that
/// errs unnoticed would. Seeded, independent of the order of maps.
void scatter_outliers(LightMap& map, double share, std::uint64_t seed, int width_px, int height_px);

}  // namespace alhazen::experiment
