#include "drivers/sim/scene.h"

#include <toml++/toml.h>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>

#include "alhazen/caught.h"
#include "alhazen/settings.h"

namespace alhazen::sim {
namespace {

constexpr double kRadFromDeg = std::numbers::pi / 180;

/// A table of the file as Settings, which knows how to complain. Sub-tables are not values; they
/// are taken by name from the parent.
Result<Settings> settings_of(const toml::table& table, const std::string& file,
                             const std::string& name,
                             const std::set<std::string, std::less<>>& parts) {
  Settings out(file, name, std::filesystem::path(file).parent_path().string());
  for (const auto& [key, node] : table) {
    const std::string word(key.str());
    const int line = static_cast<int>(node.source().begin.line);
    const std::string place = file + ":" + std::to_string(line) + ": ";
    const std::string full = name.empty() ? word : name + "." + word;
    if (parts.contains(word)) continue;
    if (const auto* text = node.as_string()) {
      out.set(word, text->get(), line);
    } else if (const auto* flag = node.as_boolean()) {
      out.set(word, flag->get(), line);
    } else if (const auto* whole = node.as_integer()) {
      out.set(word, whole->get(), line);
    } else if (const auto* real = node.as_floating_point()) {
      out.set(word, real->get(), line);
    } else if (const auto* array = node.as_array()) {
      std::vector<double> numbers;
      for (const auto& item : *array) {
        const auto number = item.value<double>();
        if (!number)
          return Error{Code::invalid, place + "key '" + full + "' must be an array of numbers"};
        numbers.push_back(*number);
      }
      out.set(word, std::move(numbers), line);
    } else {
      return Error{Code::invalid, place + "unknown key '" + full + "'"};
    }
  }
  return out;
}

Result<Vec3> point(const Settings& from, std::string_view key) {
  const std::vector<double> numbers = ALHAZEN_TRY(from.numbers(key, 3));
  for (const double number : numbers)
    if (!(std::abs(number) <= 1e5))
      return Error{Code::invalid,
                   "key '" + std::string(key) + "' must be three numbers in [-100000, 100000]"};
  return Vec3(numbers[0], numbers[1], numbers[2]);
}

Result<Vec3> point_or(const Settings& from, std::string_view key, const Vec3& fallback) {
  return from.has(key) ? point(from, key) : Result<Vec3>(fallback);
}

Result<Micros> milliseconds_or(const Settings& from, std::string_view key, double fallback,
                               double min, double max) {
  return Micros(std::llround(1e3 * ALHAZEN_TRY(from.number_or(key, fallback, min, max))));
}

Error out_of(const std::string& file, const std::string& key, const std::string& given,
             const std::string& wanted) {
  return {Code::invalid, file + ": key '" + key + "' is " + given + "; it must be " + wanted};
}

/// Reads the parts of one file; keeps what all complaints need.
class Reader {
 public:
  Reader(const toml::table& root, std::string file) : root_(root), file_(std::move(file)) {}

  Result<Scene> read(const SceneOverrides& overrides) {
    const Settings top =
        ALHAZEN_TRY(settings_of(root_, file_, "",
                                {"renderer", "ambient", "object", "holder", "turntable", "sensor",
                                 "arc", "camera", "display", "fault"}));
    scene_.seed = static_cast<std::uint64_t>(ALHAZEN_TRY(top.integer_or("seed", 1, 0, INT64_MAX)));
    if (overrides.seed) scene_.seed = *overrides.seed;
    ALHAZEN_TRY(top.all_known());
    ALHAZEN_TRY(read_renderer());
    ALHAZEN_TRY(read_object(overrides));
    ALHAZEN_TRY(read_holder());
    ALHAZEN_TRY(read_table());
    ALHAZEN_TRY(read_sensor());
    ALHAZEN_TRY(read_cameras());
    ALHAZEN_TRY(read_displays());
    ALHAZEN_TRY(read_faults());
    return std::move(scene_);
  }

 private:
  /// The sub-table `name`; an absent one is empty, so that required keys complain by themselves.
  Result<Settings> part(const std::string& name) {
    const toml::node* node = root_.get(name);
    if (node == nullptr) return Settings(file_, name, "");
    if (!node->is_table())
      return Error{Code::invalid, file_ + ":" + std::to_string(node->source().begin.line) + ": '" +
                                      name + "' must be a table [" + name + "]"};
    return settings_of(*node->as_table(), file_, name, {});
  }
  /// The tables of an array [[name]].
  Result<std::vector<Settings>> parts(const std::string& name) {
    std::vector<Settings> out;
    const toml::node* node = root_.get(name);
    if (node == nullptr) return out;
    const Error wrong{Code::invalid, file_ + ":" + std::to_string(node->source().begin.line) +
                                         ": '" + name + "' must be tables [[" + name + "]]"};
    if (!node->is_array()) return wrong;
    for (const auto& item : *node->as_array()) {
      if (!item.is_table()) return wrong;
      out.push_back(ALHAZEN_TRY(
          settings_of(*item.as_table(), file_, name + "[" + std::to_string(out.size()) + "]", {})));
    }
    return out;
  }

  Status read_renderer() {
    const Settings from = ALHAZEN_TRY(part("renderer"));
    scene_.renderer.samples_across =
        static_cast<int>(ALHAZEN_TRY(from.integer_or("samples_across", 4, 2, 8)));
    scene_.renderer.path_depth =
        static_cast<int>(ALHAZEN_TRY(from.integer_or("path_depth", 3, 1, 16)));
    scene_.renderer.memory_bytes =
        static_cast<std::size_t>(ALHAZEN_TRY(from.integer_or("memory_mb", 1024, 1, 65536))) << 20;
    ALHAZEN_TRY(from.all_known());
    const Settings ambient = ALHAZEN_TRY(part("ambient"));
    scene_.ambient = ALHAZEN_TRY(ambient.number_or("radiance", 0, 0, 10));
    return ambient.all_known();
  }

  Status read_object(const SceneOverrides& overrides) {
    const Settings from = ALHAZEN_TRY(part("object"));
    ObjectTruth& object = scene_.object;
    std::string form = ALHAZEN_TRY(from.text("form"));
    object.reflectance = ALHAZEN_TRY(from.number_or("reflectance", 0.9, 0, 1));
    object.diffuse = ALHAZEN_TRY(from.number_or("diffuse", 0, 0, 1));
    if (overrides.object_mesh && form != "mesh")
      return Error{Code::invalid, file_ + ": an object mesh is given, but object.form is \"" +
                                      form + "\"; it must be \"mesh\""};
    constexpr double kMin = kSmallestSizeMm, kMax = kLargestSizeMm;
    if (form == "sphere") {
      object.form = Form::sphere;
      object.radius_mm = ALHAZEN_TRY(from.number("radius_mm", kMin, kMax));
    } else if (form == "torus") {
      object.form = Form::torus;
      object.ring_radius_mm = ALHAZEN_TRY(from.number("ring_radius_mm", kMin, kMax));
      object.tube_radius_mm =
          ALHAZEN_TRY(from.number("tube_radius_mm", kMin / 2, object.ring_radius_mm));
    } else if (form == "pits") {
      object.form = Form::pits;
      object.block_mm = ALHAZEN_TRY(point(from, "block_mm"));
      if (!(object.block_mm.minCoeff() >= kMin && object.block_mm.maxCoeff() <= kMax))
        return out_of(file_, "object.block_mm", "out of range", "three numbers in [1, 1000]");
      object.pit_count = static_cast<int>(ALHAZEN_TRY(from.integer("pit_count", 1, 100)));
      const double room = std::min(object.block_mm.x() / object.pit_count, object.block_mm.y()) / 2;
      object.pit_radius_mm = ALHAZEN_TRY(from.number("pit_radius_mm", 0.1, 0.98 * room));
      object.pit_depth_max_mm =
          ALHAZEN_TRY(from.number("pit_depth_max_mm", 0, 0.95 * object.block_mm.z()));
    } else if (form == "mesh") {
      object.form = Form::mesh;
      if (from.has("mesh")) object.mesh = ALHAZEN_TRY(from.path("mesh"));
      if (from.has("size_mm")) object.size_mm = ALHAZEN_TRY(from.number("size_mm", kMin, kMax));
      object.up = ALHAZEN_TRY(from.text_or("up", "z"));
      if (overrides.object_mesh) object.mesh = *overrides.object_mesh;
      if (overrides.object_size_mm) object.size_mm = *overrides.object_size_mm;
      if (overrides.object_up) object.up = *overrides.object_up;
      if (object.size_mm != 0 && !(object.size_mm >= kMin && object.size_mm <= kMax))
        return out_of(file_, "object.size_mm", std::to_string(object.size_mm),
                      "a number in [1, 1000]");
      static const std::set<std::string> kAxes{"x", "y", "z", "-x", "-y", "-z"};
      if (!kAxes.contains(object.up))
        return out_of(file_, "object.up", "\"" + object.up + "\"", "x, y, z, -x, -y or -z");
    } else {
      return out_of(file_, "object.form", "\"" + form + "\"", "sphere, torus, pits or mesh");
    }
    if (object.form == Form::mesh || object.form == Form::pits) {
      object.min_triangles = static_cast<std::size_t>(
          ALHAZEN_TRY(from.integer_or("min_triangles", 1'000'000, 4, 10'000'000)));
      object.crease_rad = kRadFromDeg * ALHAZEN_TRY(from.number_or("crease_deg", 30, 1, 180));
    }
    return from.all_known();
  }

  Status read_holder() {
    const Settings from = ALHAZEN_TRY(part("holder"));
    scene_.holder.radius_mm = ALHAZEN_TRY(from.number_or("radius_mm", 0, 0, 1000));
    scene_.holder.length_mm = ALHAZEN_TRY(from.number_or("length_mm", 0, 0, 10000));
    scene_.holder.albedo = ALHAZEN_TRY(from.number_or("albedo", 0.05, 0, 1));
    return from.all_known();
  }

  Status read_table() {
    const Settings from = ALHAZEN_TRY(part("turntable"));
    TableTruth& table = scene_.table;
    table.point_mm = ALHAZEN_TRY(point_or(from, "point_mm", Vec3::Zero()));
    const Vec3 direction = ALHAZEN_TRY(point_or(from, "direction", Vec3::UnitZ()));
    if (!(direction.norm() > 1e-6))
      return out_of(file_, "turntable.direction", "zero", "a direction");
    table.direction = direction.normalized();
    table.speed_rad_s = kRadFromDeg * ALHAZEN_TRY(from.number_or("speed_deg_s", 30, 0.01, 3600));
    table.acceleration_rad_s2 =
        kRadFromDeg * ALHAZEN_TRY(from.number_or("acceleration_deg_s2", 60, 0.01, 36000));
    table.backlash_rad = kRadFromDeg * ALHAZEN_TRY(from.number_or("backlash_deg", 0, 0, 10));
    table.position_error_rad =
        kRadFromDeg * ALHAZEN_TRY(from.number_or("position_error_deg", 0, 0, 10));
    table.wobble_rad = kRadFromDeg * ALHAZEN_TRY(from.number_or("wobble_deg", 0, 0, 10));
    table.encoder_step_rad =
        kRadFromDeg * ALHAZEN_TRY(from.number_or("encoder_step_deg", 1e-4, 1e-9, 10));
    table.min_rad = kRadFromDeg * ALHAZEN_TRY(from.number_or("min_deg", 0, -36000, 36000));
    table.max_rad = kRadFromDeg * ALHAZEN_TRY(from.number_or("max_deg", 0, -36000, 36000));
    if (table.max_rad < table.min_rad)
      return out_of(file_, "turntable.max_deg", "below min_deg", "min_deg (endless) or more");
    return from.all_known();
  }

  Status read_sensor() {
    const Settings from = ALHAZEN_TRY(part("sensor"));
    SensorTruth& sensor = scene_.sensor;
    sensor.bits = static_cast<int>(ALHAZEN_TRY(from.integer_or("bits", 8, 8, 16)));
    if (sensor.bits != 8 && sensor.bits != 12 && sensor.bits != 16)
      return out_of(file_, "sensor.bits", std::to_string(sensor.bits), "8, 12 or 16");
    sensor.full_well_e = ALHAZEN_TRY(from.number_or("full_well_e", 10000, 10, 1e7));
    sensor.read_noise_e = ALHAZEN_TRY(from.number_or("read_noise_e", 7, 0, 1e5));
    sensor.shot_noise = ALHAZEN_TRY(from.flag_or("shot_noise", true));
    sensor.black_level_share = ALHAZEN_TRY(from.number_or("black_level_share", 0.02, 0, 0.5));
    sensor.saturation_exposure =
        ALHAZEN_TRY(milliseconds_or(from, "saturation_exposure_ms", 12, 0.001, 1e6));
    sensor.exposure_min = ALHAZEN_TRY(milliseconds_or(from, "exposure_min_ms", 0.02, 0.001, 1e6));
    sensor.exposure_max = ALHAZEN_TRY(milliseconds_or(from, "exposure_max_ms", 1000, 0.001, 1e6));
    if (sensor.exposure_max < sensor.exposure_min)
      return out_of(file_, "sensor.exposure_max_ms", "below exposure_min_ms",
                    "exposure_min_ms or more");
    sensor.gain_max_db = ALHAZEN_TRY(from.number_or("gain_max_db", 24, 0, 60));
    sensor.readout = ALHAZEN_TRY(milliseconds_or(from, "readout_ms", 15, 0, 1e5));
    return from.all_known();
  }

  /// The arc that cameras stand on, evenly by elevation; [[camera]] tables change single ones.
  Status read_cameras() {
    const Settings from = ALHAZEN_TRY(part("arc"));
    const auto count = static_cast<int>(ALHAZEN_TRY(from.integer("cameras", 1, 64)));
    const std::vector<double> elevations = ALHAZEN_TRY(from.numbers("elevation_deg", 2));
    for (const double elevation : elevations)
      if (!(elevation >= -90 && elevation <= 90))
        return out_of(file_, "arc.elevation_deg", "out of range", "two numbers in [-90, 90]");
    const Mounting usual = ALHAZEN_TRY(read_mounting(from, Mounting{}, true));
    ALHAZEN_TRY(from.all_known());
    std::vector<Mounting> mountings(static_cast<std::size_t>(count), usual);
    for (int i = 0; i < count; ++i) {
      const double share = count > 1 ? static_cast<double>(i) / (count - 1) : 0;
      mountings[static_cast<std::size_t>(i)].elevation_deg =
          elevations[0] + share * (elevations[1] - elevations[0]);
    }
    for (const Settings& own : ALHAZEN_TRY(parts("camera"))) {
      const std::string id = ALHAZEN_TRY(own.text("id"));
      std::size_t index = 0;
      while (index < mountings.size() && id != "c" + std::to_string(index)) ++index;
      if (index == mountings.size())
        return out_of(file_, "camera.id", "\"" + id + "\"", "c0 … c" + std::to_string(count - 1));
      Mounting& mounting = mountings[index];
      mounting.elevation_deg =
          ALHAZEN_TRY(own.number_or("elevation_deg", mounting.elevation_deg, -90, 90));
      mounting = ALHAZEN_TRY(read_mounting(own, mounting, false));
      ALHAZEN_TRY(own.all_known());
    }
    for (std::size_t i = 0; i < mountings.size(); ++i)
      scene_.cameras.push_back(camera_of(mountings[i], "c" + std::to_string(i)));
    return {};
  }

  struct Mounting {
    double elevation_deg = 0, azimuth_deg = 0, distance_mm = 650, roll_deg = 0;
    Vec3 target_mm = Vec3::Zero();
    double mm_per_px = 0.15;  // at the target
    int width_px = 0, height_px = 0;
    Vec2 centre_px{0, 0};  // of projection, from the sensor's middle
    std::array<double, 8> distortion{};
  };

  static Result<Mounting> read_mounting(const Settings& from, Mounting out, bool required) {
    out.azimuth_deg = ALHAZEN_TRY(from.number_or("azimuth_deg", out.azimuth_deg, -360, 360));
    out.distance_mm = ALHAZEN_TRY(from.number_or("distance_mm", out.distance_mm, 10, 1e5));
    out.roll_deg = ALHAZEN_TRY(from.number_or("roll_deg", out.roll_deg, -360, 360));
    out.target_mm = ALHAZEN_TRY(point_or(from, "target_mm", out.target_mm));
    if (required || from.has("width_px"))
      out.width_px = static_cast<int>(ALHAZEN_TRY(from.integer("width_px", 8, 8192)));
    if (required || from.has("height_px"))
      out.height_px = static_cast<int>(ALHAZEN_TRY(from.integer("height_px", 8, 8192)));
    out.mm_per_px = ALHAZEN_TRY(from.number_or("mm_per_px", out.mm_per_px, 1e-4, 100));
    if (from.has("centre_offset_px")) {
      const std::vector<double> offset = ALHAZEN_TRY(from.numbers("centre_offset_px", 2));
      out.centre_px = {offset[0], offset[1]};
    }
    if (from.has("distortion")) {
      const std::vector<double> k = ALHAZEN_TRY(from.numbers("distortion", 8));
      std::copy(k.begin(), k.end(), out.distortion.begin());
    }
    return out;
  }

  static CameraTruth camera_of(const Mounting& from, std::string id) {
    const double up = kRadFromDeg * from.elevation_deg, round = kRadFromDeg * from.azimuth_deg;
    const Vec3 outward(std::cos(up) * std::cos(round), std::cos(up) * std::sin(round),
                       std::sin(up));
    CameraTruth out;
    out.id = std::move(id);
    out.width_px = from.width_px;
    out.height_px = from.height_px;
    const double focal_px = from.distance_mm / from.mm_per_px;
    out.lens = {focal_px, focal_px, (from.width_px - 1) / 2.0 + from.centre_px.x(),
                (from.height_px - 1) / 2.0 + from.centre_px.y(), from.distortion};
    const Rigid rig_from_camera{upright_axes(-outward, kRadFromDeg * from.roll_deg),
                                from.target_mm + from.distance_mm * outward};
    out.camera_from_rig = rig_from_camera.inverse();
    return out;
  }

  Status read_displays() {
    for (const Settings& from : ALHAZEN_TRY(parts("display"))) {
      DisplayTruth display;
      display.id = ALHAZEN_TRY(from.text("id"));
      for (const DisplayTruth& other : scene_.displays)
        if (other.id == display.id)
          return out_of(file_, "display.id", "\"" + display.id + "\" twice",
                        "different for each display");
      display.width_px = static_cast<int>(ALHAZEN_TRY(from.integer("width_px", 2, 16384)));
      display.height_px = static_cast<int>(ALHAZEN_TRY(from.integer("height_px", 2, 16384)));
      const double pitch = ALHAZEN_TRY(from.number("pitch_mm", 1e-3, 100));
      const Vec3 centre = ALHAZEN_TRY(point(from, "centre_mm"));
      const Vec3 faces = ALHAZEN_TRY(point(from, "faces_mm"));
      const double roll = kRadFromDeg * ALHAZEN_TRY(from.number_or("roll_deg", 0, -360, 360));
      if (!((centre - faces).norm() > 1e-6))
        return out_of(file_, "display.faces_mm", "the display's own centre",
                      "a point in front of it");
      const Eigen::Matrix3d axes = upright_axes(centre - faces, roll);
      display.u_mm = pitch * axes.col(0);
      display.v_mm = pitch * axes.col(1);
      display.origin_mm = centre - (display.width_px - 1) / 2.0 * display.u_mm -
                          (display.height_px - 1) / 2.0 * display.v_mm;
      const std::string mount = ALHAZEN_TRY(from.text_or("mount", "rig"));
      if (mount != "rig" && mount != "turntable")
        return out_of(file_, "display.mount", "\"" + mount + "\"", "rig or turntable");
      display.fixed = mount == "rig" ? Fixed::to_rig : Fixed::to_turntable;
      display.gamma = ALHAZEN_TRY(from.number_or("gamma", 2.2, 0.5, 4));
      display.black_share = ALHAZEN_TRY(from.number_or("black_share", 0.001, 0, 0.5));
      display.refresh_hz = ALHAZEN_TRY(from.number_or("refresh_hz", 60, 1, 1000));
      display.latency = ALHAZEN_TRY(milliseconds_or(from, "latency_ms", 20, 0, 10000));
      display.response = ALHAZEN_TRY(milliseconds_or(from, "response_ms", 12, 0, 10000));
      ALHAZEN_TRY(from.all_known());
      scene_.displays.push_back(std::move(display));
    }
    return {};
  }

  Status read_faults() {
    for (const Settings& from : ALHAZEN_TRY(parts("fault"))) {
      FaultRule rule;
      rule.device = ALHAZEN_TRY(from.text("device"));
      const bool is_camera = std::any_of(scene_.cameras.begin(), scene_.cameras.end(),
                                         [&](const auto& c) { return c.id == rule.device; });
      const bool is_display = std::any_of(scene_.displays.begin(), scene_.displays.end(),
                                          [&](const auto& d) { return d.id == rule.device; });
      if (!is_camera && !is_display && rule.device != "turntable")
        return out_of(file_, "fault.device", "\"" + rule.device + "\"",
                      "the id of a camera or display, or turntable");
      rule.call = ALHAZEN_TRY(from.integer("call", 1, INT64_MAX));
      rule.once = ALHAZEN_TRY(from.flag_or("once", true));
      rule.delay = ALHAZEN_TRY(milliseconds_or(from, "delay_ms", 500, 0, 1e6));
      const std::string kind = ALHAZEN_TRY(from.text("kind"));
      constexpr std::string_view kKinds[] = {"timeout", "corrupt",       "stale",
                                             "lost",    "lost_for_good", "slow"};
      const auto* found = std::find(std::begin(kKinds), std::end(kKinds), kind);
      if (found == std::end(kKinds))
        return out_of(file_, "fault.kind", "\"" + kind + "\"",
                      "timeout, corrupt, stale, lost, lost_for_good or slow");
      rule.kind = static_cast<FaultKind>(found - std::begin(kKinds));
      // What delivers nothing cannot deliver it damaged.
      const bool about_data = rule.kind == FaultKind::corrupt || rule.kind == FaultKind::stale;
      if (about_data && !is_camera && !(is_display && rule.kind == FaultKind::stale))
        return out_of(file_, "fault.kind", "\"" + kind + "\" for " + rule.device,
                      "corrupt for a camera, stale for a camera or display");
      const std::set<std::string> calls =
          is_camera    ? std::set<std::string>{"configure", "trigger", "wait_frame"}
          : is_display ? std::set<std::string>{"show"}
                       : std::set<std::string>{"home", "move_to"};
      rule.on = ALHAZEN_TRY(from.text_or("on", about_data && is_camera ? "wait_frame" : ""));
      if (!rule.on.empty() &&
          (!calls.contains(rule.on) || (about_data && is_camera && rule.on != "wait_frame")))
        return out_of(file_, "fault.on", "\"" + rule.on + "\"",
                      "a call of that device that this fault fits");
      ALHAZEN_TRY(from.all_known());
      scene_.faults.push_back(std::move(rule));
    }
    return {};
  }

  const toml::table& root_;
  std::string file_;
  Scene scene_;
};

}  // namespace

Result<Scene> Scene::load(const std::filesystem::path& file, const SceneOverrides& overrides) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  if (!stream || !(text << stream.rdbuf()))
    return Error{Code::unavailable, file.string() + ": the world file cannot be read"};
  toml::table root;
  try {
    root = toml::parse(text.str(), file.string());
  } catch (const toml::parse_error& e) {
    return Error{Code::invalid, file.string() + ":" + std::to_string(e.source().begin.line) + ": " +
                                    std::string(e.description())};
  }
  return caught(Code::internal, "world file",
                [&] { return Reader(root, file.string()).read(overrides); });
}

}  // namespace alhazen::sim
