#include "tests/experiment/mirror.h"

#include <cmath>
#include <fstream>
#include <system_error>
#include <utility>

#include "drivers/sim/shape.h"
#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/report/report.h"
#include "reconstruct/stage_time.h"

namespace alhazen::experiment {
namespace {

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

}  // namespace

Result<Reconstruction> with_maps(const Context& context, const Scan& scan, const Rig& rig,
                                 int level, const Options& options, const Selection& selection) {
  Reconstruction work =
      ALHAZEN_TRY(Reconstruction::make(rig, scan.manifest().volume, level, options));
  const std::vector<StackKey> keys = ALHAZEN_TRY(scan.light_maps());
  for (const StackKey& key : keys) {
    if (context.run.stopped()) return Error{Code::cancelled, "interrupted"};
    if (selection && !selection(key)) continue;
    LightMap map = ALHAZEN_TRY(scan.load_light_map(key));
    const DisplayModel& display = *rig.display(key.display);
    scatter_outliers(map, kOutlierShare, kSeed, display.width_px, display.height_px);
    ALHAZEN_TRY(work.add(map));
  }
  return work;
}

Result<Measured> measure(const Context& context, const Scan& scan, const Rig& rig, int level,
                         const Options& options, const Selection& selection) {
  forget_peak();
  const StageClock clock;
  Reconstruction work = ALHAZEN_TRY(with_maps(context, scan, rig, level, options, selection));
  const StageClock last;
  Measured made{ALHAZEN_TRY(work.finish(context.run)), {}};
  const StageTime after = last.read("after"), time = clock.read("all");
  made.figures = {{"light_maps", made.result.light_maps},
                  {"level", level},
                  {"voxel_mm", scan.manifest().volume.edge_mm / (1 << level)},
                  {"outlier_share", kOutlierShare},
                  {"seed", kSeed},
                  {"leaves", made.result.octree.size()},
                  {"time_s", time.cpu_s / 2},
                  {"wall_s", time.wall_s},
                  {"after_last_map_s", after.cpu_s / 2},
                  {"after_last_map_wall_s", after.wall_s},
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

Result<Mesh> truth_of(const ScanRecipe& recipe) {
  const sim::Scene scene = ALHAZEN_TRY(sim::Scene::load(
      std::filesystem::path(ALHAZEN_SOURCE_DIR) / "config/worlds" / (recipe.world + ".toml"),
      recipe.overrides));
  return ALHAZEN_TRY(sim::Shape::make(scene.object)).truth();
}

Result<Comparison> write_page(const Context& context, const std::string& name, const Scan& scan,
                              const Reconstructed& made, const Mesh& truth) {
  const std::filesystem::path folder = context.out / name;
  std::error_code failed;
  std::filesystem::create_directories(folder, failed);
  if (failed) return Error{Code::unavailable, folder.string() + ": " + failed.message()};
  // Nobody captured anything: pictures were decoded as they were drawn.
  Report report = ALHAZEN_TRY(make_report(scan, made, CaptureFigures{}, &truth, context.run));
  report.reference = "the true surface";
  ALHAZEN_TRY(write_mesh(made.mesh, folder / "mesh.ply"));
  ALHAZEN_TRY(write_report(report, made.mesh, folder));
  return *std::move(report.comparison);
}

Result<ObjectRow> object_row(const Context& context, const char* name, const ScanRecipe& recipe,
                             const Row& bounds, const Selection& selection) {
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, recipe, context.run));
  Measured made =
      ALHAZEN_TRY(measure(context, scan, scan.rig(), recipe.level, Options{}, selection));
  Mesh truth = ALHAZEN_TRY(truth_of(recipe));
  const Comparison off = ALHAZEN_TRY(write_page(context, name, scan, made.result, truth));
  Row row{{"experiment", name}};
  if (off.observed) put(row, "", *off.observed);
  put(row, "whole_", off.all);
  row["completeness_0_3mm_pct"] = 100 * off.completeness_0_3mm;
  row["coverage_1mm_pct"] = 100 * off.coverage_1mm;
  row["bias_um"] = kUmPerMm * off.bias_mm;
  if (off.observed_normals) row["normal_mean_deg"] = off.observed_normals->mean_deg;
  put_observed(row, made.result.mesh);
  row["warnings"] = made.result.warnings;
  row.update(bounds);
  row.update(made.figures);
  return ObjectRow{std::move(row), std::move(made), std::move(truth)};
}

ScanRecipe mesh_recipe(const Context& context, const char* file, const char* up) {
  ScanRecipe recipe;
  recipe.world = "bunny11";
  recipe.coding = Coding::gray_phase;
  recipe.overrides.object_mesh = context.data / "meshes" / file;
  recipe.overrides.object_size_mm = 80;
  recipe.overrides.object_up = up;
  return recipe;
}

}  // namespace alhazen::experiment
