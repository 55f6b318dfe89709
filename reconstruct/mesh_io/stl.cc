#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>

#include "reconstruct/mesh_io/parse.h"

namespace alhazen {
namespace {

constexpr std::size_t kHeader = 84, kRecord = 50;

/// Corners, three a triangle, to a mesh in which equal ones are one vertex, in order of appearance.
/// By sorting: a hash table could be filled with collisions on purpose.
Result<Mesh> merged(const std::vector<Eigen::Vector3d>& corners) {
  if (!is_index(static_cast<std::int64_t>(corners.size())))
    return Error{Code::invalid, "more corners than 32-bit indices can name"};
  const auto less = [&](std::uint32_t a, std::uint32_t b) {
    const auto& p = corners[a];
    const auto& q = corners[b];
    if (p.x() != q.x()) return p.x() < q.x();
    if (p.y() != q.y()) return p.y() < q.y();
    if (p.z() != q.z()) return p.z() < q.z();
    return a < b;
  };
  std::vector<std::uint32_t> order(corners.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), less);
  std::vector<std::uint32_t> first(corners.size());  // first corner at the same place
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool is_same = i > 0 && corners[order[i]] == corners[order[i - 1]];
    first[order[i]] = is_same ? first[order[i - 1]] : order[i];
  }
  Mesh mesh;
  mesh.triangles.resize(corners.size() / 3);
  std::vector<std::uint32_t>& vertex_of = order;  // the sorted order is not needed any more
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (first[i] == i) {
      vertex_of[i] = static_cast<std::uint32_t>(mesh.vertices_mm.size());
      mesh.vertices_mm.push_back(corners[i]);
    } else {
      vertex_of[i] = vertex_of[first[i]];
    }
    mesh.triangles[i / 3][i % 3] = vertex_of[i];
  }
  return mesh;
}

Result<Mesh> parse_binary(std::string_view bytes, std::size_t count) {
  std::vector<Eigen::Vector3d> corners;
  corners.reserve(3 * count);
  for (std::size_t t = 0; t < count; ++t) {
    // 12 bytes of facet normal come first; it follows from the corners.
    std::array<float, 9> values{};
    const std::size_t begin = kHeader + t * kRecord + 12;
    std::memcpy(values.data(), bytes.data() + begin, sizeof(values));
    if (!std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); }))
      return Error{Code::invalid, "byte " + std::to_string(begin) + ": triangle " +
                                      std::to_string(t) + " is not finite"};
    for (std::size_t k = 0; k < 3; ++k) {
      corners.emplace_back(static_cast<double>(values[3 * k]),
                           static_cast<double>(values[3 * k + 1]),
                           static_cast<double>(values[3 * k + 2]));
    }
  }
  return merged(corners);
}

Result<Mesh> parse_ascii(std::string_view bytes) {
  Text text(bytes);
  const auto wrong = [&text](const std::string& what) {
    return Error{Code::invalid, "line " + std::to_string(text.line_number()) + ": " + what};
  };
  std::vector<Eigen::Vector3d> corners;
  std::size_t in_facet = 0;
  bool is_ended = false;
  while (const auto whole = text.line()) {
    std::string_view line = *whole;
    const auto word = take_word(line);
    if (!word) continue;
    if (*word == "vertex") {
      Eigen::Vector3d p;
      for (int axis = 0; axis < 3; ++axis) {
        const auto number_word = take_word(line);
        const auto number = number_word ? to_number(*number_word) : std::nullopt;
        if (!number) return wrong("a vertex needs three numbers");
        if (!std::isfinite(*number)) return wrong(shown(*number_word) + " is not finite");
        p[axis] = *number;
      }
      corners.push_back(p);
      ++in_facet;
    } else if (*word == "endfacet") {
      if (in_facet != 3)
        return wrong("a facet of " + std::to_string(in_facet) + " vertices instead of 3");
      in_facet = 0;
    } else if (*word == "endsolid") {
      is_ended = true;
    } else if (*word != "solid" && *word != "facet" && *word != "outer" && *word != "endloop") {
      return wrong("unknown statement " + shown(*word));
    }
  }
  if (!is_ended || in_facet != 0) return wrong("the file ends too early");
  return merged(corners);
}

}  // namespace

Result<Mesh> parse_stl(std::string_view bytes) {
  std::uint32_t count = 0;
  if (bytes.size() >= kHeader) std::memcpy(&count, bytes.data() + 80, sizeof(count));
  // Binary headers may begin with "solid", too: only the length tells.
  if (bytes.size() >= kHeader && bytes.size() - kHeader == kRecord * std::size_t{count})
    return parse_binary(bytes, count);
  std::string_view start = bytes.substr(0, 256);
  if (take_word(start) == "solid") return parse_ascii(bytes);
  if (bytes.size() < kHeader)
    return Error{Code::invalid, "byte " + std::to_string(bytes.size()) +
                                    ": the file ends within the header of a binary STL"};
  return Error{Code::invalid, "byte 80: " + std::to_string(count) + " triangles take " +
                                  std::to_string(kHeader + kRecord * std::size_t{count}) +
                                  " bytes, the file has " + std::to_string(bytes.size())};
}

}  // namespace alhazen
