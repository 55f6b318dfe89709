#include "tests/experiment/normals_rows.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <random>
#include <sstream>
#include <utility>

#include "reconstruct/mesh/clean.h"
#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/normals/normal_map_file.h"
#include "reconstruct/normals/photometric_stereo.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/report/compare.h"
#include "reconstruct/scan/image_file.h"
#include "reconstruct/scan/safe_file.h"
#include "reconstruct/stage_time.h"
#include "reconstruct/surface/normal_integration.h"
#include "tests/support/views.h"

namespace alhazen::experiment {
namespace {

using Eigen::Vector3d;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kDistance_mm = 650;

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

/// What a reconstruction from normal maps says about itself and against the truth.
Result<Row> figures_of(const std::string& name, const Reconstructed& made, const Mesh& truth,
                       const Run& run) {
  const Comparison found = ALHAZEN_TRY(compare(made.mesh, truth, {}, run));
  const double voxel_mm =
      made.octree.volume().edge_mm / static_cast<double>(1 << made.octree.finest_level());
  std::vector<double> observed, all;
  for (std::size_t i = 0; i < found.signed_mm.size(); ++i) {
    const double distance = std::abs(static_cast<double>(found.signed_mm[i]));
    all.push_back(distance);
    if (made.mesh.observed[i] != 0) observed.push_back(distance);
  }
  double cpu_s = 0, wall_s = 0;
  for (const StageTime& time : made.times) {
    cpu_s += time.cpu_s;
    wall_s += time.wall_s;
  }
  Row row{
      {"experiment", name},
      {"voxel_mm", voxel_mm},
      {"level", made.octree.finest_level()},
      {"normal_maps", made.normal_maps},
      {"vertices", made.mesh.vertices_mm.size()},
      {"closed", check_closed(made.mesh).closed()},
      {"observed_share", static_cast<double>(observed.size()) / static_cast<double>(all.size())},
      {"median_voxels", percentile(observed, 0.5) / voxel_mm},
      {"median_all_voxels", percentile(all, 0.5) / voxel_mm},
      {"median_mm", percentile(observed, 0.5)},
      {"p90_mm", percentile(observed, 0.9)},
      {"p99_mm", percentile(observed, 0.99)},
      {"p90_all_mm", found.all.p90_mm},
      {"rms_all_mm", found.all.rms_mm},
      {"bias_mm", found.bias_mm},
      {"completeness_0_3mm", found.completeness_0_3mm},
      {"coverage_1mm", found.coverage_1mm},
      {"reference_to_mesh_p90_mm", found.reference_to_mesh.p90_mm},
      {"half_cpu_s", cpu_s / 2},
      {"wall_s", wall_s}};
  if (found.observed) {
    row["rms_mm"] = found.observed->rms_mm;
    row["rms_voxels"] = found.observed->rms_mm / voxel_mm;
  }
  if (found.observed_normals) {
    row["mean_normal_deg"] = found.observed_normals->mean_deg;
    row["p90_normal_deg"] = found.observed_normals->p90_deg;
  }
  for (const StageTime& time : made.times) row["cpu_s"][time.stage] = time.cpu_s;
  return row;
}

Status keep(const Mesh& mesh, const std::filesystem::path& out, const std::string& name) {
  if (out.empty()) return {};
  std::error_code error;
  std::filesystem::create_directories(out, error);
  if (error) return Error{Code::unavailable, out.string() + ": " + error.message()};
  return write_mesh(mesh, out / (name + ".ply"));
}

/// Turns unit vectors by Gaussian angles about two axes across them.
void add_noise(NormalMap& map, double noise_rad, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> gauss(0, static_cast<float>(noise_rad));
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    if (map.label[i] != NormalLabel::object) continue;
    Eigen::Vector3f& n = map.normal[i];
    const Eigen::Vector3f a = n.unitOrthogonal(), b = n.cross(a);
    n = (n + gauss(random) * a + gauss(random) * b).normalized();
  }
  map.noise_rad = noise_rad;
}

}  // namespace

Result<Mesh> standing_mesh(const std::filesystem::path& file, double height_mm, bool y_is_up) {
  Mesh mesh = ALHAZEN_TRY(read_mesh(file));
  Vector3d low = Vector3d::Constant(1e30), high = -low;
  for (Vector3d& p : mesh.vertices_mm) {
    if (y_is_up) p = Vector3d(p.x(), -p.z(), p.y());
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double scale = height_mm / (high.z() - low.z());
  const Volume volume;
  const Vector3d middle = (low + high) / 2;
  for (Vector3d& p : mesh.vertices_mm) p = volume.centre_mm + scale * (p - middle);
  set_normals(mesh);
  return mesh;
}

Result<Rows> normals_of_mesh(const std::string& name, const Mesh& mesh, const NormalViews& views,
                             const Options& options, const std::filesystem::path& out,
                             const Run& run) {
  const Volume volume;
  std::vector<double> elevations;
  for (const double deg : views.elevations_deg) elevations.push_back(deg * kDegree);
  // The whole volume fits on the sensor.
  const int sensor_px = static_cast<int>(1.8 * volume.edge_mm / views.pixel_mm);
  const Rig rig =
      views::ring_of_cameras(elevations, kDistance_mm, views.pixel_mm, sensor_px, volume.centre_mm);
  Reconstruction reconstruction =
      ALHAZEN_TRY(Reconstruction::make(rig, volume, views.level, options));
  const views::Target target(mesh);
  for (int stop = 0; stop < views.stops; ++stop) {
    for (const CameraModel& camera : rig.cameras) {
      if (run.stopped()) return Error{Code::cancelled, "interrupted"};
      NormalMap map = views::render_normals(target, rig, {stop, camera.name},
                                            stop * 2 * std::numbers::pi / views.stops);
      if (views.noise_rad > 0) {
        add_noise(map, views.noise_rad, static_cast<std::uint32_t>(1000 + stop));
      }
      ALHAZEN_TRY(check_facing(map, camera));
      ALHAZEN_TRY(reconstruction.add(map));
    }
  }
  const Reconstructed made = ALHAZEN_TRY(reconstruction.finish(run));
  ALHAZEN_TRY(keep(made.mesh, out, name));
  Row row = ALHAZEN_TRY(figures_of(name, made, mesh, run));
  row["pixel_mm"] = views.pixel_mm;
  return Rows{row};
}

Result<Rows> buddha_normals(const std::filesystem::path& data, const std::filesystem::path& out,
                            const Run& run) {
  const Mesh mesh = ALHAZEN_TRY(standing_mesh(data / "meshes" / "buddha_100k.obj", 92, true));
  NormalViews views;
  views.elevations_deg = {-30, 0, 25, 50, 78};
  Rows rows = ALHAZEN_TRY(
      normals_of_mesh("buddha_normals", mesh, views, Options::for_normal_maps(), out, run));
  rows[0]["must_median_voxels"] = 0.2;
  rows[0]["aim_median_voxels"] = 0.1;
  rows[0]["must_mean_normal_deg"] = 3;
  rows[0]["aim_mean_normal_deg"] = 1.5;
  return rows;
}

namespace {

/// A set of ps_uw: pictures under twelve lights, lights.txt.
struct PsSet {
  LightStack stack;
  std::vector<Vector3d> truth;  ///< of a ball by its outline; empty otherwise
};

Result<std::vector<float>> read_linear(const std::filesystem::path& file, int& width, int& height) {
  const Image image = ALHAZEN_TRY(read_image(file));
  width = image.width();
  height = image.height();
  std::vector<float> values;
  for (const std::uint8_t value : image.mono8()) values.push_back(static_cast<float>(value) / 255);
  return values;
}

Result<std::vector<Light>> read_lights(const std::filesystem::path& file) {
  const std::string text = ALHAZEN_TRY(read_file(file, 1 << 20));
  std::istringstream stream(text);
  std::size_t count = 0;
  stream >> count;
  std::vector<Light> lights(std::min<std::size_t>(count, 1000));
  // x right, y up, z to the viewer.
  for (Light& light : lights) {
    stream >> light.vector.x() >> light.vector.y() >> light.vector.z();
    light.vector.y() *= -1;
    light.vector.z() *= -1;
  }
  if (!stream) return Error{Code::corrupt, "'" + file.string() + "' ends early"};
  return lights;
}

Result<PsSet> read_set(const std::filesystem::path& folder, const std::string& name,
                       const std::vector<Light>& lights, bool is_ball) {
  PsSet set;
  set.stack.lights = lights;
  int width = 0, height = 0;
  for (std::size_t k = 0; k < lights.size(); ++k) {
    set.stack.intensity.push_back(ALHAZEN_TRY(
        read_linear(folder / name / (name + "." + std::to_string(k) + ".png"), width, height)));
  }
  set.stack.width = width;
  set.stack.height = height;
  const std::vector<float> mask =
      ALHAZEN_TRY(read_linear(folder / name / (name + ".mask.png"), width, height));
  double area = 0;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  for (std::size_t i = 0; i < mask.size(); ++i) {
    set.stack.mask.push_back(mask[i] >= 0.5F ? 1 : 0);
    if (set.stack.mask.back() == 0) continue;
    area += 1;
    const std::size_t row = i / static_cast<std::size_t>(width);
    centre += Eigen::Vector2d(static_cast<double>(i % static_cast<std::size_t>(width)),
                              static_cast<double>(row));
  }
  if (!is_ball) return set;
  centre /= area;
  const double radius = std::sqrt(area / std::numbers::pi);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    const std::size_t row = i / static_cast<std::size_t>(width);
    const Eigen::Vector2d off =
        (Eigen::Vector2d(static_cast<double>(i % static_cast<std::size_t>(width)),
                         static_cast<double>(row)) -
         centre) /
        radius;
    const double inside = 1 - off.squaredNorm();
    set.truth.push_back(inside > 0 ? Vector3d(off.x(), off.y(), -std::sqrt(inside))
                                   : Vector3d(Vector3d::Zero()));
  }
  return set;
}

Row stereo_figures(const std::string& name, const PsSet& set, const StereoMap& found) {
  std::vector<double> error, residual, lights;
  std::size_t object = 0, unknown = 0;
  for (std::size_t i = 0; i < found.map.size_px(); ++i) {
    if (set.stack.mask[i] == 0) continue;
    ++object;
    if (found.map.label[i] != NormalLabel::object) {
      ++unknown;
      continue;
    }
    residual.push_back(static_cast<double>(found.residual[i]));
    lights.push_back(found.lights[i]);
    if (set.truth.empty() || set.truth[i].isZero()) continue;
    const Vector3d n = found.map.normal[i].cast<double>();
    error.push_back(std::atan2(n.cross(set.truth[i]).norm(), n.dot(set.truth[i])) / kDegree);
  }
  Row row{{"experiment", name},
          {"pixels", object},
          {"unknown_share", static_cast<double>(unknown) / static_cast<double>(object)},
          {"median_residual", percentile(residual, 0.5)},
          {"median_lights", percentile(lights, 0.5)},
          {"noise_deg", found.map.noise_rad / kDegree}};
  if (!error.empty()) {
    row["mean_deg"] = mean_of(error);
    row["median_deg"] = percentile(error, 0.5);
    row["p90_deg"] = percentile(error, 0.9);
  }
  return row;
}

}  // namespace

Result<Rows> real_photometric_stereo(const std::filesystem::path& data,
                                     const std::vector<std::string>& sets,
                                     const std::filesystem::path& out, const Run& run) {
  const std::filesystem::path folder = data / "ps_uw";
  const std::vector<Light> given = ALHAZEN_TRY(read_lights(folder / "lights.txt"));
  const PsSet chrome = ALHAZEN_TRY(read_set(folder, "chrome", given, true));
  const std::vector<Light> from_ball = ALHAZEN_TRY(lights_of_mirror_ball(
      chrome.stack.width, chrome.stack.height, chrome.stack.intensity, chrome.stack.mask));
  Rows rows;
  struct Way {
    const char* name;
    const std::vector<Light>& lights;
    int rounds;
    double dark_share, bright_share;
  };
  // The figure that counts is that of our own way, fixed beforehand; the others are for comparison.
  const StereoOptions ours;
  const Way ways[] = {
      {"", given, ours.rounds, ours.dark_share, ours.bright_share},
      {", plain", given, 0, 0, 0},
      {", lights of the mirror ball", from_ball, ours.rounds, ours.dark_share, ours.bright_share}};
  for (const std::string& name : sets) {
    const bool is_ball = name == "gray";
    for (const Way& way : ways) {
      const PsSet set = ALHAZEN_TRY(read_set(folder, name, way.lights, is_ball));
      StereoOptions options;
      options.rounds = way.rounds;
      options.dark_share = way.dark_share;
      options.bright_share = way.bright_share;
      const StereoMap found = ALHAZEN_TRY(photometric_stereo(set.stack, options, run));
      Row row = stereo_figures("photometric_stereo " + name + way.name, set, found);
      const bool is_ours = &way == &ways[0];
      if (is_ball && is_ours) {
        row["must_mean_deg"] = 5.0;
        row["aim_mean_deg"] = 4.0;
      }
      rows.push_back(row);
      if (out.empty() || !is_ours) continue;
      std::error_code error;
      std::filesystem::create_directories(out, error);
      ALHAZEN_TRY(write_normal_map(found.map, out / ("ps_" + name + ".png")));
    }
  }
  return rows;
}

namespace {

/// A closed sphere of triangles, each split in four `times` times.
Mesh icosphere(int times) {
  Mesh mesh;
  const double t = (1 + std::sqrt(5.0)) / 2;
  for (const double a : {-1.0, 1.0}) {
    for (const double b : {-t, t}) {
      mesh.vertices_mm.emplace_back(a, b, 0);
      mesh.vertices_mm.emplace_back(0, a, b);
      mesh.vertices_mm.emplace_back(b, 0, a);
    }
  }
  // Faces of the icosahedron: triples of vertices at the shortest distance, 2.
  const auto near = [&](std::size_t i, std::size_t j) {
    return std::abs((mesh.vertices_mm[i] - mesh.vertices_mm[j]).norm() - 2) < 1e-9;
  };
  for (std::uint32_t i = 0; i < 12; ++i) {
    for (std::uint32_t j = i + 1; j < 12; ++j) {
      for (std::uint32_t k = j + 1; k < 12; ++k) {
        if (!near(i, j) || !near(j, k) || !near(i, k)) continue;
        const Vector3d &a = mesh.vertices_mm[i], &b = mesh.vertices_mm[j], &c = mesh.vertices_mm[k];
        if ((b - a).cross(c - a).dot(a) > 0) {
          mesh.triangles.push_back({i, j, k});
        } else {
          mesh.triangles.push_back({i, k, j});
        }
      }
    }
  }
  for (Vector3d& p : mesh.vertices_mm) p.normalize();
  for (int round = 0; round < times; ++round) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middle;
    const auto between = [&](std::uint32_t a, std::uint32_t b) {
      const auto [place, is_new] = middle.try_emplace(
          std::minmax(a, b), static_cast<std::uint32_t>(mesh.vertices_mm.size()));
      if (is_new) {
        mesh.vertices_mm.push_back((mesh.vertices_mm[a] + mesh.vertices_mm[b]).normalized());
      }
      return place->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    for (const auto& [a, b, c] : mesh.triangles) {
      const std::uint32_t ab = between(a, b), bc = between(b, c), ca = between(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
    }
    mesh.triangles = std::move(finer);
  }
  return mesh;
}

double bump(double x, double y, double x0, double y0, double sx, double sy) {
  const double a = (x - x0) / sx, b = (y - y0) / sy;
  return std::exp(-(a * a + b * b) / 2);
}

const Vector3d kMaskCentre_mm{0, 0, 48};

/// A face that looks up (+z), its forehead towards +y: an ellipsoid, flat at the back, with brow,
/// eyes, nose, cheeks, lips and chin.
Mesh clay_face() {
  Mesh mesh = icosphere(7);
  for (Vector3d& p : mesh.vertices_mm) {
    constexpr double kHalf_x = 31, kHalf_y = 40, kFront = 24, kBack = 12;
    const Vector3d u = p;
    const double depth = u.z() > 0 ? kFront : kBack;
    const double reach =
        1 / std::sqrt(u.x() * u.x() / (kHalf_x * kHalf_x) + u.y() * u.y() / (kHalf_y * kHalf_y) +
                      u.z() * u.z() / (depth * depth));
    p = reach * u;
    if (p.z() > 0) {
      const double x = p.x(), y = p.y();
      double rise = 0;
      rise += 7.0 * bump(x, y, 0, -4, 3.4, 5.5);  // nose
      rise += 4.5 * bump(x, y, 0, 5, 2.6, 7.0);   // its ridge
      rise += 2.2 * (bump(x, y, -4.5, -7, 2.2, 2.2) + bump(x, y, 4.5, -7, 2.2, 2.2));
      rise += 2.5 * (bump(x, y, -10, 15, 6, 2.6) + bump(x, y, 10, 15, 6, 2.6));  // brow
      rise -= 4.5 * (bump(x, y, -10.5, 8, 4.6, 3.4) + bump(x, y, 10.5, 8, 4.6, 3.4));
      rise += 3.2 * (bump(x, y, -10.5, 8, 2.6, 2.0) + bump(x, y, 10.5, 8, 2.6, 2.0));     // eyes
      rise += 2.5 * (bump(x, y, -15, -7, 5, 5) + bump(x, y, 15, -7, 5, 5));               // cheeks
      rise += 2.6 * bump(x, y, 0, -15, 6.0, 1.5) + 2.8 * bump(x, y, 0, -19.5, 5.0, 1.6);  // lips
      rise -= 1.2 * bump(x, y, 0, -17.2, 6.5, 0.9);
      rise += 3.5 * bump(x, y, 0, -28, 6, 4);  // chin
      // No step where front and back meet.
      const double fade = std::min(1.0, p.z() / 6);
      p += Vector3d(0, 0, rise * fade * fade * (3 - 2 * fade));
    }
    p += kMaskCentre_mm;
  }
  set_normals(mesh);
  return mesh;
}

/// Clay, with painted lips, brows and stripes on the cheeks: dark and glossy.
views::Paint clay_paint(const Vector3d& p_object_mm) {
  const Vector3d p = p_object_mm - kMaskCentre_mm;
  const double x = std::abs(p.x()), y = p.y();
  views::Paint paint{0.62, 0.0, 60};
  if (p.z() < 0) return paint;
  if (y < -13 && y > -21.5 && x < 9 - 0.12 * (y + 17) * (y + 17)) return {0.30, 0.25, 90};
  if (std::abs(y - 16 - 0.1 * x) < 1.6 && x > 4 && x < 17) return {0.12, 0.15, 40};
  if (x > 12 && x < 22 && y < 0 && y > -12 && std::fmod(x + 40, 4) < 2) return {0.40, 0.35, 120};
  return paint;
}

/// Even directions over the upper hemisphere from `least_deg` of elevation (Fibonacci's spiral).
std::vector<Vector3d> dome(std::size_t count, double least_deg) {
  std::vector<Vector3d> directions;
  const double low = std::sin(least_deg * kDegree);
  for (std::size_t i = 0; i < count; ++i) {
    const double z = low + (1 - low) * (static_cast<double>(i) + 0.5) / static_cast<double>(count);
    const double turn = static_cast<double>(i) * std::numbers::pi * (3 - std::sqrt(5.0));
    const double side = std::sqrt(1 - z * z);
    directions.emplace_back(side * std::cos(turn), side * std::sin(turn), z);
  }
  return directions;
}

}  // namespace

Result<Rows> clay_mask(int stops, const std::filesystem::path& out, const Run& run) {
  if (stops < 1 || stops > 360) return Error{Code::invalid, "stops must be in 1 to 360"};
  constexpr int kLevel = 8;
  constexpr double kPixel_mm = 0.3;
  constexpr std::size_t kLights = 198;
  const Mesh mesh = clay_face();
  const Volume volume;
  std::vector<double> elevations(11);
  for (std::size_t i = 0; i < elevations.size(); ++i) {
    elevations[i] = (5 + 8.0 * static_cast<double>(i)) * kDegree;
  }
  const Rig rig =
      views::ring_of_cameras(elevations, kDistance_mm, kPixel_mm, 512, volume.centre_mm);
  const std::vector<Vector3d> lights = dome(kLights, 8);
  Reconstruction reconstruction =
      ALHAZEN_TRY(Reconstruction::make(rig, volume, kLevel, Options::for_normal_maps()));
  const views::Target target(mesh);
  std::vector<double> errors, plain_errors, glossy_errors, noise;
  StereoOptions plain;
  plain.rounds = 0;
  plain.dark_share = plain.bright_share = 0;
  const StageClock clock;
  double stereo_cpu_s = 0;
  for (int stop = 0; stop < stops; ++stop) {
    // Two stops are a quarter turn apart, more are even.
    const double angle_rad =
        stops == 2 ? stop * std::numbers::pi / 2 : stop * 2 * std::numbers::pi / stops;
    for (const CameraModel& camera : rig.cameras) {
      if (run.stopped()) return Error{Code::cancelled, "interrupted"};
      views::ShadingOptions shading;
      shading.exposure = 1.1;
      const views::ShadedView view = views::render_shaded(target, rig, {stop, camera.name},
                                                          angle_rad, lights, clay_paint, shading);
      const StageClock stereo_clock;
      StereoMap found = ALHAZEN_TRY(photometric_stereo(view.stack, StereoOptions{}, run));
      stereo_cpu_s += stereo_clock.read("").cpu_s;
      const StereoMap simple = ALHAZEN_TRY(photometric_stereo(view.stack, plain, run));
      const auto error_of = [&](const StereoMap& map, std::size_t i) {
        const Vector3d n = map.map.normal[i].cast<double>(),
                       t = view.truth.normal[i].cast<double>();
        return std::atan2(n.cross(t).norm(), n.dot(t)) / kDegree;
      };
      for (std::size_t i = 0; i < found.map.size_px(); i += 3) {
        if (found.map.label[i] == NormalLabel::object) errors.push_back(error_of(found, i));
        if (simple.map.label[i] == NormalLabel::object) plain_errors.push_back(error_of(simple, i));
      }
      noise.push_back(found.map.noise_rad / kDegree);
      // The stack knows the object's pixels only; what lies between them and the background is
      // neither.
      found.map.key = view.truth.key;
      found.map.angle_rad = angle_rad;
      found.map.region = view.truth.region;
      for (std::size_t i = 0; i < found.map.size_px(); ++i) {
        if (view.truth.label[i] == NormalLabel::unknown) found.map.label[i] = NormalLabel::unknown;
      }
      ALHAZEN_TRY(reconstruction.add(found.map));
    }
  }
  const Reconstructed made = ALHAZEN_TRY(reconstruction.finish(run));
  const std::string name = "clay_mask_" + std::to_string(11 * stops) + "_views";
  ALHAZEN_TRY(keep(made.mesh, out, name));
  Row row = ALHAZEN_TRY(figures_of(name, made, mesh, run));
  row["lights"] = kLights;
  row["pixel_mm"] = kPixel_mm;
  row["stereo_mean_deg"] = mean_of(errors);
  row["stereo_median_deg"] = percentile(errors, 0.5);
  row["stereo_p99_deg"] = percentile(errors, 0.99);
  row["plain_mean_deg"] = mean_of(plain_errors);
  row["stereo_noise_deg"] = percentile(noise, 0.5);
  row["stereo_cpu_s"] = stereo_cpu_s;
  row["all_cpu_s"] = clock.read("").cpu_s;
  row["must_rms_voxels"] = 0.5;
  row["aim_rms_voxels"] = 0.25;
  return Rows{row};
}

namespace {

/// K.txt: nine numbers, pixel centres at integers.
Result<CameraModel> read_camera(const std::filesystem::path& file, int width, int height) {
  const std::string text = ALHAZEN_TRY(read_file(file, 1 << 16));
  std::istringstream stream(text);
  std::array<double, 9> k{};
  for (double& value : k) stream >> value;
  if (!stream) return Error{Code::corrupt, "'" + file.string() + "' ends early"};
  CameraModel camera;
  camera.name = "camera";
  camera.width_px = width;
  camera.height_px = height;
  camera.fx_px = k[0];
  camera.cx_px = k[2];
  camera.fy_px = k[4];
  camera.cy_px = k[5];
  return camera;
}

}  // namespace

Result<Rows> diligent_depths(const std::filesystem::path& data, const Run& run) {
  Rows rows;
  for (const char* name : {"bear", "buddha", "cat", "harvest", "pot1"}) {
    const std::filesystem::path folder = data / "normals_diligent" / name;
    const Image mask = ALHAZEN_TRY(read_image(folder / "mask.png"));
    const CameraModel camera =
        ALHAZEN_TRY(read_camera(folder / "K.txt", mask.width(), mask.height()));
    NormalMapFormat format;
    format.axes = NormalAxes::opengl;
    format.mask = folder / "mask.png";
    const NormalMap map = ALHAZEN_TRY(
        read_normal_map(folder / "normal_map.png", format, camera, {0, camera.name}, 0));
    const cv::Mat truth =
        cv::imread((folder / "depth_gt.tiff").string(), cv::IMREAD_ANYDEPTH | cv::IMREAD_GRAYSCALE);
    if (truth.type() != CV_32FC1 || truth.cols != mask.width() || truth.rows != mask.height()) {
      return Error{Code::unavailable, "no depth in '" + (folder / "depth_gt.tiff").string() + "'"};
    }
    for (const double sharpness : {0.0, 2.0}) {
      const StageClock clock;
      IntegrationOptions options;
      options.sharpness = sharpness;
      const DepthMap found = ALHAZEN_TRY(integrate_normals(map, camera, 1500, options, run));
      const StageTime time = clock.read("integrate");
      std::vector<double> ratio, error;
      for (std::size_t i = 0; i < map.size_px(); ++i) {
        const double z = truth.ptr<float>(0)[i];
        if (std::isfinite(found.depth_mm[i]) && std::isfinite(z) && z > 0) {
          ratio.push_back(z / static_cast<double>(found.depth_mm[i]));
        }
      }
      // No normal knows the scale.
      const double scale = percentile(ratio, 0.5);
      for (std::size_t i = 0; i < map.size_px(); ++i) {
        const double z = truth.ptr<float>(0)[i];
        if (!std::isfinite(found.depth_mm[i]) || !std::isfinite(z) || z <= 0) continue;
        error.push_back(std::abs(scale * static_cast<double>(found.depth_mm[i]) - z));
      }
      rows.push_back({{"experiment", std::string("diligent ") + name},
                      {"sharpness", sharpness},
                      {"pixels", error.size()},
                      {"mean_depth_error_mm", mean_of(error)},
                      {"median_depth_error_mm", percentile(error, 0.5)},
                      {"p90_depth_error_mm", percentile(error, 0.9)},
                      {"rounds", found.rounds},
                      {"cpu_s", time.cpu_s}});
    }
  }
  return rows;
}

void add_normal_rows(std::vector<Experiment>& list) {
  list.push_back({"buddha_normals", "Happy Buddha from 75 normal maps", [](const Context& context) {
                    return buddha_normals(context.data, context.out, context.run);
                  }});
  list.push_back({"photometric_stereo",
                  "real pictures under twelve lights, a matte ball among them",
                  [](const Context& context) {
                    return real_photometric_stereo(context.data, {"gray", "buddha", "cat", "horse"},
                                                   context.out, context.run);
                  }});
  list.push_back({"clay_mask", "painted, partly glossy clay, 198 lights in 22 views",
                  [](const Context& context) { return clay_mask(2, context.out, context.run); }});
  list.push_back({"clay_mask_264", "the same in 264 views",
                  [](const Context& context) { return clay_mask(24, context.out, context.run); }});
  list.push_back(
      {"diligent", "depth of single views from their true normals",
       [](const Context& context) { return diligent_depths(context.data, context.run); }});
}

}  // namespace alhazen::experiment
