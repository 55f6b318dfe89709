#include <algorithm>
#include <array>
#include <cmath>

#include "reconstruct/mesh_io/parse.h"

namespace alhazen {
namespace {

/// Lines of an OFF file without comments and blank ones.
class OffLines {
 public:
  explicit OffLines(std::string_view bytes) : text_(bytes), size_(bytes.size()) {}

  Result<std::string_view> next() {
    while (const auto whole = text_.line()) {
      const std::string_view line = whole->substr(0, whole->find('#'));
      if (line.find_first_not_of(" \t\r\f\v") != std::string_view::npos) return line;
    }
    return wrong("the file ends too early");
  }
  [[nodiscard]] std::size_t left() const { return size_ - text_.position(); }
  [[nodiscard]] Error wrong(std::string what) const {
    return Error{Code::invalid,
                 "line " + std::to_string(text_.line_number()) + ": " + std::move(what)};
  }

 private:
  Text text_;
  std::size_t size_;
};

template <std::size_t N>
Result<std::array<double, N>> numbers(const OffLines& lines, std::string_view& line) {
  std::array<double, N> values{};
  for (double& value : values) {
    const auto word = take_word(line);
    const auto number = word ? to_number(*word) : std::nullopt;
    if (!number) return lines.wrong(std::to_string(N) + " numbers are needed");
    if (!std::isfinite(*number)) return lines.wrong(shown(*word) + " is not finite");
    value = *number;
  }
  return values;
}

Result<std::int64_t> whole(const OffLines& lines, std::string_view& line, const char* what) {
  const auto word = take_word(line);
  const auto value = word ? to_integer(*word) : std::nullopt;
  if (!value || *value < 0) return lines.wrong(std::string(what) + " must be an integer from 0 up");
  return *value;
}

Status read_face(const OffLines& lines, std::string_view line, Mesh& mesh) {
  const std::int64_t corners = ALHAZEN_TRY(whole(lines, line, "the number of corners"));
  if (corners < 3)
    return lines.wrong("a face of " + std::to_string(corners) +
                       " corners, a polygon has 3 or more");
  std::uint32_t first = 0, previous = 0;
  for (std::int64_t i = 0; i < corners; ++i) {
    const std::int64_t index = ALHAZEN_TRY(whole(lines, line, "an index"));
    if (!is_index(index))
      return lines.wrong("index " + std::to_string(index) + " is outside the range of vertices");
    const auto corner = static_cast<std::uint32_t>(index);
    if (i == 0) {
      first = corner;
    } else if (i >= 2) {
      mesh.triangles.push_back({first, previous, corner});
    }
    previous = corner;
  }
  return {};  // what is left of the line is a colour
}

}  // namespace

Result<Mesh> parse_off(std::string_view bytes) {
  OffLines lines(bytes);
  std::string_view line = ALHAZEN_TRY(lines.next());
  const std::string_view word = take_word(line).value_or("");
  if (word.size() < 3 || word.substr(word.size() - 3) != "OFF")
    return lines.wrong("an OFF file begins with \"OFF\"");
  const std::string_view prefix = word.substr(0, word.size() - 3);
  if (prefix.find_first_not_of("CNST") != std::string_view::npos)
    return Error{Code::unsupported, shown(word) + ": only three dimensions, colours and normals"};
  const bool has_normals = prefix.find('N') != std::string_view::npos;
  if (line.find_first_not_of(" \t\r\f\v") == std::string_view::npos)
    line = ALHAZEN_TRY(lines.next());
  if (line.find("BINARY") != std::string_view::npos)
    return Error{Code::unsupported, "a binary OFF file"};

  const std::int64_t vertices = ALHAZEN_TRY(whole(lines, line, "the number of vertices"));
  const std::int64_t faces = ALHAZEN_TRY(whole(lines, line, "the number of faces"));
  // "0 0 0" and a line's end, the shortest of both kinds; the last may lack its end.
  constexpr std::size_t kLeastVertex = 6, kLeastFace = 8;
  if (!is_index(vertices) || static_cast<std::size_t>(vertices) > (lines.left() + 1) / kLeastVertex)
    return lines.wrong(std::to_string(vertices) + " vertices do not fit into this file");
  if (static_cast<std::uint64_t>(faces) > (lines.left() + 1) / kLeastFace)
    return lines.wrong(std::to_string(faces) + " faces do not fit into this file");

  Mesh mesh;
  mesh.vertices_mm.reserve(static_cast<std::size_t>(vertices));
  mesh.triangles.reserve(static_cast<std::size_t>(faces));
  if (has_normals) mesh.normals.reserve(static_cast<std::size_t>(vertices));
  for (std::int64_t i = 0; i < vertices; ++i) {
    line = ALHAZEN_TRY(lines.next());
    const auto p = ALHAZEN_TRY(numbers<3>(lines, line));
    mesh.vertices_mm.emplace_back(p[0], p[1], p[2]);
    if (has_normals) {
      const auto n = ALHAZEN_TRY(numbers<3>(lines, line));
      if (!std::all_of(n.begin(), n.end(), is_single)) return lines.wrong("a normal this long");
      mesh.normals.push_back(Eigen::Vector3d(n[0], n[1], n[2]).cast<float>());
    }
  }
  for (std::int64_t i = 0; i < faces; ++i) {
    line = ALHAZEN_TRY(lines.next());
    ALHAZEN_TRY(read_face(lines, line, mesh));
  }
  return mesh;
}

}  // namespace alhazen
