#include <cstdio>
#include <nlohmann/json.hpp>

#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/report/compare.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {
namespace {

nlohmann::ordered_json to_json(const DistanceFigures& figures) {
  return {{"count", figures.count},
          {"rms_mm", figures.rms_mm},
          {"p90_mm", figures.p90_mm},
          {"p99_mm", figures.p99_mm},
          {"max_mm", figures.max_mm}};
}

void print(const char* name, const DistanceFigures& figures) {
  std::printf("%-22s %9zu  %9.4f %9.4f %9.4f %9.4f\n", name, figures.count, figures.rms_mm,
              figures.p90_mm, figures.p99_mm, figures.max_mm);
}

void print_head() {
  std::printf("%-22s %9s  %9s %9s %9s %9s\n", "distances in mm", "points", "RMS", "90 %", "99 %",
              "max");
}

Status compare_with_sphere(const Mesh& mesh, double radius_mm, bool as_json) {
  const SphereComparison comparison = ALHAZEN_TRY(compare_sphere(mesh, radius_mm));
  const auto centre = [](const SphereFit& fit) {
    return nlohmann::ordered_json{fit.centre_mm.x(), fit.centre_mm.y(), fit.centre_mm.z()};
  };
  if (as_json) {
    nlohmann::ordered_json json{{"radius_mm", radius_mm},
                                {"all", to_json(comparison.all.distances)},
                                {"all_centre_mm", centre(comparison.all)}};
    if (comparison.observed) {
      json["observed"] = to_json(comparison.observed->distances);
      json["observed_centre_mm"] = centre(*comparison.observed);
    }
    std::printf("%s\n", json.dump().c_str());
    return {};
  }
  print_head();
  if (comparison.observed) print("observed to sphere", comparison.observed->distances);
  print("all to sphere", comparison.all.distances);
  const Eigen::Vector3d& c =
      (comparison.observed ? *comparison.observed : comparison.all).centre_mm;
  std::printf("centre at (%.4f, %.4f, %.4f) mm\n", c.x(), c.y(), c.z());
  return {};
}

}  // namespace

Status compare_meshes(const CompareArgs& args, const Run& run) {
  if (args.reference.empty() && !args.sphere_radius_mm)
    return Error{Code::invalid, "compare needs a REFERENCE or --sphere-radius-mm"};
  const Mesh mesh = ALHAZEN_TRY(read_mesh(args.mesh));
  if (args.sphere_radius_mm) return compare_with_sphere(mesh, *args.sphere_radius_mm, args.as_json);
  const Mesh reference = ALHAZEN_TRY(read_mesh(args.reference));
  const Comparison comparison = ALHAZEN_TRY(compare(mesh, reference, {}, run));
  if (args.as_json) {
    nlohmann::ordered_json json;
    if (comparison.observed) {
      json["observed"] = to_json(*comparison.observed);
      json["bias_mm"] = comparison.bias_mm;
    }
    json["all"] = to_json(comparison.all);
    json["reference_to_mesh"] = to_json(comparison.reference_to_mesh);
    json["hausdorff_mm"] = comparison.hausdorff_mm;
    json["completeness_0_3mm"] = comparison.completeness_0_3mm;
    json["coverage_1mm"] = comparison.coverage_1mm;
    if (comparison.observed_normals) {
      json["normal_mean_deg"] = comparison.observed_normals->mean_deg;
      json["normal_p90_deg"] = comparison.observed_normals->p90_deg;
    }
    std::printf("%s\n", json.dump().c_str());
    return {};
  }
  print_head();
  if (comparison.observed) print("observed to reference", *comparison.observed);
  print("all to reference", comparison.all);
  print("reference to mesh", comparison.reference_to_mesh);
  std::printf(
      "Hausdorff distance     %.4f mm, mean signed distance of observed vertices %+.4f mm\n",
      comparison.hausdorff_mm, comparison.bias_mm);
  std::printf("reference within 0.3 mm of observed triangles  %5.1f %%\n",
              100 * comparison.completeness_0_3mm);
  std::printf("reference within 1 mm of the closed mesh       %5.1f %%\n",
              100 * comparison.coverage_1mm);
  if (comparison.observed_normals)
    std::printf("normals of observed vertices: mean %.2f deg, 90 %% %.2f deg\n",
                comparison.observed_normals->mean_deg, comparison.observed_normals->p90_deg);
  return {};
}

}  // namespace alhazen
