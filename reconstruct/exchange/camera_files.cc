#include "reconstruct/exchange/camera_files.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "alhazen/caught.h"
#include "reconstruct/exchange/document.h"
#include "reconstruct/scan/limits.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

using Json = nlohmann::json;

constexpr std::uint64_t kMaxCameraFileBytes = 4U << 20U;
// images.txt holds the observed points of every picture, which are passed over.
constexpr std::uint64_t kMaxColmapBytes = std::uint64_t{1} << 30;

/// A key as it is compared: without case, '_' and '-'.
std::string plain(std::string_view key) {
  std::string out;
  for (const char c : key) {
    if (c == '_' || c == '-') continue;
    out += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  }
  return out;
}

/// A value of the file, and under what key it stood.
struct Found {
  const Json* value = nullptr;
  std::string key;
  explicit operator bool() const { return value != nullptr; }
};

/// The keys of a camera file, by their plain names.
class Keys {
 public:
  Keys(const Json& root, std::string_view suffix) : suffix_(plain(suffix)) {
    for (const auto& [key, value] : root.items())
      found_.try_emplace(plain(key), Found{&value, key});
  }
  /// The first of `names` (each with the suffix) that is there.
  [[nodiscard]] Found find(std::initializer_list<const char*> names) const {
    return find_with(names, suffix_);
  }
  /// As find(); cameras of one file may share a value, whose key then has no suffix.
  [[nodiscard]] Found find_shared(std::initializer_list<const char*> names) const {
    const Found own = find(names);
    return own ? own : find_with(names, "");
  }

 private:
  [[nodiscard]] Found find_with(std::initializer_list<const char*> names,
                                const std::string& suffix) const {
    for (const char* name : names) {
      const auto at = found_.find(name + suffix);
      if (at != found_.end()) return at->second;
    }
    return {};
  }
  std::string suffix_;
  std::map<std::string, Found> found_;
};

Error wrong(const Found& found, const std::string& wanted) {
  return {Code::invalid, "key '" + found.key.substr(0, 60) + "' must be " + wanted};
}

Result<double> number_of(const Found& found) {
  if (!found.value->is_number() || !std::isfinite(found.value->get<double>()))
    return wrong(found, "a finite number");
  return found.value->get<double>();
}

/// All numbers of a list, of lists in a list, or of a matrix {rows, cols, data}, row by row.
Result<std::vector<double>> numbers_of(const Found& found) {
  const Json* list = found.value;
  if (list->is_object()) {
    const auto data = list->find("data");
    if (data == list->end()) return wrong(found, "a matrix with 'data', or a list");
    list = &*data;
  }
  std::vector<double> out;
  const auto add = [&](const Json& value) {
    if (!value.is_number() || !std::isfinite(value.get<double>())) return false;
    out.push_back(value.get<double>());
    return true;
  };
  bool is_good = true;
  if (list->is_array()) {
    for (const Json& row : *list) {
      if (row.is_array()) {
        for (const Json& value : row) is_good = is_good && add(value);
      } else {
        is_good = is_good && add(row);
      }
    }
  } else if (!list->is_null()) {
    is_good = add(*list);  // XML's matrix of a single number
  }
  if (!is_good) return wrong(found, "a list of finite numbers");
  return out;
}

Result<int> side_of(const Found& found, double side) {
  if (!(side >= 1 && side <= limits::kSide_px) || side != std::floor(side))
    return wrong(found, "whole numbers in [1, 65535]");
  return static_cast<int>(side);
}

Status read_matrix(const Keys& keys, CameraModel& model) {
  const Found matrix = keys.find({"cameramatrix", "k", "m", "mtx", "intrinsicmatrix", "intrinsic",
                                  "intrinsics", "cameraintrinsics", "camint"});
  if (matrix) {
    const std::vector<double> k = ALHAZEN_TRY(numbers_of(matrix));
    if (k.size() != 9 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1 || !(k[0] > 0) ||
        !(k[4] > 0))
      return wrong(matrix, "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy above 0");
    if (k[1] != 0) {
      return Error{Code::unsupported, "key '" + matrix.key + "' has skew " + std::to_string(k[1]) +
                                          "; only cameras without skew are supported"};
    }
    model.fx_px = k[0];
    model.fy_px = k[4];
    model.cx_px = k[2];
    model.cy_px = k[5];
    return {};
  }
  const std::array<std::pair<Found, double*>, 4> single = {{
      {keys.find({"camera.fx", "fx"}), &model.fx_px},
      {keys.find({"camera.fy", "fy"}), &model.fy_px},
      {keys.find({"camera.cx", "cx"}), &model.cx_px},
      {keys.find({"camera.cy", "cy"}), &model.cy_px},
  }};
  for (const auto& [found, target] : single) {
    if (!found) {
      return Error{Code::invalid,
                   "key 'camera_matrix' is missing, and so is any of its other names (K, M, mtx, "
                   "intrinsic_matrix, fx fy cx cy)"};
    }
    *target = ALHAZEN_TRY(number_of(found));
  }
  if (!(model.fx_px > 0)) return wrong(single[0].first, "above 0");
  if (!(model.fy_px > 0)) return wrong(single[1].first, "above 0");
  return {};
}

Status read_distortion(const Keys& keys, CameraModel& model) {
  const Found kind = keys.find_shared({"distortionmodel", "cameratype", "camera.type"});
  if (kind && kind.value->is_string()) {
    const std::string word = plain(kind.value->get<std::string>());
    const std::set<std::string> known = {"plumbbob", "rationalpolynomial", "radtan",  "opencv",
                                         "pinhole",  "brownconrady",       "standard"};
    if (!known.contains(word)) {
      return Error{Code::unsupported, "key '" + kind.key + "' is '" +
                                          kind.value->get<std::string>().substr(0, 60) +
                                          "'; only OpenCV's pinhole distortion is supported"};
    }
  }
  const Found list =
      keys.find({"distortioncoefficients", "distcoeffs", "distcoeff", "distcoefs",
                 "distortionparameters", "distortions", "distortion", "dist", "d", "camdist"});
  if (list) {
    const std::vector<double> d = ALHAZEN_TRY(numbers_of(list));
    constexpr std::array<std::size_t, 6> kCounts = {0, 4, 5, 8, 12, 14};
    if (std::find(kCounts.begin(), kCounts.end(), d.size()) == kCounts.end())
      return wrong(list, "0, 4, 5, 8, 12 or 14 numbers: k1 k2 p1 p2 k3 k4 k5 k6 …");
    for (std::size_t i = 0; i < d.size(); ++i) {
      if (i < model.distortion.size()) {
        model.distortion.at(i) = d[i];
      } else if (d[i] != 0) {
        return Error{Code::unsupported,
                     "key '" + list.key + "' has a thin prism or a tilted sensor (number " +
                         std::to_string(i + 1) + " is not 0), which is not supported"};
      }
    }
    return {};
  }
  constexpr std::array<std::pair<const char*, const char*>, 8> kSingle = {{{"camera.k1", "k1"},
                                                                           {"camera.k2", "k2"},
                                                                           {"camera.p1", "p1"},
                                                                           {"camera.p2", "p2"},
                                                                           {"camera.k3", "k3"},
                                                                           {"camera.k4", "k4"},
                                                                           {"camera.k5", "k5"},
                                                                           {"camera.k6", "k6"}}};
  bool is_any = false;
  for (std::size_t i = 0; i < kSingle.size(); ++i) {
    const Found found = keys.find({kSingle[i].first, kSingle[i].second});
    if (!found) continue;
    is_any = true;
    model.distortion.at(i) = ALHAZEN_TRY(number_of(found));
  }
  if (!is_any) {
    return Error{Code::invalid,
                 "key 'distortion_coefficients' is missing, and so is any of its other names "
                 "(dist_coeffs, D, distortion, k1 k2 p1 p2 k3); a camera without distortion says "
                 "[0, 0, 0, 0]"};
  }
  return {};
}

Status read_size(const Keys& keys, ForeignCamera& camera) {
  const Found width = keys.find_shared({"imagewidth", "width", "camera.width"});
  const Found height = keys.find_shared({"imageheight", "height", "camera.height"});
  if (width && height) {
    camera.model.width_px = ALHAZEN_TRY(side_of(width, ALHAZEN_TRY(number_of(width))));
    camera.model.height_px = ALHAZEN_TRY(side_of(height, ALHAZEN_TRY(number_of(height))));
    camera.has_size = true;
    return {};
  }
  const Found both = keys.find_shared({"imagesize", "resolution", "size"});
  if (!both) return {};
  const std::vector<double> sides = ALHAZEN_TRY(numbers_of(both));
  if (sides.size() != 2) return wrong(both, "width and height");
  camera.model.width_px = ALHAZEN_TRY(side_of(both, sides[0]));
  camera.model.height_px = ALHAZEN_TRY(side_of(both, sides[1]));
  camera.has_size = true;
  return {};
}

Status read_pose(const Keys& keys, double unit_mm, ForeignCamera& camera) {
  Pose& pose = camera.model.camera_from_rig;
  if (const Found whole = keys.find({"camerafromrig"})) {
    const std::vector<double> m = ALHAZEN_TRY(numbers_of(whole));
    if (m.size() != 16) return wrong(whole, "4 x 4 numbers");
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix(m.data());
    pose.rotation = matrix.topLeftCorner<3, 3>();
    pose.translation_mm = unit_mm * matrix.topRightCorner<3, 1>();
    camera.has_pose = true;  // whether it is rigid is Rig::parse()'s to tell
    return {};
  }
  const Found turn = keys.find({"rvec"}), shift = keys.find({"tvec"});
  if (!turn || !shift) return {};
  const std::vector<double> r = ALHAZEN_TRY(numbers_of(turn));
  const std::vector<double> t = ALHAZEN_TRY(numbers_of(shift));
  if (r.size() != 3) return wrong(turn, "3 numbers");
  if (t.size() != 3) return wrong(shift, "3 numbers");
  const Eigen::Vector3d axis(r[0], r[1], r[2]);
  const double angle_rad = axis.norm();
  if (angle_rad > 0)
    pose.rotation = Eigen::AngleAxisd(angle_rad, axis / angle_rad).toRotationMatrix();
  pose.translation_mm = unit_mm * Eigen::Vector3d(t[0], t[1], t[2]);
  camera.has_pose = true;
  return {};
}

// COLMAP ------------------------------------------------------------------------------------------

/// Where the parameters of a COLMAP camera model go: 0 fx, 1 fy, 2 cx, 3 cy, 4 … 11 distortion, and
/// kFocal both focal lengths.
constexpr int kFocal = -1;
struct ColmapKind {
  std::string_view name;
  std::vector<int> places;
};
const std::vector<ColmapKind>& colmap_kinds() {
  static const std::vector<ColmapKind> kinds = {
      {"SIMPLE_PINHOLE", {kFocal, 2, 3}},   {"PINHOLE", {0, 1, 2, 3}},
      {"SIMPLE_RADIAL", {kFocal, 2, 3, 4}}, {"RADIAL", {kFocal, 2, 3, 4, 5}},
      {"OPENCV", {0, 1, 2, 3, 4, 5, 6, 7}}, {"FULL_OPENCV", {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}},
  };
  return kinds;
}

/// One line of a COLMAP file, word by word.
class Words {
 public:
  Words(std::string_view line, std::string where) : line_(line), where_(std::move(where)) {}

  /// Empty where nothing is left.
  std::string_view word() {
    constexpr std::string_view kBlanks = " \t\r";
    const std::size_t begin = std::min(line_.find_first_not_of(kBlanks), line_.size());
    line_.remove_prefix(begin);
    const std::size_t end = std::min(line_.find_first_of(kBlanks), line_.size());
    const std::string_view out = line_.substr(0, end);
    line_.remove_prefix(end);
    return out;
  }
  Result<double> number(const char* what) {
    const std::string_view text = word();
    double value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (text.empty() || error != std::errc() || end != text.data() + text.size() ||
        !std::isfinite(value))
      return complaint(std::string(what) + " must be a finite number");
    return value;
  }
  Result<std::int64_t> whole(const char* what, std::int64_t lowest, std::int64_t highest) {
    const std::string_view text = word();
    std::int64_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (text.empty() || error != std::errc() || end != text.data() + text.size() ||
        value < lowest || value > highest)
      return complaint(std::string(what) + " must be a whole number in [" + std::to_string(lowest) +
                       ", " + std::to_string(highest) + "]");
    return value;
  }
  /// What is left, without blanks around it: names may hold blanks.
  [[nodiscard]] std::string_view rest() const {
    const std::size_t begin = line_.find_first_not_of(" \t\r");
    if (begin == std::string_view::npos) return {};
    return line_.substr(begin, line_.find_last_not_of(" \t\r") - begin + 1);
  }
  [[nodiscard]] Error complaint(const std::string& what) const {
    return {Code::invalid, where_ + ": " + what};
  }

 private:
  std::string_view line_;
  std::string where_;
};

/// Calls body(words) for each line that is neither empty nor a comment. `then_skips`: the line
/// after it, whatever it is, belongs to it and is passed over.
template <class Body>
Status for_each_line(std::string_view text, const char* file, bool then_skips, const Body& body) {
  for (std::size_t number = 1, begin = 0; begin < text.size(); ++number) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    Words words(text.substr(begin, end - begin),
                std::string(file) + " line " + std::to_string(number));
    begin = end + 1;
    if (words.rest().empty() || words.rest().starts_with('#')) continue;
    ALHAZEN_TRY(body(words));
    if (!then_skips || begin >= text.size()) continue;
    begin = std::min(text.find('\n', begin), text.size()) + 1;
    ++number;
  }
  return {};
}

constexpr std::int64_t kMaxId = std::int64_t{1} << 62;

Status read_colmap_camera(Words& words, std::map<std::int64_t, ForeignCamera>& cameras) {
  const std::int64_t id = ALHAZEN_TRY(words.whole("CAMERA_ID", 0, kMaxId));
  const std::string_view model = words.word();
  const auto kind = std::find_if(colmap_kinds().begin(), colmap_kinds().end(),
                                 [&](const ColmapKind& k) { return k.name == model; });
  if (kind == colmap_kinds().end()) {
    Error error = words.complaint("camera model '" + std::string(model.substr(0, 40)) +
                                  "' is not supported; possible: SIMPLE_PINHOLE, PINHOLE, "
                                  "SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV");
    error.code = Code::unsupported;
    return error;
  }
  ForeignCamera camera;
  camera.model.width_px = static_cast<int>(ALHAZEN_TRY(words.whole("WIDTH", 1, limits::kSide_px)));
  camera.model.height_px =
      static_cast<int>(ALHAZEN_TRY(words.whole("HEIGHT", 1, limits::kSide_px)));
  camera.has_size = true;
  for (const int place : kind->places) {
    const double value = ALHAZEN_TRY(words.number("PARAMS"));
    if (place == kFocal) {
      camera.model.fx_px = camera.model.fy_px = value;
    } else if (place < 4) {
      const std::array<double*, 4> into = {&camera.model.fx_px, &camera.model.fy_px,
                                           &camera.model.cx_px, &camera.model.cy_px};
      *into.at(static_cast<std::size_t>(place)) = place < 2 ? value : value - 0.5;
    } else {
      camera.model.distortion.at(static_cast<std::size_t>(place - 4)) = value;
    }
  }
  if (!words.rest().empty())
    return words.complaint(std::string(model) + " has " + std::to_string(kind->places.size()) +
                           " parameters");
  if (!(camera.model.fx_px > 0) || !(camera.model.fy_px > 0))
    return words.complaint("focal lengths must be above 0");
  if (!cameras.emplace(id, camera).second)
    return words.complaint("camera " + std::to_string(id) + " is there twice");
  return {};
}

Status read_colmap_image(Words& words, const std::map<std::int64_t, ForeignCamera>& cameras,
                         double unit_mm, std::vector<ForeignCamera>& out) {
  static_cast<void>(ALHAZEN_TRY(words.whole("IMAGE_ID", 0, kMaxId)));
  std::array<double, 4> q{};
  for (double& part : q) part = ALHAZEN_TRY(words.number("QW QX QY QZ"));
  Eigen::Vector3d shift;
  for (int axis = 0; axis < 3; ++axis) shift[axis] = ALHAZEN_TRY(words.number("TX TY TZ"));
  const std::int64_t id = ALHAZEN_TRY(words.whole("CAMERA_ID", 0, kMaxId));
  const std::string name(words.rest());
  const Eigen::Quaterniond turn(q[0], q[1], q[2], q[3]);
  if (!(std::abs(turn.norm() - 1) < 1e-3))
    return words.complaint("QW QX QY QZ must be a unit quaternion");
  const auto camera = cameras.find(id);
  if (camera == cameras.end())
    return words.complaint("cameras.txt has no camera " + std::to_string(id));
  ForeignCamera image = camera->second;
  image.model.name = std::filesystem::path(name).stem().string();
  image.model.camera_from_rig = {turn.normalized().toRotationMatrix(), unit_mm * shift};
  image.has_pose = true;
  if (image.model.name.empty()) return words.complaint("NAME is missing");
  for (const ForeignCamera& other : out) {
    if (other.model.name == image.model.name)
      return words.complaint("image '" + name.substr(0, 60) + "' gives the camera '" +
                             image.model.name.substr(0, 60) +
                             "' a second pose; a rig has one image for each camera");
  }
  out.push_back(std::move(image));
  return {};
}

void append(std::string& out, double value) {
  std::array<char, 32> text{};
  out += ' ';
  out.append(text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr);
}

/// The name before '=', where a rig could have such a name.
std::optional<std::pair<std::string, std::string>> split_name(const std::string& source) {
  const std::size_t equals = source.find('=');
  if (equals == std::string::npos || equals == 0 ||
      source.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_-") != equals)
    return std::nullopt;
  return std::pair(source.substr(0, equals), source.substr(equals + 1));
}

/// The text of a rig.json with what camera files say put into it.
Result<std::string> put_cameras(Json root, std::span<const ForeignCamera> cameras) {
  if (!root.is_object()) return Error{Code::invalid, "rig.json must hold an object"};
  Json& list = root["cameras"];
  if (list.is_null()) list = Json::array();
  if (!list.is_array()) return Error{Code::invalid, "key 'rig.cameras' must be a list"};
  for (const ForeignCamera& camera : cameras) {
    const CameraModel& model = camera.model;
    const auto found = std::find_if(list.begin(), list.end(), [&](const Json& entry) {
      return entry.is_object() && entry.value("name", Json()) == model.name;
    });
    Json& entry = found != list.end() ? *found : list.emplace_back(Json{{"name", model.name}});
    if (camera.has_size) {
      const Json width = entry.value("width_px", Json()), height = entry.value("height_px", Json());
      if ((!width.is_null() && width != model.width_px) ||
          (!height.is_null() && height != model.height_px)) {
        return Error{Code::invalid, "rig.json says that camera '" + model.name + "' has " +
                                        width.dump() + " x " + height.dump() + " px, " +
                                        camera.source + " " + std::to_string(model.width_px) +
                                        " x " + std::to_string(model.height_px) +
                                        " px: a calibration holds for pictures of one size"};
      }
      entry["width_px"] = model.width_px;
      entry["height_px"] = model.height_px;
    }
    entry["K"] = {{model.fx_px, 0, model.cx_px}, {0, model.fy_px, model.cy_px}, {0, 0, 1}};
    entry["distortion"] = model.distortion;
    if (camera.has_pose) {
      Json pose = Json::array();
      const Pose& from_rig = model.camera_from_rig;
      for (int row = 0; row < 3; ++row)
        pose.push_back({from_rig.rotation(row, 0), from_rig.rotation(row, 1),
                        from_rig.rotation(row, 2), from_rig.translation_mm[row]});
      pose.push_back({0, 0, 0, 1});
      entry["camera_from_rig"] = std::move(pose);
    }
  }
  return root.dump();
}

}  // namespace

Result<ForeignCamera> parse_opencv_camera(std::string_view text, std::string_view suffix,
                                          double unit_mm) {
  const Json root = ALHAZEN_TRY(parse_document(text));
  if (!root.is_object()) return Error{Code::invalid, "the file must hold keys with values"};
  const Keys keys(root, suffix);
  ForeignCamera camera;
  ALHAZEN_TRY(read_matrix(keys, camera.model));
  ALHAZEN_TRY(read_distortion(keys, camera.model));
  ALHAZEN_TRY(read_size(keys, camera));
  ALHAZEN_TRY(read_pose(keys, unit_mm, camera));
  return camera;
}

Result<std::vector<ForeignCamera>> parse_colmap(std::string_view cameras_txt,
                                                std::string_view images_txt, double unit_mm) {
  std::map<std::int64_t, ForeignCamera> cameras;
  ALHAZEN_TRY(for_each_line(cameras_txt, "cameras.txt", false,
                            [&](Words& words) { return read_colmap_camera(words, cameras); }));
  std::vector<ForeignCamera> out;
  ALHAZEN_TRY(for_each_line(images_txt, "images.txt", true, [&](Words& words) {
    return read_colmap_image(words, cameras, unit_mm, out);
  }));
  if (out.empty()) return Error{Code::invalid, "images.txt names no image"};
  return out;
}

Result<std::vector<ForeignCamera>> read_cameras(const std::string& source, double unit_mm) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (fs::is_directory(source, ignored)) {
    const std::string cameras =
        ALHAZEN_TRY(read_file(fs::path(source) / "cameras.txt", kMaxColmapBytes));
    const std::string images =
        ALHAZEN_TRY(read_file(fs::path(source) / "images.txt", kMaxColmapBytes));
    std::vector<ForeignCamera> out = ALHAZEN_TRY(parse_colmap(cameras, images, unit_mm).in(source));
    for (ForeignCamera& camera : out) camera.source = (fs::path(source) / "cameras.txt").string();
    return out;
  }
  const auto named = split_name(source);
  std::string file = named ? named->second : source, suffix;
  if (const std::size_t hash = file.rfind('#'); hash != std::string::npos) {
    suffix = file.substr(hash + 1);
    file.resize(hash);
  }
  const std::string text = ALHAZEN_TRY(read_file(file, kMaxCameraFileBytes));
  ForeignCamera camera = ALHAZEN_TRY(parse_opencv_camera(text, suffix, unit_mm).in(file));
  camera.model.name = named ? named->first : fs::path(file).stem().string();
  camera.source = file;
  return std::vector{std::move(camera)};
}

Result<Rig> rig_with_cameras(std::string_view rig_json, std::span<const ForeignCamera> cameras) {
  const std::string whole = ALHAZEN_TRY(caught(
      Code::invalid, "rig.json", [&] { return put_cameras(Json::parse(rig_json), cameras); }));
  return Rig::parse(whole);
}

ColmapModel to_colmap(std::span<const ColmapImage> images) {
  ColmapModel out;
  out.cameras_txt = "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]; px, pixel centres at 1/2\n";
  out.images_txt =
      "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME; camera from world, mm\n"
      "# POINTS2D[]\n";
  out.points3d_txt = "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n";
  std::map<std::string, std::size_t> ids;
  for (std::size_t i = 0; i < images.size(); ++i) {
    const CameraModel& camera = images[i].camera;
    const auto [id, is_new] = ids.try_emplace(camera.name, ids.size() + 1);
    if (is_new) {
      out.cameras_txt += std::to_string(id->second) + " FULL_OPENCV " +
                         std::to_string(camera.width_px) + " " + std::to_string(camera.height_px);
      for (const double x : {camera.fx_px, camera.fy_px, camera.cx_px + 0.5, camera.cy_px + 0.5})
        append(out.cameras_txt, x);
      for (const double x : camera.distortion) append(out.cameras_txt, x);
      out.cameras_txt += '\n';
    }
    const Eigen::Quaterniond turn(images[i].camera_from_world.rotation);
    out.images_txt += std::to_string(i + 1);
    for (const double x : {turn.w(), turn.x(), turn.y(), turn.z()}) append(out.images_txt, x);
    for (const double x : images[i].camera_from_world.translation_mm) append(out.images_txt, x);
    out.images_txt += " " + std::to_string(id->second) + " " + images[i].name + "\n\n";
  }
  return out;
}

}  // namespace alhazen
