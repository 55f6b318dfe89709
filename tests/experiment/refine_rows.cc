// The row of a wrong calibration: a sphere reconstructed with it and after its refinement from the
// scan's own reflections.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>

#include "drivers/sim/calibrated_rig.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/refine/rig_shift.h"
#include "reconstruct/report/compare.h"
#include "reconstruct/stage_time.h"
#include "tests/experiment/mirror.h"

namespace alhazen::experiment {
namespace {

constexpr double kMradPerRad = 1000;
constexpr double kRadiusMm = 25;
constexpr int kSeeds = 3;
/// The errors of a good calibration, as tools/demo draws them.
constexpr sim::CalibrationError kError{.camera_px = 0.05,
                                       .display_mm = 0.1,
                                       .display_rad = 0.02 * std::numbers::pi / 180,
                                       .axis_mm = 0.005};
/// The first pass of a refinement, as `alhazen-reconstruct run --refine` takes it.
constexpr int kFirstLevel = 8;

/// RMS over cameras of how far the object's middle is seen from where it is in truth, px, once the
/// rig is in the truth's frame.
double camera_error_px(const Rig& rig, const Rig& truth, const Eigen::Vector3d& p) {
  const Pose rig_from_truth = fit_of_centres(truth, rig);
  double sum2 = 0;
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    const auto seen = rig.cameras[i].project(rig.cameras[i].camera_from_rig * (rig_from_truth * p));
    const auto is = truth.cameras[i].project(truth.cameras[i].camera_from_rig * p);
    if (seen && is) sum2 += (*seen - *is).squaredNorm() / 2;
  }
  return std::sqrt(sum2 / static_cast<double>(rig.cameras.size()));
}

/// RMS and 90 % of the observed vertices by the protocol of a sphere, which no rigid motion of the
/// rig changes.
Status put_sphere(Row& row, const std::string& prefix, const Mesh& mesh) {
  const SphereComparison off = ALHAZEN_TRY(compare_sphere(mesh, kRadiusMm));
  if (!off.observed) return Error{Code::invalid, "nothing was observed"};
  row[prefix + "rms_um"] = kUmPerMm * off.observed->distances.rms_mm;
  row[prefix + "p90_um"] = kUmPerMm * off.observed->distances.p90_mm;
  row[prefix + "whole_rms_um"] = kUmPerMm * off.all.distances.rms_mm;
  return {};
}

Result<Row> refined_once(const Context& context, const Scan& scan, int level, std::uint64_t seed) {
  sim::CalibrationError error = kError;
  error.seed = seed;
  const sim::Scene scene = ALHAZEN_TRY(
      sim::Scene::load(std::filesystem::path(ALHAZEN_SOURCE_DIR) / "config/worlds/sphere.toml"));
  const Rig& truth = scan.rig();
  const Rig wrong = ALHAZEN_TRY(Rig::parse(sim::calibrated_rig(scene, error)));
  Row row{{"experiment", "sphere_refined"}, {"seed", seed}, {"level", level}};
  Rig rig = wrong;
  {
    Reconstruction first =
        ALHAZEN_TRY(with_maps(context, scan, wrong, std::min(level, kFirstLevel)));
    const Reconstructed made = ALHAZEN_TRY(first.finish(context.run));
    const StageClock clock;
    const RefinedRig refined = ALHAZEN_TRY(first.refine(made.mesh, context.run));
    row["refine_cpu_s"] = clock.read("refine").cpu_s;
    row["is_accepted"] = refined.how.is_accepted;
    if (!refined.how.is_accepted) row["refusal"] = refined.how.refusal;
    row["iterations"] = refined.how.iterations;
    row["points_used"] = refined.how.used_before.points;
    row["points_held_out"] = refined.how.held_out_before.points;
    for (const auto& [name, residual] : {std::pair{"used_before", &refined.how.used_before},
                                         {"used_after", &refined.how.used_after},
                                         {"held_out_before", &refined.how.held_out_before},
                                         {"held_out_after", &refined.how.held_out_after}})
      row[std::string(name) + "_mrad"] = kMradPerRad * residual->median_rad;
    const Eigen::Vector3d middle = scan.manifest().volume.centre_mm;
    row["before_camera_px"] = camera_error_px(wrong, truth, middle);
    row["after_camera_px"] = camera_error_px(refined.rig, truth, middle);
    rig = refined.rig;
    if (level <= kFirstLevel) ALHAZEN_TRY(put_sphere(row, "before_", made.mesh));
  }
  if (level > kFirstLevel) {
    Reconstruction before = ALHAZEN_TRY(with_maps(context, scan, wrong, level));
    ALHAZEN_TRY(put_sphere(row, "before_", ALHAZEN_TRY(before.finish(context.run)).mesh));
  }
  Reconstruction after = ALHAZEN_TRY(with_maps(context, scan, rig, level));
  ALHAZEN_TRY(put_sphere(row, "", ALHAZEN_TRY(after.finish(context.run)).mesh));
  row.update({{"must_before_rms_um", 8},
              {"aim_before_rms_um", 5},
              {"must_rms_um", 4},
              {"aim_rms_um", 2.5}});
  return row;
}

Result<std::vector<Row>> sphere_refined(const Context& context) {
  ScanRecipe recipe;
  recipe.world = "sphere";
  recipe.coding = Coding::gray_phase;
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, recipe, context.run));
  std::vector<Row> rows;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed)
    rows.push_back(ALHAZEN_TRY(refined_once(context, scan, recipe.level, seed)));
  return rows;
}

}  // namespace

void add_refine_rows(std::vector<Experiment>& list) {
  list.push_back({"sphere_refined",
                  "sphere with camera 0.05 px, display 0.1 mm + 0.02 deg, axis 5 um errors, before "
                  "and after refinement; three seeds",
                  sphere_refined});
}

}  // namespace alhazen::experiment
