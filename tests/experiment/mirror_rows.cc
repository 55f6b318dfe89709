// Rows of objects that mirror: simulated light maps to a mesh, against the truth.
#include <string>
#include <utility>

#include "tests/experiment/mirror.h"

namespace alhazen::experiment {
namespace {

Result<std::vector<Row>> sphere(const Context& context, const char* name, Coding coding,
                                const Row& bounds) {
  ScanRecipe recipe;
  recipe.world = "sphere";
  recipe.coding = coding;
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, recipe, context.run));
  const Measured made = ALHAZEN_TRY(measure(context, scan, scan.rig(), recipe.level));
  const SphereComparison off = ALHAZEN_TRY(compare_sphere(made.result.mesh, 25));
  ALHAZEN_TRY(write_page(context, name, scan, made.result, ALHAZEN_TRY(truth_of(recipe))));
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
    const Measured made = ALHAZEN_TRY(measure(context, scan, scan.rig(), 8, options));
    const SphereComparison off = ALHAZEN_TRY(compare_sphere(made.result.mesh, 25));
    Row row{{"experiment", std::string("density_") + kind}};
    if (off.observed) put(row, "", off.observed->distances);
    put_observed(row, made.result.mesh);
    row.update(made.figures);
    rows.push_back(std::move(row));
  }
  return rows;
}

Result<std::vector<Row>> bunny(const Context& context, const char* name, const Row& bounds,
                               const Selection& selection) {
  const ScanRecipe recipe = mesh_recipe(context, "bunny00.off", "y");
  return std::vector<Row>{ALHAZEN_TRY(object_row(context, name, recipe, bounds, selection)).row};
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
  list.push_back({"bunny_2", "Stanford bunny of 80 mm, 2 displays, gray_phase",
                  [bunny_bounds](const Context& context) {
                    return bunny(context, "bunny_2", bunny_bounds,
                                 [](const StackKey& key) { return key.display != "above"; });
                  }});
  list.push_back(
      {"bunny_3", "the same, 3 displays, 792 light maps", [bunny_bounds](const Context& context) {
         Row bounds = bunny_bounds;
         bounds.update({{"must_at_least_completeness_0_3mm_pct", 60},
                        {"aim_at_least_completeness_0_3mm_pct", 80},
                        {"thesis_time_s", 43200},
                        {"must_time_s", 90},
                        {"aim_time_s", 40},
                        {"must_after_last_map_s", 40},
                        {"aim_after_last_map_s", 15},
                        {"must_peak_mib", 4096},
                        {"aim_peak_mib", 2048}});
         return bunny(context, "bunny_3", bounds, {});
       }});
}

}  // namespace alhazen::experiment
