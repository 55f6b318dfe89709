#pragma once

#include <functional>
#include <string>
#include <vector>

#include "drivers/sim/scene.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/report/compare.h"
#include "tests/experiment/experiment.h"
#include "tests/experiment/simulated_scan.h"

namespace alhazen::experiment {

constexpr double kUmPerMm = 1000;

/// Which light maps of a scan are taken; nothing: all.
using Selection = std::function<bool(const StackKey&)>;

struct Measured {
  Reconstructed result;
  Row figures;  ///< maps, level, voxel, times, memory
};

/// A reconstruction that holds the light maps of a scan, 1 % of their positions replaced.
/// Fails: as Scan, Reconstruction; cancelled.
[[nodiscard]] Result<Reconstruction> with_maps(const Context& context, const Scan& scan,
                                               const Rig& rig, int level,
                                               const Options& options = {},
                                               const Selection& selection = {});

/// Reconstructs a scan with 1 % of its positions replaced. "after_last_map_s" is what a live scan
/// would still take after its last light map: finish() alone.
/// Fails: as Scan, Reconstruction; cancelled.
[[nodiscard]] Result<Measured> measure(const Context& context, const Scan& scan, const Rig& rig,
                                       int level, const Options& options = {},
                                       const Selection& selection = {});

/// RMS, 90 % and 99 % in µm, their keys begun with `prefix`.
void put(Row& row, const std::string& prefix, const DistanceFigures& figures);
/// Vertices, and the share of them that is observed.
void put_observed(Row& row, const Mesh& mesh);

/// The true surface of a recipe's object. Fails: as Scene::load and Shape::make.
[[nodiscard]] Result<Mesh> truth_of(const ScanRecipe& recipe);

/// Writes mesh, report page and pictures into the folder `name`; returns the distances on the page.
/// Fails: as make_report(), write_report(); unavailable (no such folder can be made).
[[nodiscard]] Result<Comparison> write_page(const Context& context, const std::string& name,
                                            const Scan& scan, const Reconstructed& made,
                                            const Mesh& truth);

/// An object against its truth: distances, completeness, normals; with a page.
struct ObjectRow {
  Row row;
  Measured measured;
  Mesh truth;
};
/// Fails: as simulated_scan(), measure(), truth_of(), write_page().
[[nodiscard]] Result<ObjectRow> object_row(const Context& context, const char* name,
                                           const ScanRecipe& recipe, const Row& bounds,
                                           const Selection& selection = {});

/// A mesh of the data folder, 80 mm long, on the rig of config/worlds/bunny11.toml.
[[nodiscard]] ScanRecipe mesh_recipe(const Context& context, const char* file, const char* up);

}  // namespace alhazen::experiment
