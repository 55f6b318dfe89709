// Rows of objects that mirror: simulated light maps to a mesh, against the truth.
#include <sys/resource.h>

#include <cmath>
#include <fstream>
#include <optional>
#include <string>
#include <utility>

#include "drivers/sim/calibrated_rig.h"
#include "drivers/sim/shape.h"
#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/report/compare.h"
#include "reconstruct/stage_time.h"
#include "tests/experiment/experiment.h"
#include "tests/experiment/simulated_scan.h"

namespace alhazen::experiment {
namespace {

constexpr double kUmPerMm = 1000;
/// Positions that are wrong after decoding (the protocol).
constexpr double kOutlierShare = 0.01;
constexpr std::uint64_t kSeed = 1;

/// Most memory that this process has held since forget_peak(), MiB.
double peak_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind("VmHWM:", 0) == 0) return std::stod(line.substr(6)) / 1024;
  }
  return std::nan("");
}
void forget_peak() { std::ofstream("/proc/self/clear_refs") << "5"; }

struct Made {
  Reconstructed result;
  Row figures;  ///< maps, level, voxel, times, memory
};

/// Reconstructs a scan with outliers scattered in its light maps.
Result<Made> reconstruct(const Context& context, const Scan& scan, const Rig& rig, int level,
                         const Options& options = {}) {
  forget_peak();
  const StageClock clock;
  const std::vector<StackKey> keys = ALHAZEN_TRY(scan.light_maps());
  Reconstruction work =
      ALHAZEN_TRY(Reconstruction::make(rig, scan.manifest().volume, level, options));
  for (const StackKey& key : keys) {
    if (context.run.stopped()) return Error{Code::cancelled, "interrupted"};
    LightMap map = ALHAZEN_TRY(scan.load_light_map(key));
    const DisplayModel& display = *rig.display(key.display);
    scatter_outliers(map, kOutlierShare, kSeed, display.width_px, display.height_px);
    ALHAZEN_TRY(work.add(map));
  }
  Made made{ALHAZEN_TRY(work.finish(context.run)), {}};
  const StageTime time = clock.read("all");
  made.figures = {{"light_maps", keys.size()},
                  {"level", level},
                  {"voxel_mm", scan.manifest().volume.edge_mm / (1 << level)},
                  {"outlier_share", kOutlierShare},
                  {"seed", kSeed},
                  {"leaves", made.result.octree.size()},
                  {"time_s", time.cpu_s / 2},
                  {"wall_s", time.wall_s},
                  {"peak_mib", peak_mib()}};
  for (const StageTime& stage : made.result.times) {
    made.figures["stage_cpu_s"][stage.stage] = stage.cpu_s;
  }
  return made;
}

void put(Row& row, const std::string& prefix, const DistanceFigures& figures) {
  row[prefix + "rms_um"] = kUmPerMm * figures.rms_mm;
  row[prefix + "p90_um"] = kUmPerMm * figures.p90_mm;
  row[prefix + "p99_um"] = kUmPerMm * figures.p99_mm;
}

void put_observed(Row& row, const Mesh& mesh) {
  std::size_t observed = 0;
  for (const auto flag : mesh.observed) observed += flag != 0 ? 1U : 0U;
  row["vertices"] = mesh.vertices_mm.size();
  row["observed_share"] =
      static_cast<double>(observed) / static_cast<double>(mesh.vertices_mm.size());
}

Result<std::vector<Row>> sphere(const Context& context, const char* name, Coding coding,
                                const Row& bounds) {
  ScanRecipe recipe;
  recipe.world = "sphere";
  recipe.coding = coding;
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, recipe, context.run));
  const Made made = ALHAZEN_TRY(reconstruct(context, scan, scan.rig(), recipe.level));
  const SphereComparison off = ALHAZEN_TRY(compare_sphere(made.result.mesh, 25));
  ALHAZEN_TRY(write_mesh(made.result.mesh, context.out / (std::string(name) + ".ply")));
  Row row{{"experiment", name}};
  if (off.observed) put(row, "", off.observed->distances);
  put(row, "whole_", off.all.distances);
  put_observed(row, made.result.mesh);
  row.update(bounds);
  row.update(made.figures);
  return std::vector<Row>{row};
}

/// The three estimates of the votes' density, as the thesis compares them: level 8, Gray code.
Result<std::vector<Row>> densities(const Context& context) {
  ScanRecipe recipe;
  recipe.world = "sphere";
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, recipe, context.run));
  std::vector<Row> rows;
  const std::pair<const char*, Density> kinds[] = {{"gaussian", Density::gaussian},
                                                   {"epanechnikov", Density::epanechnikov},
                                                   {"histogram", Density::histogram}};
  for (const auto& [kind, density] : kinds) {
    Options options;
    options.vote.density = density;
    const Made made = ALHAZEN_TRY(reconstruct(context, scan, scan.rig(), 8, options));
    const SphereComparison off = ALHAZEN_TRY(compare_sphere(made.result.mesh, 25));
    Row row{{"experiment", std::string("density_") + kind}};
    if (off.observed) put(row, "", off.observed->distances);
    put_observed(row, made.result.mesh);
    row.update(made.figures);
    rows.push_back(std::move(row));
  }
  return rows;
}

/// A mesh of the data folder on the rig of config/worlds/bunny.toml with eleven cameras.
Result<std::vector<Row>> object(const Context& context, const char* name, ScanRecipe recipe,
                                const Row& bounds) {
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, recipe, context.run));
  const Made made = ALHAZEN_TRY(reconstruct(context, scan, scan.rig(), recipe.level));
  const sim::Scene scene = ALHAZEN_TRY(sim::Scene::load(
      std::filesystem::path(ALHAZEN_SOURCE_DIR) / "config/worlds" / (recipe.world + ".toml"),
      recipe.overrides));
  const Mesh truth = ALHAZEN_TRY(sim::Shape::make(scene.object)).truth();
  const Comparison off = ALHAZEN_TRY(compare(made.result.mesh, truth, {}, context.run));
  ALHAZEN_TRY(write_mesh(made.result.mesh, context.out / (std::string(name) + ".ply")));
  Row row{{"experiment", name}};
  if (off.observed) put(row, "", *off.observed);
  put(row, "whole_", off.all);
  row["completeness_0_3mm_pct"] = 100 * off.completeness_0_3mm;
  row["coverage_1mm_pct"] = 100 * off.coverage_1mm;
  row["bias_um"] = kUmPerMm * off.bias_mm;
  if (off.observed_normals) row["normal_mean_deg"] = off.observed_normals->mean_deg;
  put_observed(row, made.result.mesh);
  row.update(bounds);
  row.update(made.figures);
  return std::vector<Row>{row};
}

ScanRecipe bunny(const Context& context, std::vector<std::string> displays) {
  ScanRecipe recipe;
  recipe.world = "bunny11";
  recipe.displays = std::move(displays);
  recipe.coding = Coding::gray_phase;
  recipe.overrides.object_mesh = context.data / "meshes/bunny00.off";
  recipe.overrides.object_size_mm = 80;
  recipe.overrides.object_up = "y";
  return recipe;
}

}  // namespace

void add_mirror_rows(std::vector<Experiment>& list) {
  list.push_back({"sphere_phase", "sphere of 25 mm, 2 displays, gray_phase, exact calibration",
                  [](const Context& context) {
                    return sphere(context, "sphere_phase", Coding::gray_phase,
                                  {{"thesis_rms_um", 20},
                                   {"thesis_p90_um", 30},
                                   {"must_rms_um", 2},
                                   {"must_p90_um", 3},
                                   {"aim_rms_um", 0.7},
                                   {"aim_p90_um", 1}});
                  }});
  list.push_back({"sphere_gray", "the same by Gray code alone", [](const Context& context) {
                    return sphere(context, "sphere_gray", Coding::gray,
                                  {{"thesis_rms_um", 20},
                                   {"thesis_p90_um", 30},
                                   {"must_rms_um", 4},
                                   {"must_p90_um", 6},
                                   {"aim_rms_um", 2},
                                   {"aim_p90_um", 3}});
                  }});
  list.push_back(
      {"densities", "the three densities of votes on sphere_gray's light maps", densities});
  const Row bunny_bounds = {
      {"must_rms_um", 5}, {"must_p99_um", 15}, {"aim_rms_um", 2.5}, {"aim_p99_um", 8}};
  list.push_back(
      {"bunny_2", "Stanford bunny of 80 mm, 2 displays, gray_phase",
       [bunny_bounds](const Context& context) {
         return object(context, "bunny_2", bunny(context, {"side", "tablet"}), bunny_bounds);
       }});
  list.push_back(
      {"bunny_3", "the same, 3 displays, 792 light maps", [bunny_bounds](const Context& context) {
         Row bounds = bunny_bounds;
         bounds.update({{"must_completeness_0_3mm_pct", 60},
                        {"aim_completeness_0_3mm_pct", 80},
                        {"thesis_time_s", 43200},
                        {"must_time_s", 90},
                        {"aim_time_s", 40},
                        {"must_peak_mib", 4096}});
         return object(context, "bunny_3", bunny(context, {}), bounds);
       }});
}

}  // namespace alhazen::experiment
