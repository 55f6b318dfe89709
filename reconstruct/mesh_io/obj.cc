#include <algorithm>
#include <array>
#include <cmath>

#include "reconstruct/mesh_io/parse.h"

namespace alhazen {
namespace {

// Statements of the format that say nothing about triangles.
constexpr std::array<std::string_view, 34> kIgnored{
    "vt",       "vp",     "g",          "o",         "s",      "mg",    "l",
    "p",        "usemtl", "mtllib",     "usemap",    "maplib", "bevel", "c_interp",
    "d_interp", "lod",    "shadow_obj", "trace_obj", "ctech",  "stech", "cstype",
    "deg",      "bmat",   "step",       "curv",      "curv2",  "surf",  "parm",
    "trim",     "hole",   "scrv",       "sp",        "end",    "con"};

constexpr std::uint32_t kNone = 0xffffffff;

struct Corner {
  std::uint32_t vertex = 0, normal = kNone;
};

class ObjParser {
 public:
  explicit ObjParser(std::string_view bytes) : text_(bytes) {}

  Result<Mesh> parse() {
    while (auto whole = text_.line()) {
      std::string_view line = *whole;
      std::string joined;
      // A backslash at the end joins the next line.
      while (!line.empty() && line.back() == '\\') {
        joined += line.substr(0, line.size() - 1);
        joined += ' ';
        line = text_.line().value_or("");
        if (line.empty() || line.back() != '\\') {
          joined += line;
          line = joined;
          break;
        }
      }
      ALHAZEN_TRY(statement(line));
    }
    attach_normals();
    return std::move(mesh_);
  }

 private:
  [[nodiscard]] Error wrong(std::string what) const {
    return Error{Code::invalid,
                 "line " + std::to_string(text_.line_number()) + ": " + std::move(what)};
  }

  Status statement(std::string_view line) {
    const auto keyword = take_word(line);
    if (!keyword || keyword->front() == '#') return {};
    if (*keyword == "v") {
      mesh_.vertices_mm.push_back(ALHAZEN_TRY(vector(line)));
      if (!is_index(static_cast<std::int64_t>(mesh_.vertices_mm.size())))
        return wrong("more vertices than 32-bit indices can name");
      return {};
    }
    if (*keyword == "vn") {
      const Eigen::Vector3d normal = ALHAZEN_TRY(vector(line));
      if (!is_single(normal.cwiseAbs().maxCoeff())) return wrong("a normal this long");
      normals_.push_back(normal.cast<float>());
      return {};
    }
    if (*keyword == "f" || *keyword == "fo") return face(line);
    if (std::find(kIgnored.begin(), kIgnored.end(), *keyword) != kIgnored.end()) return {};
    return wrong("unknown statement " + shown(*keyword));
  }

  Result<Eigen::Vector3d> vector(std::string_view line) const {
    Eigen::Vector3d value;
    for (int axis = 0; axis < 3; ++axis) {
      const auto word = take_word(line);
      const auto number = word ? to_number(*word) : std::nullopt;
      if (!number) return wrong("three numbers are needed");
      if (!std::isfinite(*number)) return wrong(shown(*word) + " is not finite");
      value[axis] = *number;
    }
    return value;
  }

  /// 1-based, or negative: counted back from what came last.
  Result<std::uint32_t> index(std::string_view word, std::size_t size) const {
    const auto value = to_integer(word);
    if (!value) return wrong(shown(word) + " is no index");
    const std::int64_t zero_based =
        *value > 0 ? *value - 1 : *value + static_cast<std::int64_t>(size);
    if (*value == 0 || !is_index(zero_based))
      return wrong("index " + std::to_string(*value) + " is outside the range of vertices");
    return static_cast<std::uint32_t>(zero_based);
  }

  Result<Corner> corner(std::string_view word) const {
    Corner corner;
    const std::size_t slash = word.find('/');
    corner.vertex = ALHAZEN_TRY(index(word.substr(0, slash), mesh_.vertices_mm.size()));
    if (slash == std::string_view::npos) return corner;
    const std::size_t second = word.find('/', slash + 1);
    if (second == std::string_view::npos || second + 1 == word.size()) return corner;
    corner.normal = ALHAZEN_TRY(index(word.substr(second + 1), normals_.size()));
    return corner;
  }

  Status face(std::string_view line) {
    std::array<Corner, 3> fan;
    std::size_t count = 0;
    while (const auto word = take_word(line)) {
      if (word->front() == '#') break;
      const Corner next = ALHAZEN_TRY(corner(*word));
      if (count < 3) {
        fan[count] = next;
      } else {
        fan[1] = fan[2];
        fan[2] = next;
      }
      if (++count >= 3) {
        mesh_.triangles.push_back({fan[0].vertex, fan[1].vertex, fan[2].vertex});
        if (!normals_.empty()) {
          // Faces before the first vn have no normals.
          corner_normals_.resize(mesh_.triangles.size() - 1, {kNone, kNone, kNone});
          corner_normals_.push_back({fan[0].normal, fan[1].normal, fan[2].normal});
        }
      }
    }
    if (count < 3)
      return wrong("a face of " + std::to_string(count) + " corners, a polygon has 3 or more");
    return {};
  }

  /// The file gives normals per corner; they are kept where each vertex has one and the same.
  void attach_normals() {
    if (normals_.empty() || corner_normals_.size() != mesh_.triangles.size()) return;
    std::vector<std::uint32_t> normal_of(mesh_.vertices_mm.size(), kNone);
    for (std::size_t t = 0; t < mesh_.triangles.size(); ++t) {
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t vertex = mesh_.triangles[t][k], normal = corner_normals_[t][k];
        if (vertex >= normal_of.size() || normal >= normals_.size()) return;
        if (normal_of[vertex] != kNone && normal_of[vertex] != normal) return;
        normal_of[vertex] = normal;
      }
    }
    std::vector<Eigen::Vector3f> normals;
    normals.reserve(normal_of.size());
    for (const std::uint32_t normal : normal_of) {
      if (normal == kNone) return;
      normals.push_back(normals_[normal]);
    }
    mesh_.normals = std::move(normals);
  }

  Text text_;
  Mesh mesh_;
  std::vector<Eigen::Vector3f> normals_;
  std::vector<std::array<std::uint32_t, 3>> corner_normals_;
};

}  // namespace

Result<Mesh> parse_obj(std::string_view bytes) { return ObjParser(bytes).parse(); }

}  // namespace alhazen
