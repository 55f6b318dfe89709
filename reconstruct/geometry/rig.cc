#include "reconstruct/geometry/rig.h"

#include <xxhash.h>

#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "alhazen/caught.h"

namespace alhazen {
namespace {

using Json = nlohmann::json;

/// A rig of thousands of devices is a mistake, not a laboratory.
constexpr std::size_t kMaxDevices = 256;
constexpr std::uintmax_t kMaxFileBytes = 16U << 20U;

Error wrong(const std::string& key, const std::string& wanted) {
  return {Code::invalid, "key '" + key + "' must be " + wanted};
}

Result<const Json*> member(const Json& object, const std::string& key, const std::string& path) {
  if (!object.is_object()) return wrong(path, "an object");
  const auto found = object.find(key);
  if (found == object.end())
    return Error{Code::invalid, "key '" + path + "." + key + "' is missing"};
  return &*found;
}

Status only_keys(const Json& object, const std::set<std::string>& known, const std::string& path) {
  if (!object.is_object()) return wrong(path, "an object");
  for (const auto& [key, value] : object.items())
    if (known.count(key) == 0)
      return Error{Code::invalid, "unknown key '" + path + "." + key + "'"};
  return {};
}

Result<double> finite(const Json& value, const std::string& path) {
  if (!value.is_number()) return wrong(path, "a number");
  const double number = value.get<double>();
  if (!std::isfinite(number)) return wrong(path, "a finite number");
  return number;
}

Result<int> size_px(const Json& object, const std::string& key, const std::string& path) {
  const Json* value = ALHAZEN_TRY(member(object, key, path));
  const std::string range = "a whole number in [1, 65535]";
  if (!value->is_number_integer()) return wrong(path + "." + key, range);
  const auto number = value->get<std::int64_t>();
  if (number < 1 || number > 65535) return wrong(path + "." + key, range);
  return static_cast<int>(number);
}

Result<std::string> name(const Json& object, const std::string& path) {
  const Json* value = ALHAZEN_TRY(member(object, "name", path));
  const std::string wanted = "1 to 32 characters of a-z 0-9 _ -";
  if (!value->is_string()) return wrong(path + ".name", wanted);
  auto text = value->get<std::string>();
  if (text.empty() || text.size() > 32 ||
      text.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_-") != std::string::npos)
    return wrong(path + ".name", wanted);
  return text;
}

/// `rows` × `columns` numbers as nested lists (a vector where rows is 1: one list).
Result<Eigen::MatrixXd> matrix(const Json& object, const std::string& key, const std::string& path,
                               int rows, int columns) {
  const Json* value = ALHAZEN_TRY(member(object, key, path));
  const std::string at = path + "." + key;
  const std::string wanted =
      rows == 1 ? "a list of " + std::to_string(columns) + " numbers"
                : std::to_string(rows) + " lists of " + std::to_string(columns) + " numbers";
  Eigen::MatrixXd out(rows, columns);
  if (!value->is_array() || (rows > 1 && value->size() != static_cast<std::size_t>(rows)))
    return wrong(at, wanted);
  for (int r = 0; r < rows; ++r) {
    const Json& row = rows == 1 ? *value : (*value)[static_cast<std::size_t>(r)];
    if (!row.is_array() || row.size() != static_cast<std::size_t>(columns))
      return wrong(at, wanted);
    for (int c = 0; c < columns; ++c)
      out(r, c) = ALHAZEN_TRY(finite(row[static_cast<std::size_t>(c)], at));
  }
  return out;
}

Result<Pose> pose(const Json& object, const std::string& key, const std::string& path) {
  const Eigen::MatrixXd m = ALHAZEN_TRY(matrix(object, key, path, 4, 4));
  const Eigen::Matrix3d rotation = m.topLeftCorner<3, 3>();
  const double off =
      (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off < 1e-6) || !(rotation.determinant() > 0))
    return wrong(path + "." + key,
                 "a rigid transform: rotation orthonormal to 1e-6 and right-handed");
  if ((m.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-12)
    return wrong(path + "." + key, "a rigid transform with the last row 0 0 0 1");
  return Pose{rotation, m.topRightCorner<3, 1>()};
}

Result<CameraModel> camera(const Json& json, const std::string& path) {
  ALHAZEN_TRY(only_keys(
      json, {"name", "width_px", "height_px", "K", "distortion", "camera_from_rig"}, path));
  CameraModel out;
  out.name = ALHAZEN_TRY(name(json, path));
  out.width_px = ALHAZEN_TRY(size_px(json, "width_px", path));
  out.height_px = ALHAZEN_TRY(size_px(json, "height_px", path));
  const Eigen::MatrixXd k = ALHAZEN_TRY(matrix(json, "K", path, 3, 3));
  if (k(0, 1) != 0 || k(1, 0) != 0 || k(2, 0) != 0 || k(2, 1) != 0 || k(2, 2) != 1 ||
      !(k(0, 0) > 0) || !(k(1, 1) > 0))
    return wrong(path + ".K", "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above 0");
  out.fx_px = k(0, 0);
  out.fy_px = k(1, 1);
  out.cx_px = k(0, 2);
  out.cy_px = k(1, 2);
  const Json* distortion = ALHAZEN_TRY(member(json, "distortion", path));
  if (!distortion->is_array() || (distortion->size() != 0 && distortion->size() != 4 &&
                                  distortion->size() != 5 && distortion->size() != 8))
    return wrong(path + ".distortion", "a list of 0, 4, 5 or 8 numbers: k1 k2 p1 p2 k3 k4 k5 k6");
  for (std::size_t i = 0; i < distortion->size(); ++i)
    out.distortion.at(i) = ALHAZEN_TRY(finite((*distortion)[i], path + ".distortion"));
  out.camera_from_rig = ALHAZEN_TRY(pose(json, "camera_from_rig", path));
  return out;
}

Result<DisplayModel> display(const Json& json, const std::string& path) {
  ALHAZEN_TRY(only_keys(
      json, {"name", "width_px", "height_px", "origin_mm", "u_mm", "v_mm", "mount", "gamma"},
      path));
  DisplayModel out;
  out.name = ALHAZEN_TRY(name(json, path));
  out.width_px = ALHAZEN_TRY(size_px(json, "width_px", path));
  out.height_px = ALHAZEN_TRY(size_px(json, "height_px", path));
  out.origin_mm = ALHAZEN_TRY(matrix(json, "origin_mm", path, 1, 3)).transpose();
  out.u_mm = ALHAZEN_TRY(matrix(json, "u_mm", path, 1, 3)).transpose();
  out.v_mm = ALHAZEN_TRY(matrix(json, "v_mm", path, 1, 3)).transpose();
  const double area = out.u_mm.cross(out.v_mm).norm();
  if (!(area > 1e-3 * out.u_mm.norm() * out.v_mm.norm()) || !(area > 1e-12))
    return wrong(path + ".v_mm", "a vector that is not parallel to u_mm; neither may be zero");
  if (const auto gamma = json.find("gamma"); gamma != json.end()) {
    out.gamma = ALHAZEN_TRY(finite(*gamma, path + ".gamma"));
    if (!(out.gamma >= 0.5 && out.gamma <= 4)) return wrong(path + ".gamma", "in [0.5, 4]");
  }
  const Json* mount = ALHAZEN_TRY(member(json, "mount", path));
  if (*mount == "rig") {
    out.mount = Mount::rig;
  } else if (*mount == "turntable") {
    out.mount = Mount::turntable;
  } else {
    return wrong(path + ".mount", "\"rig\" or \"turntable\"");
  }
  return out;
}

template <class Device, class ReadOne>
Status read_devices(const Json& root, const std::string& key, std::size_t fewest,
                    std::vector<Device>& out, ReadOne read_one) {
  const Json* list = ALHAZEN_TRY(member(root, key, "rig"));
  if (!list->is_array() || list->size() < fewest || list->size() > kMaxDevices)
    return wrong("rig." + key, "a list of " + std::to_string(fewest) + " to " +
                                   std::to_string(kMaxDevices) + " objects");
  std::set<std::string> names;
  for (std::size_t i = 0; i < list->size(); ++i) {
    const std::string path = "rig." + key + "[" + std::to_string(i) + "]";
    Device device = ALHAZEN_TRY(read_one((*list)[i], path));
    if (!names.insert(device.name).second)
      return Error{Code::invalid, "key '" + path + ".name': '" + device.name + "' is there twice"};
    out.push_back(std::move(device));
  }
  return {};
}

Json list(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

template <class Devices>
auto* find_named(Devices& devices, std::string_view wanted) {
  for (auto& device : devices)
    if (device.name == wanted) return &device;
  return static_cast<decltype(&devices.front())>(nullptr);
}

Result<Rig> read_rig(std::string_view text) {
  const Json root = Json::parse(text);
  ALHAZEN_TRY(only_keys(root, {"cameras", "displays", "turntable"}, "rig"));
  Rig rig;
  ALHAZEN_TRY(read_devices(root, "cameras", 1, rig.cameras, camera));
  // Normal maps need none.
  ALHAZEN_TRY(read_devices(root, "displays", 0, rig.displays, display));
  const Json* table = ALHAZEN_TRY(member(root, "turntable", "rig"));
  ALHAZEN_TRY(only_keys(*table, {"point_mm", "direction"}, "rig.turntable"));
  rig.turntable.point_mm =
      ALHAZEN_TRY(matrix(*table, "point_mm", "rig.turntable", 1, 3)).transpose();
  rig.turntable.direction =
      ALHAZEN_TRY(matrix(*table, "direction", "rig.turntable", 1, 3)).transpose();
  if (!(std::abs(rig.turntable.direction.norm() - 1) < 1e-6))
    return wrong("rig.turntable.direction", "a unit vector");
  return rig;
}

}  // namespace

const CameraModel* Rig::camera(std::string_view name) const { return find_named(cameras, name); }

const DisplayModel* Rig::display(std::string_view name) const { return find_named(displays, name); }

Result<Rig> Rig::parse(std::string_view json) {
  return caught(Code::invalid, "rig.json", [&] { return read_rig(json); });
}

Result<Rig> Rig::load(const std::filesystem::path& file) {
  std::error_code failed;
  const std::uintmax_t bytes = std::filesystem::file_size(file, failed);
  if (failed)
    return Error{Code::unavailable, "cannot read " + file.string() + ": " + failed.message()};
  if (bytes > kMaxFileBytes)
    return Error{Code::invalid, file.string() + " has " + std::to_string(bytes) +
                                    " bytes; a rig file has at most " +
                                    std::to_string(kMaxFileBytes)};
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  if (!stream) return Error{Code::unavailable, "cannot read " + file.string()};
  return parse(text.str()).in(file.string());
}

std::string Rig::to_json() const {
  Json root = {
      {"cameras", Json::array()},
      {"displays", Json::array()},
      {"turntable",
       {{"point_mm", list(turntable.point_mm)}, {"direction", list(turntable.direction)}}}};
  for (const CameraModel& camera : cameras) {
    Json pose = Json::array();
    const Eigen::Matrix3d& r = camera.camera_from_rig.rotation;
    for (int i = 0; i < 3; ++i)
      pose.push_back({r(i, 0), r(i, 1), r(i, 2), camera.camera_from_rig.translation_mm(i)});
    pose.push_back({0, 0, 0, 1});
    root["cameras"].push_back(
        {{"name", camera.name},
         {"width_px", camera.width_px},
         {"height_px", camera.height_px},
         {"K", {{camera.fx_px, 0, camera.cx_px}, {0, camera.fy_px, camera.cy_px}, {0, 0, 1}}},
         {"distortion", camera.distortion},
         {"camera_from_rig", pose}});
  }
  for (const DisplayModel& display : displays)
    root["displays"].push_back({{"name", display.name},
                                {"width_px", display.width_px},
                                {"height_px", display.height_px},
                                {"origin_mm", list(display.origin_mm)},
                                {"u_mm", list(display.u_mm)},
                                {"v_mm", list(display.v_mm)},
                                {"mount", display.mount == Mount::rig ? "rig" : "turntable"},
                                {"gamma", display.gamma}});
  return root.dump(1);
}

std::string Rig::hash() const {
  const std::string text = to_json();
  std::ostringstream hex;
  hex << std::hex;
  hex.width(16);
  hex.fill('0');
  hex << XXH3_64bits(text.data(), text.size());
  return hex.str();
}

}  // namespace alhazen
