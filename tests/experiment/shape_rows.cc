// Rows of shapes that are hard: pits in which light bounces twice, sharp edges, thin parts.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include "drivers/sim/shape.h"
#include "reconstruct/report/triangle_tree.h"
#include "tests/experiment/mirror.h"

namespace alhazen::experiment {
namespace {

using Eigen::Vector3d;

/// Middles of the edges at which two triangles turn by more than `least_rad`.
std::vector<Vector3d> creases(const Mesh& mesh, double least_rad) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, Vector3d> normal_at;
  std::vector<Vector3d> out;
  for (const auto& triangle : mesh.triangles) {
    const auto at = [&](int k) {
      return Vector3d(mesh.vertices_mm[triangle[static_cast<std::size_t>(k)]].cast<double>());
    };
    const Vector3d normal = (at(1) - at(0)).cross(at(2) - at(0)).normalized();
    for (int k = 0; k < 3; ++k) {
      const std::uint32_t a = triangle[static_cast<std::size_t>(k)],
                          b = triangle[static_cast<std::size_t>((k + 1) % 3)];
      const auto [other, is_first] = normal_at.try_emplace(std::minmax(a, b), normal);
      if (!is_first && other->second.dot(normal) < std::cos(least_rad)) {
        out.push_back((at(k) + at((k + 1) % 3)) / 2);
      }
    }
  }
  return out;
}

/// How far the truth's sharp edges are from the mesh, where it was observed beside them: a rounded
/// edge leaves a gap.
void put_edges(Row& row, const ObjectRow& object) {
  constexpr double kCreaseRad = 0.5, kBesideMm = 1;
  const Mesh& mesh = object.measured.result.mesh;
  std::vector<std::uint32_t> observed;
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& triangle = mesh.triangles[t];
    if (std::ranges::all_of(triangle, [&](auto v) { return mesh.observed[v] != 0; })) {
      observed.push_back(t);
    }
  }
  const TriangleTree all(mesh), seen(mesh, observed);
  std::vector<double> gaps_mm;
  const std::vector<Vector3d> points = creases(object.truth, kCreaseRad);
  for (const Vector3d& p : points) {
    if (!seen.nearest(p, kBesideMm)) continue;
    gaps_mm.push_back(all.nearest(p)->distance_mm);
  }
  row["crease_points"] = points.size();
  row["crease_points_beside_observed"] = gaps_mm.size();
  if (gaps_mm.empty()) return;
  std::ranges::sort(gaps_mm);
  const double voxel_mm = object.measured.figures["voxel_mm"];
  const auto at = [&](double share) {
    return gaps_mm[static_cast<std::size_t>(share * static_cast<double>(gaps_mm.size() - 1))] /
           voxel_mm;
  };
  row["crease_median_voxels"] = at(0.5);
  row["crease_p90_voxels"] = at(0.9);
  const auto within = std::ranges::count_if(gaps_mm, [&](double gap) { return gap <= voxel_mm; });
  row["crease_within_voxel_pct"] =
      100 * static_cast<double>(within) / static_cast<double>(gaps_mm.size());
}

Result<std::vector<Row>> sharp_or_thin(const Context& context, const char* name, const char* file) {
  ObjectRow object = ALHAZEN_TRY(object_row(context, name, mesh_recipe(context, file, "y"), {}));
  put_edges(object.row, object);
  return std::vector<Row>{std::move(object.row)};
}

/// What the pixels of a scan saw by two reflections or more, and how many of them the surface that
/// came out does not believe: their hypothesis there is farther from its normal than depths take.
struct SecondBounces {
  std::atomic<std::size_t> pixels = 0, labelled = 0, disbelieved = 0;
};

Status count_bounces(const Context& context, const Scan& scan, const sim::Shape& shape,
                     const Mesh& mesh, SecondBounces& out) {
  constexpr int kStride = 5;  // pixels of each map that are traced, both ways
  constexpr double kNearMm = 0.5;
  const double cone_rad = DepthOptions{}.cone_rad;
  const TriangleTree tree(mesh);
  const std::vector<StackKey> keys = ALHAZEN_TRY(scan.light_maps());
  std::vector<Status> outcomes(keys.size());
  tbb::parallel_for(std::size_t{0}, keys.size(), [&](std::size_t k) {
    const auto loaded = scan.load_light_map(keys[k]);
    if (!loaded) {
      outcomes[k] = loaded.error();
      return;
    }
    const LightMap& map = *loaded;
    const Rig& rig = scan.rig();
    const CameraModel& camera = *rig.camera(map.key.camera);
    const DisplayModel& display = *rig.display(map.key.display);
    const Pose object_from_rig = rig.turntable.rig_from_object(map.angle_rad).inverse();
    const Pose object_from_camera = object_from_rig * camera.camera_from_rig.inverse();
    for (int y = 0; y < map.region.height; y += kStride) {
      for (int x = 0; x < map.region.width; x += kStride) {
        const std::size_t i =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(map.region.width) +
            static_cast<std::size_t>(x);
        if (map.label[i] == Label::none || map.label[i] == Label::direct_sight) continue;
        const sim::SightLine look{
            object_from_camera.translation_mm,
            object_from_camera.rotation *
                camera.direction(Eigen::Vector2d(map.region.x + x, map.region.y + y))};
        sim::SurfaceHit first;
        shape.intersect({&look, 1}, {&first, 1});
        if (!std::isfinite(first.distance_mm)) continue;
        const sim::SightLine away{
            first.point_mm, look.direction - 2 * look.direction.dot(first.normal) * first.normal};
        sim::SurfaceHit second;
        shape.intersect({&away, 1}, {&second, 1});
        if (!std::isfinite(second.distance_mm)) continue;
        ++out.pixels;
        if (!map.is_position(i)) {
          ++out.labelled;
          continue;
        }
        const auto foot = tree.nearest(first.point_mm, kNearMm);
        const auto& triangle = foot ? mesh.triangles[foot->triangle] : mesh.triangles.front();
        Vector3d normal = Vector3d::Zero();
        for (int c = 0; c < 3 && foot; ++c) {
          normal +=
              foot->weights[c] * mesh.normals[triangle[static_cast<std::size_t>(c)]].cast<double>();
        }
        const Vector3d light =
            (object_from_rig * display.point_mm(map.u_px[i], map.v_px[i]) - first.point_mm)
                .normalized();
        const Vector3d hypothesis = (light - look.direction).normalized();
        const double off_rad =
            std::acos(std::clamp(hypothesis.dot(normal.normalized()), -1.0, 1.0));
        if (!foot || !(off_rad < cone_rad)) ++out.disbelieved;
      }
    }
  });
  for (const Status& outcome : outcomes) ALHAZEN_TRY(outcome);
  return context.run.stopped() ? Status(Error{Code::cancelled, "interrupted"}) : Status{};
}

Result<std::vector<Row>> pits(const Context& context) {
  ScanRecipe recipe;
  recipe.world = "pits11";
  recipe.coding = Coding::gray_phase;
  recipe.level = 8;
  const Row bounds = {{"must_at_least_second_bounces_recognised_pct", 90},
                      {"aim_at_least_second_bounces_recognised_pct", 99}};
  ObjectRow object = ALHAZEN_TRY(object_row(context, "pits", recipe, bounds));
  const sim::Scene scene = ALHAZEN_TRY(sim::Scene::load(
      std::filesystem::path(ALHAZEN_SOURCE_DIR) / "config/worlds/pits11.toml", {}));
  const sim::ObjectTruth& block = scene.object;
  const Mesh& mesh = object.measured.result.mesh;
  const TriangleTree truth(object.truth);
  std::vector<Row> rows;
  for (int pit = 0; pit < block.pit_count; ++pit) {
    // Vertices over the pit's opening, floor and walls; the plane around does not count.
    const double spacing_mm = block.block_mm.x() / block.pit_count;
    const Vector3d middle(-block.block_mm.x() / 2 + (pit + 0.5) * spacing_mm, 0, 0);
    double sum2 = 0, floor_sum2 = 0;
    std::size_t count = 0, observed = 0, floor = 0, floor_observed = 0;
    for (std::size_t v = 0; v < mesh.vertices_mm.size(); ++v) {
      const Vector3d p = mesh.vertices_mm[v].cast<double>();
      const double from_middle_mm = (p - middle).head<2>().norm();
      if (from_middle_mm > block.pit_radius_mm || p.z() < block.block_mm.z() / 4) continue;
      const bool is_floor = from_middle_mm < block.pit_radius_mm / 4;
      ++count;
      if (is_floor) ++floor;
      if (mesh.observed[v] == 0) continue;
      const double d = truth.nearest(p)->distance_mm;
      ++observed;
      sum2 += d * d;
      if (is_floor) {
        ++floor_observed;
        floor_sum2 += d * d;
      }
    }
    Row row{{"experiment", "pit_" + std::to_string(pit + 1)},
            {"depth_mm", block.pit_depth_max_mm * (pit + 1) / block.pit_count},
            {"observed_share",
             count == 0 ? 0 : static_cast<double>(observed) / static_cast<double>(count)},
            {"floor_observed_share",
             floor == 0 ? 0 : static_cast<double>(floor_observed) / static_cast<double>(floor)}};
    if (observed > 0) row["rms_um"] = kUmPerMm * std::sqrt(sum2 / static_cast<double>(observed));
    if (floor_observed > 0) {
      row["floor_rms_um"] = kUmPerMm * std::sqrt(floor_sum2 / static_cast<double>(floor_observed));
    }
    row[pit == 0 ? "must_rms_um" : "aim_floor_rms_um"] = pit == 0 ? 10 : 20;
    rows.push_back(std::move(row));
  }
  SecondBounces bounces;
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, recipe, context.run));
  const sim::Shape shape = ALHAZEN_TRY(sim::Shape::make(block));
  ALHAZEN_TRY(count_bounces(context, scan, shape, mesh, bounces));
  object.row["second_bounce_pixels_traced"] = bounces.pixels.load();
  if (bounces.pixels > 0) {
    object.row["second_bounces_recognised_pct"] =
        100 * static_cast<double>(bounces.labelled + bounces.disbelieved) /
        static_cast<double>(bounces.pixels);
    object.row["second_bounces_without_position_pct"] =
        100 * static_cast<double>(bounces.labelled) / static_cast<double>(bounces.pixels);
  }
  rows.insert(rows.begin(), std::move(object.row));
  return rows;
}

}  // namespace

void add_shape_rows(std::vector<Experiment>& list) {
  list.push_back({"pits", "a block with pits of growing depth, 4 displays, level 8", pits});
  list.push_back({"fandisk", "flat faces and sharp edges, 3 displays", [](const Context& context) {
                    return sharp_or_thin(context, "fandisk", "fandisk.obj");
                  }});
  list.push_back({"armadillo", "thin parts, 3 displays", [](const Context& context) {
                    return sharp_or_thin(context, "armadillo", "armadillo.off");
                  }});
}

}  // namespace alhazen::experiment
