#include "reconstruct/report/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <system_error>

#include "alhazen/caught.h"
#include "alhazen/check.h"
#include "reconstruct/report/colouring.h"
#include "reconstruct/report/page.h"
#include "reconstruct/report/pictures.h"
#include "reconstruct/scan/json_fields.h"
#include "reconstruct/scan/safe_file.h"
#include "reconstruct/scan/shortcomings.h"

namespace alhazen {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kFormat = 1;
constexpr double kAny = std::numeric_limits<double>::max();
// Bounds of what a report may say: far beyond any, they keep hostile files small.
constexpr std::size_t kLongestText = 4096, kMostStages = 1000, kMostWarnings = 100'000;
constexpr std::size_t kMostDevices = 1000;
constexpr int kMostIterations = 1000;
constexpr std::uint64_t kLargestReport = 64ULL << 20, kLargestSlice = 16ULL << 20;

std::size_t index_of(std::uint64_t value) { return static_cast<std::size_t>(value); }

// ---- struct → JSON ----

Json json_of(const std::vector<StageTime>& times) {
  Json list = Json::array();
  for (const StageTime& time : times)
    list.push_back({{"stage", time.stage}, {"cpu_s", time.cpu_s}, {"wall_s", time.wall_s}});
  return list;
}

Json json_of(const Eigen::Vector3d& p) { return Json{p.x(), p.y(), p.z()}; }

Json json_of(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

Json json_of(const DistanceFigures& figures) {
  return {{"count", figures.count},
          {"rms_mm", figures.rms_mm},
          {"p90_mm", figures.p90_mm},
          {"p99_mm", figures.p99_mm},
          {"max_mm", figures.max_mm}};
}

Json json_of(const Provenance& p) {
  return {{"scan_id", p.scan_id},
          {"created_at", p.created_at},
          {"object_id", p.object_id},
          {"note", p.note},
          {"operator", p.operator_name},
          {"software_version", p.software_version},
          {"rig_hash", p.rig_hash},
          {"coding", p.coding},
          {"cameras", p.cameras},
          {"displays", p.displays},
          {"stops", p.stops},
          {"light_maps", p.light_maps},
          {"light_maps_planned", p.light_maps_planned},
          {"normal_maps", p.normal_maps}};
}

Json json_of(const CaptureFigures& c) {
  return {{"frames", c.frames},         {"retakes", c.retakes},      {"bytes", c.bytes},
          {"duration_s", c.duration_s}, {"times", json_of(c.times)}, {"warnings", c.warnings}};
}

Json json_of(const ReconstructionFigures& r) {
  return {{"volume_centre_mm", json_of(r.volume.centre_mm)},
          {"volume_edge_mm", r.volume.edge_mm},
          {"level", r.level},
          {"voxel_mm", r.voxel_mm},
          {"leaves", r.leaves},
          {"hypotheses", r.hypotheses},
          {"cut_iterations", r.cut_iterations},
          {"cut_energy", r.cut_energy},
          {"cut_gap", r.cut_gap},
          {"times", json_of(r.times)},
          {"warnings", r.warnings}};
}

Json json_of(const VoteResidual& r) {
  return {{"points", r.points}, {"votes", r.votes}, {"median_rad", r.median_rad}};
}

Json json_of(const Refinement& r) {
  Json shifts = Json::array();
  for (const DeviceShift& shift : r.shifts)
    shifts.push_back({{"name", shift.name},
                      {"shift_mm", shift.shift_mm},
                      {"turn_rad", shift.turn_rad},
                      {"sigma_mm", shift.sigma_mm},
                      {"sigma_rad", shift.sigma_rad}});
  return {{"accepted", r.is_accepted},
          {"refusal", r.refusal},
          {"iterations", r.iterations},
          {"used_before", json_of(r.used_before)},
          {"used_after", json_of(r.used_after)},
          {"held_out_before", json_of(r.held_out_before)},
          {"held_out_after", json_of(r.held_out_after)},
          {"shifts", shifts}};
}

Json json_of(const MeshFigures& m) {
  return {{"vertices", m.vertices},
          {"triangles", m.triangles},
          {"closed", m.check.closed()},
          {"boundary_edges", m.check.boundary_edges},
          {"non_manifold_edges", m.check.non_manifold_edges},
          {"inconsistent_edges", m.check.inconsistent_edges},
          {"non_manifold_vertices", m.check.non_manifold_vertices},
          {"degenerate_triangles", m.check.degenerate_triangles},
          {"unused_vertices", m.check.unused_vertices},
          {"components", m.check.components},
          {"euler", m.check.euler},
          {"volume_mm3", m.check.volume_mm3},
          {"area_mm2", m.check.area_mm2},
          {"observed_share", m.observed_share},
          {"observed_area_mm2", m.observed_area_mm2},
          {"median_consistency", json_of(m.median_consistency)},
          {"median_depth_sigma_mm", json_of(m.median_depth_sigma_mm)},
          {"low_mm", json_of(m.low_mm)},
          {"high_mm", json_of(m.high_mm)}};
}

Json json_of(const Comparison& c) {
  return {{"observed", c.observed ? json_of(*c.observed) : Json()},
          {"all", json_of(c.all)},
          {"reference_to_mesh", json_of(c.reference_to_mesh)},
          {"hausdorff_mm", c.hausdorff_mm},
          {"bias_mm", c.bias_mm},
          {"completeness_0_3mm", c.completeness_0_3mm},
          {"coverage_1mm", c.coverage_1mm},
          {"normals", c.observed_normals ? Json{{"mean_deg", c.observed_normals->mean_deg},
                                                {"p90_deg", c.observed_normals->p90_deg}}
                                         : Json()}};
}

// ---- JSON → struct ----

Result<std::size_t> count_in(JsonFields& fields, const char* key) {
  return index_of(ALHAZEN_TRY(fields.counter(key)));
}

Result<Eigen::Vector3d> point_in(JsonFields& fields, const char* key) {
  const nlohmann::json& list = *ALHAZEN_TRY(fields.list(key, 3, 3));
  Eigen::Vector3d p;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (!list[axis].is_number()) return fields.complaint(key, "three numbers");
    p[static_cast<Eigen::Index>(axis)] = list[axis].get<double>();
  }
  return p;
}

Result<std::optional<double>> optional_in(JsonFields& fields, const char* key) {
  if (fields.is_null(key)) return std::optional<double>{};
  return std::optional(ALHAZEN_TRY(fields.number(key, -kAny, kAny)));
}

Result<std::vector<StageTime>> times_in(JsonFields& fields) {
  const nlohmann::json& list = *ALHAZEN_TRY(fields.list("times", 0, kMostStages));
  std::vector<StageTime> times;
  for (std::size_t i = 0; i < list.size(); ++i) {
    JsonFields entry = ALHAZEN_TRY(fields.entry("times", list, i));
    StageTime time;
    time.stage = ALHAZEN_TRY(entry.text("stage", kLongestText));
    time.cpu_s = ALHAZEN_TRY(entry.number("cpu_s", 0, kAny));
    time.wall_s = ALHAZEN_TRY(entry.number("wall_s", 0, kAny));
    ALHAZEN_TRY(entry.all_known());
    times.push_back(std::move(time));
  }
  return times;
}

Result<std::vector<std::string>> warnings_in(JsonFields& fields) {
  const nlohmann::json& list = *ALHAZEN_TRY(fields.list("warnings", 0, kMostWarnings));
  std::vector<std::string> warnings;
  for (const auto& warning : list) {
    if (!warning.is_string()) return fields.complaint("warnings", "a list of texts");
    warnings.push_back(warning.get<std::string>());
  }
  return warnings;
}

Result<Provenance> provenance_in(JsonFields fields) {
  Provenance p;
  for (const auto& [key, text] : {std::pair{"scan_id", &p.scan_id},
                                  {"created_at", &p.created_at},
                                  {"object_id", &p.object_id},
                                  {"note", &p.note},
                                  {"operator", &p.operator_name},
                                  {"software_version", &p.software_version},
                                  {"rig_hash", &p.rig_hash},
                                  {"coding", &p.coding}})
    *text = ALHAZEN_TRY(fields.text(key, kLongestText));
  p.cameras = ALHAZEN_TRY(count_in(fields, "cameras"));
  p.displays = ALHAZEN_TRY(count_in(fields, "displays"));
  p.stops = ALHAZEN_TRY(count_in(fields, "stops"));
  p.light_maps = ALHAZEN_TRY(count_in(fields, "light_maps"));
  p.light_maps_planned = ALHAZEN_TRY(count_in(fields, "light_maps_planned"));
  p.normal_maps = ALHAZEN_TRY(count_in(fields, "normal_maps"));
  ALHAZEN_TRY(fields.all_known());
  return p;
}

Result<CaptureFigures> capture_in(JsonFields fields) {
  CaptureFigures c;
  c.frames = ALHAZEN_TRY(fields.counter("frames"));
  c.retakes = ALHAZEN_TRY(fields.counter("retakes"));
  c.bytes = ALHAZEN_TRY(fields.counter("bytes"));
  c.duration_s = ALHAZEN_TRY(fields.number("duration_s", 0, kAny));
  c.times = ALHAZEN_TRY(times_in(fields));
  c.warnings = ALHAZEN_TRY(warnings_in(fields));
  ALHAZEN_TRY(fields.all_known());
  return c;
}

Result<ReconstructionFigures> reconstruction_in(JsonFields fields) {
  ReconstructionFigures r;
  r.volume.centre_mm = ALHAZEN_TRY(point_in(fields, "volume_centre_mm"));
  r.volume.edge_mm = ALHAZEN_TRY(fields.number("volume_edge_mm", 0, kAny));
  r.level = ALHAZEN_TRY(fields.small("level", 0, Octree::kMaxLevel));
  r.voxel_mm = ALHAZEN_TRY(fields.number("voxel_mm", 0, kAny));
  r.leaves = ALHAZEN_TRY(count_in(fields, "leaves"));
  r.hypotheses = ALHAZEN_TRY(fields.counter("hypotheses"));
  r.cut_iterations =
      ALHAZEN_TRY(fields.small("cut_iterations", 0, std::numeric_limits<int>::max()));
  r.cut_energy = ALHAZEN_TRY(fields.number("cut_energy", -kAny, kAny));
  r.cut_gap = ALHAZEN_TRY(fields.number("cut_gap", -kAny, kAny));
  r.times = ALHAZEN_TRY(times_in(fields));
  r.warnings = ALHAZEN_TRY(warnings_in(fields));
  ALHAZEN_TRY(fields.all_known());
  return r;
}

Result<VoteResidual> residual_in(JsonFields fields) {
  VoteResidual r;
  r.points = ALHAZEN_TRY(count_in(fields, "points"));
  r.votes = ALHAZEN_TRY(count_in(fields, "votes"));
  r.median_rad = ALHAZEN_TRY(fields.number("median_rad", 0, kAny));
  ALHAZEN_TRY(fields.all_known());
  return r;
}

Result<Refinement> refinement_in(JsonFields fields) {
  Refinement r;
  r.is_accepted = ALHAZEN_TRY(fields.flag("accepted"));
  r.refusal = ALHAZEN_TRY(fields.text("refusal", kLongestText));
  r.iterations = ALHAZEN_TRY(fields.small("iterations", 0, kMostIterations));
  for (const auto& [key, residual] : {std::pair{"used_before", &r.used_before},
                                      {"used_after", &r.used_after},
                                      {"held_out_before", &r.held_out_before},
                                      {"held_out_after", &r.held_out_after}})
    *residual = ALHAZEN_TRY(residual_in(ALHAZEN_TRY(fields.object(key))));
  const nlohmann::json& list = *ALHAZEN_TRY(fields.list("shifts", 0, kMostDevices));
  for (std::size_t i = 0; i < list.size(); ++i) {
    JsonFields entry = ALHAZEN_TRY(fields.entry("shifts", list, i));
    DeviceShift shift;
    shift.name = ALHAZEN_TRY(entry.text("name", kLongestText));
    for (const auto& [key, number] : {std::pair{"shift_mm", &shift.shift_mm},
                                      {"turn_rad", &shift.turn_rad},
                                      {"sigma_mm", &shift.sigma_mm},
                                      {"sigma_rad", &shift.sigma_rad}})
      *number = ALHAZEN_TRY(entry.number(key, 0, kAny));
    ALHAZEN_TRY(entry.all_known());
    r.shifts.push_back(std::move(shift));
  }
  ALHAZEN_TRY(fields.all_known());
  return r;
}

Result<MeshFigures> mesh_in(JsonFields fields) {
  MeshFigures m;
  m.vertices = ALHAZEN_TRY(count_in(fields, "vertices"));
  m.triangles = ALHAZEN_TRY(count_in(fields, "triangles"));
  MeshCheck& check = m.check;
  for (const auto& [key, count] : {std::pair{"boundary_edges", &check.boundary_edges},
                                   {"non_manifold_edges", &check.non_manifold_edges},
                                   {"inconsistent_edges", &check.inconsistent_edges},
                                   {"non_manifold_vertices", &check.non_manifold_vertices},
                                   {"degenerate_triangles", &check.degenerate_triangles},
                                   {"unused_vertices", &check.unused_vertices},
                                   {"components", &check.components}})
    *count = ALHAZEN_TRY(count_in(fields, key));
  if (ALHAZEN_TRY(fields.flag("closed")) != check.closed())
    return fields.complaint("closed", "what the counts say");
  check.euler = static_cast<std::ptrdiff_t>(
      ALHAZEN_TRY(fields.integer("euler", std::numeric_limits<std::int64_t>::min(),
                                 std::numeric_limits<std::int64_t>::max())));
  check.volume_mm3 = ALHAZEN_TRY(fields.number("volume_mm3", -kAny, kAny));
  check.area_mm2 = ALHAZEN_TRY(fields.number("area_mm2", 0, kAny));
  m.observed_share = ALHAZEN_TRY(fields.number("observed_share", 0, 1));
  m.observed_area_mm2 = ALHAZEN_TRY(fields.number("observed_area_mm2", 0, kAny));
  m.median_consistency = ALHAZEN_TRY(optional_in(fields, "median_consistency"));
  m.median_depth_sigma_mm = ALHAZEN_TRY(optional_in(fields, "median_depth_sigma_mm"));
  m.low_mm = ALHAZEN_TRY(point_in(fields, "low_mm"));
  m.high_mm = ALHAZEN_TRY(point_in(fields, "high_mm"));
  ALHAZEN_TRY(fields.all_known());
  return m;
}

Result<DistanceFigures> distances_in(JsonFields fields) {
  DistanceFigures figures;
  figures.count = ALHAZEN_TRY(count_in(fields, "count"));
  figures.rms_mm = ALHAZEN_TRY(fields.number("rms_mm", 0, kAny));
  figures.p90_mm = ALHAZEN_TRY(fields.number("p90_mm", 0, kAny));
  figures.p99_mm = ALHAZEN_TRY(fields.number("p99_mm", 0, kAny));
  figures.max_mm = ALHAZEN_TRY(fields.number("max_mm", 0, kAny));
  ALHAZEN_TRY(fields.all_known());
  return figures;
}

Result<Comparison> comparison_in(JsonFields fields) {
  Comparison c;
  if (!fields.is_null("observed"))
    c.observed = ALHAZEN_TRY(distances_in(ALHAZEN_TRY(fields.object("observed"))));
  c.all = ALHAZEN_TRY(distances_in(ALHAZEN_TRY(fields.object("all"))));
  c.reference_to_mesh = ALHAZEN_TRY(distances_in(ALHAZEN_TRY(fields.object("reference_to_mesh"))));
  c.hausdorff_mm = ALHAZEN_TRY(fields.number("hausdorff_mm", 0, kAny));
  c.bias_mm = ALHAZEN_TRY(fields.number("bias_mm", -kAny, kAny));
  c.completeness_0_3mm = ALHAZEN_TRY(fields.number("completeness_0_3mm", 0, 1));
  c.coverage_1mm = ALHAZEN_TRY(fields.number("coverage_1mm", 0, 1));
  if (!fields.is_null("normals")) {
    JsonFields normals = ALHAZEN_TRY(fields.object("normals"));
    NormalFigures figures;
    figures.mean_deg = ALHAZEN_TRY(normals.number("mean_deg", 0, 180));
    figures.p90_deg = ALHAZEN_TRY(normals.number("p90_deg", 0, 180));
    ALHAZEN_TRY(normals.all_known());
    c.observed_normals = figures;
  }
  ALHAZEN_TRY(fields.all_known());
  return c;
}

Result<Report> report_in(const nlohmann::json& json) {
  JsonFields fields = ALHAZEN_TRY(JsonFields::make(json, "", Code::corrupt));
  static_cast<void>(ALHAZEN_TRY(fields.small("format", kFormat, kFormat)));  // there is but one
  Report report;
  report.provenance = ALHAZEN_TRY(provenance_in(ALHAZEN_TRY(fields.object("provenance"))));
  report.capture = ALHAZEN_TRY(capture_in(ALHAZEN_TRY(fields.object("capture"))));
  report.reconstruction =
      ALHAZEN_TRY(reconstruction_in(ALHAZEN_TRY(fields.object("reconstruction"))));
  if (!fields.is_null("refinement"))
    report.refinement = ALHAZEN_TRY(refinement_in(ALHAZEN_TRY(fields.object("refinement"))));
  report.mesh = ALHAZEN_TRY(mesh_in(ALHAZEN_TRY(fields.object("mesh"))));
  report.reference = ALHAZEN_TRY(fields.text("reference", kLongestText));
  if (!fields.is_null("comparison"))
    report.comparison = ALHAZEN_TRY(comparison_in(ALHAZEN_TRY(fields.object("comparison"))));
  ALHAZEN_TRY(fields.all_known());
  return report;
}

// ---- figures ----

const char* name_of(Coding coding) { return coding == Coding::gray ? "gray" : "gray_phase"; }

std::optional<double> median(std::vector<float> values) {
  std::erase_if(values, [](float value) { return !std::isfinite(value); });
  if (values.empty()) return std::nullopt;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return static_cast<double>(*middle);
}

Provenance provenance_of(const Scan& scan, std::size_t light_maps) {
  const Manifest& manifest = scan.manifest();
  Provenance p;
  p.scan_id = manifest.scan_id;
  p.created_at = manifest.created_at;
  p.object_id = manifest.object_id;
  p.note = manifest.note;
  p.operator_name = manifest.operator_name;
  p.software_version = manifest.software_version;
  p.rig_hash = manifest.rig_hash;
  p.coding = name_of(manifest.coding);
  p.cameras = manifest.cameras.size();
  p.displays = manifest.displays.size();
  p.stops = manifest.stops.size();
  p.light_maps = light_maps;
  p.light_maps_planned = p.cameras * p.displays * p.stops;
  return p;
}

double total_cpu_s(const std::vector<StageTime>& times) {
  double sum = 0;
  for (const StageTime& time : times) sum += time.cpu_s;
  return sum;
}

[[gnu::format(printf, 1, 2)]] std::string printed(const char* format, ...) {
  std::array<char, 512> line{};
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line.data(), line.size(), format, arguments);
  va_end(arguments);
  return line.data();
}

}  // namespace

Result<CaptureFigures> capture_figures(const Scan& scan) {
  const FrameLog log = ALHAZEN_TRY(scan.frame_log());
  CaptureFigures figures;
  figures.frames = log.records.size();
  std::int64_t first_us = std::numeric_limits<std::int64_t>::max(), last_us = 0;
  for (const FrameRecord& record : log.records) {
    figures.retakes += static_cast<std::uint64_t>(std::max(record.attempt - 1, 0));
    first_us = std::min(first_us, record.exposure_begin_us);
    last_us = std::max(last_us, record.exposure_begin_us);
  }
  if (!log.records.empty()) figures.duration_s = static_cast<double>(last_us - first_us) * 1e-6;
  std::error_code error;
  for (std::filesystem::recursive_directory_iterator at(scan.directory(), error), end;
       !error && at != end; at.increment(error)) {
    if (at->is_regular_file(error)) figures.bytes += at->file_size(error);
  }
  if (error)
    return Error{Code::unavailable,
                 scan.directory().string() + " cannot be listed: " + error.message()};
  return figures;
}

MeshFigures mesh_figures(const Mesh& mesh) {
  MeshFigures figures;
  figures.vertices = mesh.vertices_mm.size();
  figures.triangles = mesh.triangles.size();
  figures.check = check_closed(mesh);
  if (mesh.vertices_mm.empty()) return figures;
  const auto is_observed = [&](std::size_t vertex) {
    return mesh.observed.empty() || mesh.observed[vertex] != 0;
  };
  double area = 0;
  for (const auto& [a, b, c] : mesh.triangles) {
    const double part = (mesh.vertices_mm[b] - mesh.vertices_mm[a])
                            .cross(mesh.vertices_mm[c] - mesh.vertices_mm[a])
                            .norm() /
                        2;
    area += part;
    if (is_observed(a) && is_observed(b) && is_observed(c)) figures.observed_area_mm2 += part;
  }
  figures.observed_share = area > 0 ? std::min(figures.observed_area_mm2 / area, 1.0) : 0;
  std::vector<float> consistency, depth_sigma_mm;
  figures.low_mm = figures.high_mm = mesh.vertices_mm.front();
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    figures.low_mm = figures.low_mm.cwiseMin(mesh.vertices_mm[i]);
    figures.high_mm = figures.high_mm.cwiseMax(mesh.vertices_mm[i]);
    if (!is_observed(i)) continue;
    if (!mesh.consistency.empty()) consistency.push_back(mesh.consistency[i]);
    if (!mesh.depth_sigma_mm.empty()) depth_sigma_mm.push_back(mesh.depth_sigma_mm[i]);
  }
  figures.median_consistency = median(std::move(consistency));
  figures.median_depth_sigma_mm = median(std::move(depth_sigma_mm));
  return figures;
}

Result<Report> make_report(const Scan& scan, const Reconstructed& reconstructed,
                           CaptureFigures capture, const Mesh* reference, const Run& run) {
  Report report = ALHAZEN_TRY(make_report(provenance_of(scan, reconstructed.light_maps),
                                          reconstructed, std::move(capture), reference, run));
  std::vector<std::string> lacking = shortcomings(scan, ALHAZEN_TRY(scan.light_maps()));
  std::vector<std::string>& warnings = report.reconstruction.warnings;
  warnings.insert(warnings.begin(), lacking.begin(), lacking.end());
  report.light_maps = ALHAZEN_TRY(light_map_samples(scan));
  return report;
}

Result<Report> make_report(Provenance provenance, const Reconstructed& reconstructed,
                           CaptureFigures capture, const Mesh* reference, const Run& run) {
  Report report;
  report.provenance = std::move(provenance);
  report.provenance.normal_maps = reconstructed.normal_maps;
  report.capture = std::move(capture);
  ReconstructionFigures& r = report.reconstruction;
  r.volume = reconstructed.octree.volume();
  r.level = reconstructed.octree.finest_level();
  r.voxel_mm = r.volume.edge_mm / (1 << r.level);
  r.leaves = reconstructed.octree.size();
  r.hypotheses = reconstructed.hypotheses;
  r.cut_iterations = reconstructed.indicator.iterations;
  r.cut_energy = reconstructed.indicator.energy;
  r.cut_gap = reconstructed.indicator.gap;
  r.times = reconstructed.times;
  r.warnings = reconstructed.warnings;
  report.mesh = mesh_figures(reconstructed.mesh);
  report.slice = middle_slice(reconstructed);
  if (reference != nullptr)
    report.comparison = ALHAZEN_TRY(compare(reconstructed.mesh, *reference, {}, run));
  return report;
}

std::string Report::to_json() const {
  const Json json{{"format", kFormat},
                  {"provenance", json_of(provenance)},
                  {"capture", json_of(capture)},
                  {"reconstruction", json_of(reconstruction)},
                  {"refinement", refinement ? json_of(*refinement) : Json()},
                  {"mesh", json_of(mesh)},
                  {"reference", reference},
                  {"comparison", comparison ? json_of(*comparison) : Json()}};
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Result<Report> Report::parse(std::string_view json) {
  return caught(Code::corrupt, "report.json",
                [&] { return report_in(nlohmann::json::parse(json)); });
}

std::string Report::brief() const {
  std::string text;
  text += printed("mesh        %zu vertices, %zu triangles, %s, %.1f %% of the area observed\n",
                  mesh.vertices, mesh.triangles, mesh.check.closed() ? "closed" : "NOT CLOSED",
                  100 * mesh.observed_share);
  if (provenance.light_maps_planned > 0 || provenance.normal_maps == 0) {
    text +=
        printed("from        %zu of %zu light maps, %llu frames, %llu retakes, voxels %.3f mm\n",
                provenance.light_maps, provenance.light_maps_planned,
                static_cast<unsigned long long>(capture.frames),
                static_cast<unsigned long long>(capture.retakes), reconstruction.voxel_mm);
  }
  if (provenance.normal_maps > 0) {
    text += printed("from        %zu normal maps, voxels %.3f mm\n", provenance.normal_maps,
                    reconstruction.voxel_mm);
  }
  if (refinement) {
    const VoteResidual &before = refinement->held_out_before, &after = refinement->held_out_after;
    text += printed("refined     %s; held-out votes disagree by %.3f mrad, %.3f before\n",
                    refinement->is_accepted ? "yes" : "NO, calibration kept",
                    1000 * after.median_rad, 1000 * before.median_rad);
  }
  if (comparison) {
    if (comparison->observed)
      text +=
          printed("accuracy    RMS %.4f mm, 90 %% %.4f mm, 99 %% %.4f mm, max %.3f mm (observed)\n",
                  comparison->observed->rms_mm, comparison->observed->p90_mm,
                  comparison->observed->p99_mm, comparison->observed->max_mm);
    text += printed(
        "complete    %.1f %% within 0.3 mm of observed triangles, %.1f %% within 1 mm of the "
        "closed "
        "mesh\n",
        100 * comparison->completeness_0_3mm, 100 * comparison->coverage_1mm);
  }
  text += printed("CPU time    %.1f s scan, %.1f s reconstruction\n", total_cpu_s(capture.times),
                  total_cpu_s(reconstruction.times));
  for (const auto* warnings : {&capture.warnings, &reconstruction.warnings}) {
    for (const std::string& warning : *warnings) text += "warning     " + warning + "\n";
  }
  return text;
}

Status write_report(const Report& report, const Mesh& mesh,
                    const std::filesystem::path& directory) {
  const std::vector<Colouring> colourings = colourings_of(report, mesh);
  const Pictures pictures = ALHAZEN_TRY(draw_pictures(report, mesh, colourings));
  const std::string page = to_page(report, mesh, colourings, pictures);
  ALHAZEN_TRY(write_pictures(pictures, directory / "pictures"));
  if (report.slice) ALHAZEN_TRY(write_file_safely(directory / "slice.pfm", to_pfm(*report.slice)));
  ALHAZEN_TRY(write_file_safely(directory / "report.html", page));
  return write_file_safely(directory / "report.json", report.to_json());
}

Result<Report> read_report(const std::filesystem::path& directory) {
  const auto json_file = directory / "report.json", slice_file = directory / "slice.pfm";
  const std::string json = ALHAZEN_TRY(read_file(json_file, kLargestReport));
  Report report = ALHAZEN_TRY(Report::parse(json).in(json_file.string()));
  std::error_code error;
  if (std::filesystem::exists(slice_file, error)) {
    const std::string pfm = ALHAZEN_TRY(read_file(slice_file, kLargestSlice));
    report.slice = ALHAZEN_TRY(parse_slice(pfm).in(slice_file.string()));
  }
  return report;
}

}  // namespace alhazen
