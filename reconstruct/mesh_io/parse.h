#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"

namespace alhazen {

// One parser a format; parse_mesh() chooses. All take hostile bytes: what they allocate is bounded
// by a small multiple of what is really there, never by what a header claims. None checks the
// triangles' indices against the number of vertices: parse_mesh() does, for all of them.
[[nodiscard]] Result<Mesh> parse_ply(std::string_view bytes);
[[nodiscard]] Result<Mesh> parse_obj(std::string_view bytes);
[[nodiscard]] Result<Mesh> parse_off(std::string_view bytes);
[[nodiscard]] Result<Mesh> parse_stl(std::string_view bytes);

/// The text of one file, line by line or word by word. Reentrant.
class Text {
 public:
  explicit Text(std::string_view bytes, std::size_t begin = 0) : bytes_(bytes), at_(begin) {}

  [[nodiscard]] bool at_end() const noexcept { return at_ >= bytes_.size(); }
  [[nodiscard]] std::size_t position() const noexcept { return at_; }
  /// The next line without its end (\n or \r\n); nothing at the end of the text.
  [[nodiscard]] std::optional<std::string_view> line();
  /// The next word, whatever line it stands on; nothing at the end of the text.
  [[nodiscard]] std::optional<std::string_view> word();
  /// Number, from 1, of the line that was read from last.
  [[nodiscard]] std::size_t line_number() const;

 private:
  std::string_view bytes_;
  std::size_t at_;
  std::size_t read_ = 0;  ///< where what was handed out last begins
};

/// Takes the first word off a line; nothing where only blanks are left.
[[nodiscard]] std::optional<std::string_view> take_word(std::string_view& line);

/// A whole word as a number: "nan" and "inf" are numbers here, too small is zero, too large is
/// infinite.
[[nodiscard]] std::optional<double> to_number(std::string_view word);
[[nodiscard]] std::optional<std::int64_t> to_integer(std::string_view word);

/// Whether a number can be kept in single precision.
[[nodiscard]] inline bool is_single(double value) noexcept {
  return std::abs(value) <= static_cast<double>(std::numeric_limits<float>::max());
}

/// A word of the file for an error message: printable and short.
[[nodiscard]] std::string shown(std::string_view word);

/// Corner of a triangle as it is kept: refuses what a 32-bit index cannot hold.
[[nodiscard]] constexpr bool is_index(std::int64_t value) noexcept {
  return value >= 0 && value < std::int64_t{0xffffffff};
}

}  // namespace alhazen
