#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#include "reconstruct/mesh_io/parse.h"

namespace alhazen {
namespace {

enum class Type : std::uint8_t { int8, uint8, int16, uint16, int32, uint32, float32, float64 };

std::optional<Type> type_of(std::string_view word) {
  constexpr std::array<std::pair<std::string_view, Type>, 16> kTypes{{
      {"char", Type::int8},
      {"uchar", Type::uint8},
      {"short", Type::int16},
      {"ushort", Type::uint16},
      {"int", Type::int32},
      {"uint", Type::uint32},
      {"float", Type::float32},
      {"double", Type::float64},
      {"int8", Type::int8},
      {"uint8", Type::uint8},
      {"int16", Type::int16},
      {"uint16", Type::uint16},
      {"int32", Type::int32},
      {"uint32", Type::uint32},
      {"float32", Type::float32},
      {"float64", Type::float64},
  }};
  for (const auto& [name, type] : kTypes) {
    if (name == word) return type;
  }
  return std::nullopt;
}

std::size_t size_of(Type type) {
  constexpr std::array<std::size_t, 8> kSizes{1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}

bool is_whole(Type type) { return type != Type::float32 && type != Type::float64; }

/// What a property means to a mesh.
enum class Role : std::uint8_t {
  x,
  y,
  z,
  nx,
  ny,
  nz,
  consistency,
  observed,
  depth_sigma,
  corners,
  other
};
constexpr std::size_t kScalarRoles = static_cast<std::size_t>(Role::corners);

struct Property {
  Type type = Type::float32;
  std::optional<Type> count_type;  ///< set for a list
  Role role = Role::other;
};

enum class Kind : std::uint8_t { vertex, face, other };

struct Element {
  Kind kind = Kind::other;
  std::string name;
  std::uint64_t rows = 0;
  std::vector<Property> properties;
  [[nodiscard]] bool has(Role role) const {
    return std::any_of(properties.begin(), properties.end(),
                       [role](const Property& p) { return p.role == role; });
  }
};

enum class Coded : std::uint8_t { ascii, little, big };

struct Header {
  Coded coded = Coded::ascii;
  std::vector<Element> elements;
  std::size_t end = 0;  ///< first byte of the data
};

Role role_of(Kind kind, std::string_view name, bool is_list) {
  if (kind == Kind::face && is_list && (name == "vertex_indices" || name == "vertex_index"))
    return Role::corners;
  if (kind != Kind::vertex || is_list) return Role::other;
  constexpr std::array<std::string_view, kScalarRoles> kNames{
      "x", "y", "z", "nx", "ny", "nz", "consistency", "observed", "depth_sigma_mm"};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (kNames[i] == name) return static_cast<Role>(i);
  }
  return Role::other;
}

Error at_line(const Text& text, std::string what) {
  return Error{Code::invalid,
               "line " + std::to_string(text.line_number()) + ": " + std::move(what)};
}

Result<Property> parse_property(Text& text, std::string_view line, Kind kind) {
  Property property;
  auto word = take_word(line);
  const bool is_list = word == "list";
  if (is_list) {
    word = take_word(line);
    property.count_type = word ? type_of(*word) : std::nullopt;
    if (!property.count_type) return at_line(text, "a list needs a type for its count");
    if (!is_whole(*property.count_type))
      return Error{Code::unsupported, "line " + std::to_string(text.line_number()) +
                                          ": a list's count must be an integer type"};
    word = take_word(line);
  }
  const auto type = word ? type_of(*word) : std::nullopt;
  if (!type) return at_line(text, "unknown property type " + shown(word.value_or("")));
  property.type = *type;
  const auto name = take_word(line);
  if (!name) return at_line(text, "a property without a name");
  property.role = role_of(kind, *name, is_list);
  if (property.role == Role::corners && !is_whole(property.type))
    return Error{Code::unsupported, "line " + std::to_string(text.line_number()) +
                                        ": vertex indices must be an integer type"};
  return property;
}

Result<Element> parse_element(const Text& text, std::string_view line) {
  const auto name = take_word(line);
  const auto count_word = take_word(line);
  const auto count = count_word ? to_integer(*count_word) : std::nullopt;
  if (!name || !count || *count < 0)
    return at_line(text, "an element needs a name and a count of 0 or more");
  Element element;
  element.name = std::string(name->substr(0, 40));
  element.kind = *name == "vertex" ? Kind::vertex : *name == "face" ? Kind::face : Kind::other;
  element.rows = static_cast<std::uint64_t>(*count);
  if (element.kind == Kind::vertex && !is_index(*count))
    return at_line(text, "at most 4294967294 vertices are possible");
  return element;
}

Result<Header> parse_header(std::string_view bytes) {
  Text text(bytes);
  if (text.line() != "ply") return Error{Code::invalid, "line 1: a PLY file begins with \"ply\""};
  Header header;
  bool has_format = false;
  for (;;) {
    const auto whole = text.line();
    if (!whole) return at_line(text, "the header ends without end_header");
    std::string_view line = *whole;
    const auto keyword = take_word(line);
    if (!keyword || *keyword == "comment" || *keyword == "obj_info") continue;
    if (*keyword == "end_header") break;
    if (*keyword == "format") {
      const std::string_view coded = take_word(line).value_or("");
      if (coded == "ascii") {
        header.coded = Coded::ascii;
      } else if (coded == "binary_little_endian") {
        header.coded = Coded::little;
      } else if (coded == "binary_big_endian") {
        header.coded = Coded::big;
      } else {
        return at_line(text, "unknown format " + shown(coded));
      }
      has_format = true;
    } else if (*keyword == "element") {
      Element element = ALHAZEN_TRY(parse_element(text, line));
      for (const Element& earlier : header.elements) {
        if (element.kind != Kind::other && earlier.kind == element.kind)
          return at_line(text, "a second element " + element.name);
      }
      header.elements.push_back(std::move(element));
    } else if (*keyword == "property") {
      if (header.elements.empty()) return at_line(text, "a property before any element");
      Element& element = header.elements.back();
      const Property property = ALHAZEN_TRY(parse_property(text, line, element.kind));
      if (property.role != Role::other && element.has(property.role))
        return at_line(text, "this property came before");
      element.properties.push_back(property);
    } else {
      return at_line(text, "unknown keyword " + shown(*keyword));
    }
  }
  if (!has_format) return Error{Code::invalid, "the header names no format"};
  header.end = text.position();
  return header;
}

/// Values of a text body.
class AsciiSource {
 public:
  explicit AsciiSource(std::string_view bytes, std::size_t begin)
      : text_(bytes, begin), size_(bytes.size()) {}

  /// No row is shorter than this many bytes.
  static std::size_t least_row(const Element& element) { return 2 * element.properties.size(); }
  [[nodiscard]] std::size_t left() const { return size_ - text_.position(); }

  Result<double> number(Type /*type*/) {
    const auto word = text_.word();
    if (!word) return Error{Code::invalid, where() + ": the file ends too early"};
    const auto value = to_number(*word);
    if (!value) return Error{Code::invalid, where() + ": " + shown(*word) + " is no number"};
    return *value;
  }
  Result<std::int64_t> whole(Type /*type*/) {
    const auto word = text_.word();
    if (!word) return Error{Code::invalid, where() + ": the file ends too early"};
    const auto value = to_integer(*word);
    if (!value) return Error{Code::invalid, where() + ": " + shown(*word) + " is no integer"};
    return *value;
  }
  Status skip(Type /*type*/, std::uint64_t count) {
    for (std::uint64_t i = 0; i < count; ++i) {
      if (!text_.word()) return Error{Code::invalid, where() + ": the file ends too early"};
    }
    return {};
  }
  Status skip_rows(const Element& element, std::size_t /*row_bytes*/) {
    // Row by row, so that the product cannot overflow: words run out first.
    for (std::uint64_t row = 0; row < element.rows; ++row) {
      ALHAZEN_TRY(skip(Type::int8, element.properties.size()));
    }
    return {};
  }
  [[nodiscard]] std::string where() const { return "line " + std::to_string(text_.line_number()); }

 private:
  Text text_;
  std::size_t size_;
};

template <class T>
T swapped(T value) {
  std::array<char, sizeof(T)> raw{};
  std::memcpy(raw.data(), &value, sizeof(T));
  std::reverse(raw.begin(), raw.end());
  std::memcpy(&value, raw.data(), sizeof(T));
  return value;
}

/// Values of a binary body.
template <bool kSwap>
class BinarySource {
 public:
  BinarySource(std::string_view bytes, std::size_t begin) : bytes_(bytes), at_(begin) {}

  static std::size_t least_row(const Element& element) {
    std::size_t bytes = 0;
    for (const Property& p : element.properties) bytes += size_of(p.count_type.value_or(p.type));
    return bytes;
  }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }

  Result<double> number(Type type) {
    if (left() < size_of(type)) return too_short();
    switch (type) {
      case Type::float32:
        return static_cast<double>(take<float>());
      case Type::float64:
        return take<double>();
      default:
        return static_cast<double>(take_whole(type));
    }
  }
  Result<std::int64_t> whole(Type type) {
    if (left() < size_of(type)) return too_short();
    return take_whole(type);
  }
  Status skip(Type type, std::uint64_t count) {
    if (count > left() / size_of(type)) return too_short();
    at_ += size_of(type) * static_cast<std::size_t>(count);
    return {};
  }
  Status skip_rows(const Element& element, std::size_t row_bytes) {
    if (row_bytes > 0 && element.rows > left() / row_bytes) return too_short();
    at_ += row_bytes * static_cast<std::size_t>(element.rows);
    return {};
  }
  [[nodiscard]] std::string where() const { return "byte " + std::to_string(at_); }

 private:
  [[nodiscard]] Error too_short() const {
    return Error{Code::invalid, where() + ": the file ends too early"};
  }
  template <class T>
  T take() {
    T value{};
    std::memcpy(&value, bytes_.data() + at_, sizeof(T));
    at_ += sizeof(T);
    return kSwap ? swapped(value) : value;
  }
  std::int64_t take_whole(Type type) {
    switch (type) {
      case Type::int8:
        return take<std::int8_t>();
      case Type::uint8:
        return take<std::uint8_t>();
      case Type::int16:
        return take<std::int16_t>();
      case Type::uint16:
        return take<std::uint16_t>();
      case Type::int32:
        return take<std::int32_t>();
      default:
        return take<std::uint32_t>();
    }
  }

  std::string_view bytes_;
  std::size_t at_;
};

template <class Source>
Status read_vertices(Source& source, const Element& element, Mesh& mesh) {
  const bool has_normals = element.has(Role::nx) && element.has(Role::ny) && element.has(Role::nz);
  const bool has_consistency = element.has(Role::consistency);
  const bool has_observed = element.has(Role::observed);
  const bool has_sigma = element.has(Role::depth_sigma);
  const auto rows = static_cast<std::size_t>(element.rows);
  mesh.vertices_mm.reserve(rows);
  if (has_normals) mesh.normals.reserve(rows);
  if (has_consistency) mesh.consistency.reserve(rows);
  if (has_observed) mesh.observed.reserve(rows);
  if (has_sigma) mesh.depth_sigma_mm.reserve(rows);
  std::array<double, kScalarRoles> value{};
  for (std::size_t row = 0; row < rows; ++row) {
    for (const Property& property : element.properties) {
      if (property.count_type) {
        const std::int64_t count = ALHAZEN_TRY(source.whole(*property.count_type));
        if (count < 0) return Error{Code::invalid, source.where() + ": a list of negative length"};
        ALHAZEN_TRY(source.skip(property.type, static_cast<std::uint64_t>(count)));
      } else if (property.role == Role::other) {
        ALHAZEN_TRY(source.skip(property.type, 1));
      } else {
        const double number = ALHAZEN_TRY(source.number(property.type));
        const bool is_position = property.role <= Role::z;
        // Only the depth's deviation may be unknown.
        const bool is_unknown = property.role == Role::depth_sigma && std::isnan(number);
        if (!is_unknown && !(is_position ? std::isfinite(number) : is_single(number)))
          return Error{Code::invalid, source.where() + ": vertex " + std::to_string(row) +
                                          " is not finite or too large"};
        value[static_cast<std::size_t>(property.role)] = number;
      }
    }
    const auto role = [&](Role r) { return value[static_cast<std::size_t>(r)]; };
    mesh.vertices_mm.emplace_back(role(Role::x), role(Role::y), role(Role::z));
    if (has_normals)
      mesh.normals.push_back(
          Eigen::Vector3d(role(Role::nx), role(Role::ny), role(Role::nz)).cast<float>());
    if (has_consistency) mesh.consistency.push_back(static_cast<float>(role(Role::consistency)));
    if (has_observed) mesh.observed.push_back(role(Role::observed) != 0 ? 1 : 0);
    if (has_sigma) mesh.depth_sigma_mm.push_back(static_cast<float>(role(Role::depth_sigma)));
  }
  return {};
}

template <class Source>
Result<std::uint32_t> read_corner(Source& source, Type type) {
  const std::int64_t index = ALHAZEN_TRY(source.whole(type));
  if (!is_index(index))
    return Error{Code::invalid, source.where() + ": index " + std::to_string(index) +
                                    " is outside the range of vertices"};
  return static_cast<std::uint32_t>(index);
}

template <class Source>
Status read_polygon(Source& source, const Property& property, std::uint64_t row, Mesh& mesh) {
  const std::int64_t count = ALHAZEN_TRY(source.whole(*property.count_type));
  if (count < 3)
    return Error{Code::invalid, source.where() + ": face " + std::to_string(row) + " has " +
                                    std::to_string(count) + " corners, a polygon has 3 or more"};
  const std::uint32_t first = ALHAZEN_TRY(read_corner(source, property.type));
  std::uint32_t previous = ALHAZEN_TRY(read_corner(source, property.type));
  for (std::int64_t i = 2; i < count; ++i) {
    const std::uint32_t corner = ALHAZEN_TRY(read_corner(source, property.type));
    mesh.triangles.push_back({first, previous, corner});
    previous = corner;
  }
  return {};
}

template <class Source>
Status read_rows(Source& source, const Element& element, Mesh& mesh) {
  const bool has_lists = std::any_of(element.properties.begin(), element.properties.end(),
                                     [](const Property& p) { return p.count_type.has_value(); });
  const std::size_t least = Source::least_row(element);
  if (element.properties.empty()) return {};  // rows of nothing, however many are claimed
  if (element.kind == Kind::other && !has_lists) return source.skip_rows(element, least);
  // The last row of a text may lack the blank after its last number: hence + 1.
  if (element.rows > (source.left() + 1) / least)
    return Error{Code::invalid, source.where() + ": the header promises " +
                                    std::to_string(element.rows) + " rows of " + element.name +
                                    ", the file is too short for them"};
  if (element.kind == Kind::vertex) return read_vertices(source, element, mesh);
  if (element.kind == Kind::face) mesh.triangles.reserve(static_cast<std::size_t>(element.rows));
  for (std::uint64_t row = 0; row < element.rows; ++row) {
    for (const Property& property : element.properties) {
      if (property.role == Role::corners) {
        ALHAZEN_TRY(read_polygon(source, property, row, mesh));
      } else if (property.count_type) {
        const std::int64_t count = ALHAZEN_TRY(source.whole(*property.count_type));
        if (count < 0) return Error{Code::invalid, source.where() + ": a list of negative length"};
        ALHAZEN_TRY(source.skip(property.type, static_cast<std::uint64_t>(count)));
      } else {
        ALHAZEN_TRY(source.skip(property.type, 1));
      }
    }
  }
  return {};
}

template <class Source>
Result<Mesh> read_body(Source source, const Header& header) {
  Mesh mesh;
  for (const Element& element : header.elements) {
    ALHAZEN_TRY(read_rows(source, element, mesh));
  }
  return mesh;
}

}  // namespace

Result<Mesh> parse_ply(std::string_view bytes) {
  const Header header = ALHAZEN_TRY(parse_header(bytes));
  const auto find = [&](Kind kind) {
    return std::find_if(header.elements.begin(), header.elements.end(),
                        [kind](const Element& e) { return e.kind == kind; });
  };
  const auto vertex = find(Kind::vertex);
  if (vertex == header.elements.end() || !vertex->has(Role::x) || !vertex->has(Role::y) ||
      !vertex->has(Role::z))
    return Error{Code::invalid, "the header lacks an element vertex with x, y and z"};
  const auto face = find(Kind::face);
  if (face == header.elements.end() || !face->has(Role::corners))
    return Error{Code::invalid, "the header lacks an element face with a list vertex_indices"};
  static_assert(std::endian::native == std::endian::little,
                "BinarySource swaps for big-endian files");
  switch (header.coded) {
    case Coded::ascii:
      return read_body(AsciiSource(bytes, header.end), header);
    case Coded::little:
      return read_body(BinarySource<false>(bytes, header.end), header);
    case Coded::big:
      return read_body(BinarySource<true>(bytes, header.end), header);
  }
  return Error{Code::internal, "a PLY coding nobody handles"};
}

}  // namespace alhazen
