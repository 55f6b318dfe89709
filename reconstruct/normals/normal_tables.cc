#include "reconstruct/normals/normal_tables.h"

#include <map>
#include <numbers>
#include <optional>

#include "reconstruct/scan/csv_table.h"

namespace alhazen {
namespace {

constexpr double kDegree = std::numbers::pi / 180, kMaxAngle_deg = 1e6;
constexpr int kMaxStop = 1'000'000;
constexpr double kMaxLength_mm = 1e9;

std::optional<NormalAxes> axes_of(std::string_view name) {
  if (name.empty() || name == "camera") return NormalAxes::camera;
  if (name == "opengl") return NormalAxes::opengl;
  if (name == "rig") return NormalAxes::rig;
  return std::nullopt;
}

}  // namespace

Result<std::vector<ViewEntry>> parse_views(std::string_view csv) {
  const CsvTable table = ALHAZEN_TRY(
      CsvTable::parse(csv, {"file", "camera"}, {"stop", "angle_deg", "axes", "mask", "noise_deg"}));
  std::vector<ViewEntry> views;
  std::map<NormalMapKey, int> seen;
  for (std::size_t row = 0; row < table.size(); ++row) {
    ViewEntry view;
    view.line = table.line(row);
    if (table.text(row, "file").empty()) {
      return table.complaint(row, "file", "the name of a normal map");
    }
    view.file = std::string(table.text(row, "file"));
    view.key.camera = std::string(table.text(row, "camera"));
    if (view.key.camera.empty()) return table.complaint(row, "camera", "a camera of the rig");
    view.key.stop = ALHAZEN_TRY(table.integer(row, "stop", 0, kMaxStop, 0));
    view.angle_rad =
        kDegree * ALHAZEN_TRY(table.number(row, "angle_deg", -kMaxAngle_deg, kMaxAngle_deg, 0.0));
    const std::optional<NormalAxes> axes = axes_of(table.text(row, "axes"));
    if (!axes) return table.complaint(row, "axes", "camera, opengl or rig");
    view.format.axes = *axes;
    view.format.mask = std::string(table.text(row, "mask"));
    view.format.noise_rad = kDegree * ALHAZEN_TRY(table.number(row, "noise_deg", 0, 57, 0.0));
    const auto [twin, is_new] = seen.try_emplace(view.key, view.line);
    if (!is_new) {
      return Error{Code::invalid, "line " + std::to_string(view.line) + ": camera '" +
                                      view.key.camera + "' at stop " +
                                      std::to_string(view.key.stop) + " was in line " +
                                      std::to_string(twin->second)};
    }
    views.push_back(std::move(view));
  }
  return views;
}

Result<std::vector<LightEntry>> parse_lights(std::string_view csv) {
  const CsvTable table =
      ALHAZEN_TRY(CsvTable::parse(csv, {"file", "x", "y", "z"}, {"kind", "axes", "intensity"}));
  std::vector<LightEntry> lights;
  for (std::size_t row = 0; row < table.size(); ++row) {
    LightEntry entry;
    entry.line = table.line(row);
    if (table.text(row, "file").empty()) {
      return table.complaint(row, "file", "the name of a picture");
    }
    entry.file = std::string(table.text(row, "file"));
    for (const auto& [axis, name] : {std::pair{0, "x"}, std::pair{1, "y"}, std::pair{2, "z"}}) {
      entry.light.vector[axis] =
          ALHAZEN_TRY(table.number(row, name, -kMaxLength_mm, kMaxLength_mm));
    }
    const std::optional<NormalAxes> axes = axes_of(table.text(row, "axes"));
    if (!axes || *axes == NormalAxes::rig) {
      return table.complaint(row, "axes", "camera or opengl");
    }
    if (*axes == NormalAxes::opengl) {
      entry.light.vector.y() *= -1;
      entry.light.vector.z() *= -1;
    }
    const std::string_view kind = table.text(row, "kind");
    if (!kind.empty() && kind != "far" && kind != "near") {
      return table.complaint(row, "kind", "far (a direction) or near (a position in mm)");
    }
    entry.light.is_near = kind == "near";
    if (!(entry.light.vector.norm() > 1e-9)) {
      return table.complaint(row, "x", "part of a vector that is not zero");
    }
    entry.light.intensity = ALHAZEN_TRY(table.number(row, "intensity", 1e-9, 1e9, 1.0));
    lights.push_back(entry);
  }
  return lights;
}

}  // namespace alhazen
