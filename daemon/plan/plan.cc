#include "daemon/plan/plan.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <tuple>
#include <utility>

#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
/// Room around the projected volume: distortion bends the cube's edges between the sampled points
/// by less than this.
constexpr double kRegionMarginPx = 4.0;
/// Points on each edge of the cube that are projected.
constexpr int kEdgeSamples = 9;

std::string text_of(double value) {
  std::string text = std::to_string(value);
  while (text.back() == '0') text.pop_back();
  if (text.back() == '.') text.pop_back();
  return text;
}

std::string text_of(Micros time) { return std::to_string(time.count()) + " us"; }

Error invalid(const std::string& key, const std::string& given, const std::string& wanted) {
  return {Code::invalid, "'" + key + "' is " + given + "; it must be " + wanted};
}

std::string list_of(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text.empty() ? "none" : text;
}

template <class Value>
std::optional<Value> first_of(const std::optional<Value>& wish,
                              const std::optional<Value>& preset) {
  return wish ? wish : preset;
}

/// The request's choices, what it leaves open filled from its preset. Stops and angles are one
/// choice: who names one does not inherit the other.
PlanChoices merge(const PlanChoices& wish, const PlanChoices& preset) {
  PlanChoices merged;
  const bool own_stops = wish.stops || wish.angles_deg;
  merged.stops = own_stops ? wish.stops : preset.stops;
  merged.angles_deg = own_stops ? wish.angles_deg : preset.angles_deg;
  merged.displays = first_of(wish.displays, preset.displays);
  merged.cameras = first_of(wish.cameras, preset.cameras);
  merged.coding = first_of(wish.coding, preset.coding);
  merged.exposure = first_of(wish.exposure, preset.exposure);
  merged.gain_db = first_of(wish.gain_db, preset.gain_db);
  merged.crop = first_of(wish.crop, preset.crop);
  merged.edge_mm = first_of(wish.edge_mm, preset.edge_mm);
  merged.centre_mm = first_of(wish.centre_mm, preset.centre_mm);
  merged.level = first_of(wish.level, preset.level);
  merged.keep_frames = first_of(wish.keep_frames, preset.keep_frames);
  return merged;
}

Result<PlanChoices> choices_of(const ScanRequest& request, const std::vector<Preset>& presets) {
  if (request.preset.empty()) return request.choices;
  const auto preset = std::find_if(presets.begin(), presets.end(), [&](const Preset& candidate) {
    return candidate.name == request.preset;
  });
  if (preset == presets.end()) {
    std::vector<std::string> names;
    names.reserve(presets.size());
    for (const Preset& candidate : presets) names.push_back(candidate.name);
    return invalid("plan.preset", "'" + request.preset + "'", "one of: " + list_of(names));
  }
  return merge(request.choices, preset->choices);
}

bool is_id(std::string_view text, std::string_view punctuation, bool capitals) {
  return !text.empty() && text.size() <= 64 && std::all_of(text.begin(), text.end(), [&](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || (capitals && c >= 'A' && c <= 'Z') ||
           punctuation.find(c) != std::string_view::npos;
  });
}

Status check_texts(const ScanRequest& request, const PlanStamp& stamp) {
  if (!is_id(request.object_id, "._-", true))
    return invalid("object.id", "'" + request.object_id.substr(0, 80) + "'",
                   "1 to 64 characters of A-Z a-z 0-9 . _ -");
  if (request.note.size() > 4096)
    return invalid("object.note", std::to_string(request.note.size()) + " bytes long",
                   "at most 4096");
  if (request.operator_name.size() > 64)
    return invalid("object.operator", std::to_string(request.operator_name.size()) + " bytes long",
                   "at most 64");
  if (!is_id(stamp.scan_id, "-", false))
    return invalid("scan_id", "'" + stamp.scan_id.substr(0, 80) + "'",
                   "1 to 64 characters of a-z 0-9 -");
  return {};
}

Result<std::vector<Stop>> stops_of(const PlanChoices& choices,
                                   const std::optional<TurntableInfo>& table) {
  if (choices.stops && choices.angles_deg)
    return invalid("plan.angles_deg", "given beside 'plan.stops'", "the only one of the two");
  std::vector<double> angles_rad;
  if (choices.angles_deg) {
    const std::vector<double>& given = *choices.angles_deg;
    if (given.empty() || given.size() > static_cast<std::size_t>(kMaxStops))
      return invalid("plan.angles_deg", "a list of " + std::to_string(given.size()),
                     "a list of 1 to 360");
    for (std::size_t i = 0; i < given.size(); ++i) {
      if (!(std::abs(given[i]) <= 360.0))
        return invalid("plan.angles_deg", text_of(given[i]), "within [-360, 360]");
      if (i > 0 && given[i] <= given[i - 1])
        return invalid("plan.angles_deg", text_of(given[i]) + " after " + text_of(given[i - 1]),
                       "a rising list");
      angles_rad.push_back(given[i] * kRadPerDeg);
    }
    if (given.back() - given.front() >= 360.0)
      return invalid("plan.angles_deg", "spread over " + text_of(given.back() - given.front()),
                     "spread over less than 360");
  } else {
    const int stops = choices.stops.value_or(12);
    if (stops < 1 || stops > kMaxStops)
      return invalid("plan.stops", std::to_string(stops), "within [1, 360]");
    for (int i = 0; i < stops; ++i) angles_rad.push_back(2 * std::numbers::pi * i / stops);
  }
  if (!table) return Error{Code::invalid, "no turntable is open: a scan needs one"};
  if (table->min_rad < table->max_rad)
    for (const double angle : angles_rad)
      if (angle - kRunUpRad < table->min_rad || angle > table->max_rad)
        return invalid("plan.angles_deg", text_of(angle / kRadPerDeg),
                       "within the table's travel less a run-up of 5 deg: [" +
                           text_of((table->min_rad + kRunUpRad) / kRadPerDeg) + ", " +
                           text_of(table->max_rad / kRadPerDeg) + "]");
  std::vector<Stop> stops;
  stops.reserve(angles_rad.size());
  for (const double angle : angles_rad) stops.push_back({static_cast<int>(stops.size()), angle});
  return stops;
}

/// Names that were asked for, or all of the rig. Fails: invalid (a name twice, unknown to the rig).
template <class Model>
Result<std::vector<std::string>> names_of(const std::string& key,
                                          const std::optional<std::vector<std::string>>& wanted,
                                          const std::vector<Model>& models) {
  std::vector<std::string> known;
  known.reserve(models.size());
  for (const Model& model : models) known.push_back(model.name);
  if (!wanted) {
    if (known.empty()) return Error{Code::invalid, "the rig has no " + key};
    return known;
  }
  if (wanted->empty()) return invalid("plan." + key, "empty", "some of: " + list_of(known));
  std::set<std::string> seen;
  for (const std::string& name : *wanted) {
    if (std::find(known.begin(), known.end(), name) == known.end())
      return invalid("plan." + key, "'" + name.substr(0, 80) + "'", "one of: " + list_of(known));
    if (!seen.insert(name).second)
      return invalid("plan." + key, "naming '" + name + "' twice", "a list without repetition");
  }
  return *wanted;
}

Status check_size(const std::string& label, int rig_width, int rig_height, int width, int height) {
  if (rig_width == width && rig_height == height) return {};
  return Error{Code::invalid, label + " is calibrated with " + std::to_string(rig_width) + "x" +
                                  std::to_string(rig_height) + " px, the device has " +
                                  std::to_string(width) + "x" + std::to_string(height) + " px"};
}

/// Points on all twelve edges of a cube: their projection bounds that of the whole cube.
std::vector<Eigen::Vector3d> edge_points(const Volume& volume) {
  std::vector<Eigen::Vector3d> points;
  const double half = volume.edge_mm / 2;
  for (int axis = 0; axis < 3; ++axis)
    for (const double a : {-half, half})
      for (const double b : {-half, half})
        for (int i = 0; i < kEdgeSamples; ++i) {
          Eigen::Vector3d offset;
          offset[axis] = -half + volume.edge_mm * i / (kEdgeSamples - 1);
          offset[(axis + 1) % 3] = a;
          offset[(axis + 2) % 3] = b;
          points.emplace_back(volume.centre_mm + offset);
        }
  return points;
}

/// Where a sensor sees the volume at any stop.
Result<Region> region_of(const CameraModel& camera, const TableModel& table, const Volume& volume,
                         const std::vector<Stop>& stops) {
  const Region whole{0, 0, camera.width_px, camera.height_px};
  double left = std::numeric_limits<double>::infinity(), top = left;
  double right = -left, bottom = -left;
  for (const Stop& stop : stops) {
    const Pose camera_from_object = camera.camera_from_rig * table.rig_from_object(stop.wanted_rad);
    for (const Eigen::Vector3d& point : edge_points(volume)) {
      const auto pixel = camera.project(camera_from_object * point);
      // The volume reaches behind the camera: nothing bounds it.
      if (!pixel) return whole;
      left = std::min(left, pixel->x()), right = std::max(right, pixel->x());
      top = std::min(top, pixel->y()), bottom = std::max(bottom, pixel->y());
    }
  }
  const auto aligned = [](double first, double last, int size) {
    const double low = std::clamp(first - kRegionMarginPx, 0.0, static_cast<double>(size));
    const double high = std::clamp(last + kRegionMarginPx + 1, 0.0, static_cast<double>(size));
    const int from = static_cast<int>(low) / kRegionAlignPx * kRegionAlignPx;
    const int to =
        (static_cast<int>(std::ceil(high)) + kRegionAlignPx - 1) / kRegionAlignPx * kRegionAlignPx;
    return std::pair(from, std::min(to, size) - from);
  };
  Region region;
  std::tie(region.x, region.width) = aligned(left, right, camera.width_px);
  std::tie(region.y, region.height) = aligned(top, bottom, camera.height_px);
  if (!(right >= 0 && bottom >= 0 && left < camera.width_px && top < camera.height_px) ||
      region.width < 1 || region.height < 1)
    return Error{Code::invalid,
                 "camera " + camera.name + " does not see the volume (" + text_of(volume.edge_mm) +
                     " mm about " + text_of(volume.centre_mm.x()) + ", " +
                     text_of(volume.centre_mm.y()) + ", " + text_of(volume.centre_mm.z()) +
                     "); leave it out of 'plan.cameras' or move 'volume.centre_mm'"};
  return region;
}

Result<Volume> volume_of(const PlanChoices& choices, const TableModel& table) {
  Volume volume;
  volume.edge_mm = choices.edge_mm.value_or(volume.edge_mm);
  if (!(volume.edge_mm >= kMinEdgeMm && volume.edge_mm <= kMaxEdgeMm))
    return invalid("volume.edge_mm", text_of(volume.edge_mm), "within [1, 2000]");
  if (choices.centre_mm) {
    volume.centre_mm = *choices.centre_mm;
    for (const double coordinate :
         {volume.centre_mm.x(), volume.centre_mm.y(), volume.centre_mm.z()})
      if (!(std::abs(coordinate) <= kMaxCentreMm))
        return invalid("volume.centre_mm", text_of(coordinate), "within [-2000, 2000]");
    return volume;
  }
  // Where the axis meets the plate (z = 0); an axis lying in it has no such point.
  Eigen::Vector3d foot_mm = table.point_mm;
  if (std::abs(table.direction.z()) > 1e-6)
    foot_mm -= table.direction * (table.point_mm.z() / table.direction.z());
  volume.centre_mm = {foot_mm.x(), foot_mm.y(), volume.edge_mm / 2};
  return volume;
}

Result<PlannedCamera> plan_camera(const std::string& name, const PlanChoices& choices,
                                  const Rig& rig, const DeviceFacts& devices, const Volume& volume,
                                  const std::vector<Stop>& stops) {
  const auto facts = std::find_if(devices.cameras.begin(), devices.cameras.end(),
                                  [&](const CameraFacts& f) { return f.name == name; });
  if (facts == devices.cameras.end())
    return Error{Code::invalid, "camera " + name + " is in the rig but not open"};
  const CameraModel& model = *rig.camera(name);
  const CameraInfo& info = facts->info;
  ALHAZEN_TRY(
      check_size("camera " + name, model.width_px, model.height_px, info.width_px, info.height_px));
  PlannedCamera camera;
  camera.name = name;
  camera.settings.exposure = choices.exposure.value_or(facts->preferred.exposure);
  camera.settings.gain_db = choices.gain_db.value_or(facts->preferred.gain_db);
  if (camera.settings.exposure < info.exposure_min || camera.settings.exposure > info.exposure_max)
    return invalid("plan.exposure_us", text_of(camera.settings.exposure),
                   "within [" + text_of(info.exposure_min) + ", " + text_of(info.exposure_max) +
                       "] for camera " + name);
  if (!(camera.settings.gain_db >= info.gain_min_db && camera.settings.gain_db <= info.gain_max_db))
    return invalid("plan.gain_db", text_of(camera.settings.gain_db),
                   "within [" + text_of(info.gain_min_db) + ", " + text_of(info.gain_max_db) +
                       "] for camera " + name);
  camera.settings.region = choices.crop.value_or(true)
                               ? ALHAZEN_TRY(region_of(model, rig.turntable, volume, stops))
                               : Region{0, 0, model.width_px, model.height_px};
  return camera;
}

Result<PlannedDisplay> plan_display(const std::string& name, Coding coding, const Rig& rig,
                                    const DeviceFacts& devices) {
  const auto facts = std::find_if(devices.displays.begin(), devices.displays.end(),
                                  [&](const DisplayFacts& f) { return f.name == name; });
  if (facts == devices.displays.end())
    return Error{Code::invalid, "display " + name + " is in the rig but not open"};
  const DisplayModel& model = *rig.display(name);
  ALHAZEN_TRY(check_size("display " + name, model.width_px, model.height_px, facts->info.width_px,
                         facts->info.height_px));
  PlannedDisplay display;
  display.name = name;
  display.width_px = model.width_px;
  display.height_px = model.height_px;
  display.gamma = model.gamma;
  display.patterns =
      ALHAZEN_TRY(make_sequence(coding, model.width_px, model.height_px).in("display " + name));
  return display;
}

}  // namespace

Result<Manifest> make_plan(const ScanRequest& request, const std::vector<Preset>& presets,
                           const Rig& rig, const DeviceFacts& devices, const PlanStamp& stamp) {
  ALHAZEN_TRY(check_texts(request, stamp));
  const PlanChoices choices = ALHAZEN_TRY(choices_of(request, presets));
  Manifest plan;
  plan.scan_id = stamp.scan_id;
  plan.created_at = stamp.created_at;
  plan.software_version = stamp.software_version;
  plan.object_id = request.object_id;
  plan.note = request.note;
  plan.operator_name = request.operator_name;
  plan.rig_hash = rig.hash();
  plan.coding = choices.coding.value_or(Coding::gray);
  plan.keep_frames = choices.keep_frames.value_or(KeepFrames::none);
  plan.level = choices.level.value_or(8);
  if (plan.level < kMinLevel || plan.level > kMaxLevel)
    return invalid("level", std::to_string(plan.level), "within [4, 11]");
  plan.volume = ALHAZEN_TRY(volume_of(choices, rig.turntable));
  plan.stops = ALHAZEN_TRY(stops_of(choices, devices.turntable));
  for (const std::string& name : ALHAZEN_TRY(names_of("displays", choices.displays, rig.displays)))
    plan.displays.push_back(ALHAZEN_TRY(plan_display(name, plan.coding, rig, devices)));
  for (const std::string& name : ALHAZEN_TRY(names_of("cameras", choices.cameras, rig.cameras)))
    plan.cameras.push_back(
        ALHAZEN_TRY(plan_camera(name, choices, rig, devices, plan.volume, plan.stops)));
  return plan;
}

std::vector<Step> make_steps(const Manifest& plan) {
  std::vector<Step> steps;
  for (std::size_t stop = 0; stop < plan.stops.size(); ++stop)
    for (std::size_t display = 0; display < plan.displays.size(); ++display) {
      const std::size_t patterns = plan.displays[display].patterns.size();
      for (std::size_t pattern = 0; pattern < patterns; ++pattern)
        steps.push_back({steps.size(), static_cast<int>(stop), static_cast<int>(display),
                         static_cast<int>(pattern), pattern == 0, pattern + 1 == patterns});
    }
  return steps;
}

}  // namespace alhazen
