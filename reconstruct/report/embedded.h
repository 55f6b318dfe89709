#pragma once

#include <string_view>

namespace alhazen {

/// A script that the build puts into the program, so that a page needs no file beside it.
struct EmbeddedScript {
  std::string_view text;
  std::string_view sha256;  ///< of the text, hexadecimal: what a page allows to run
};

/// three.js as Debian's package libjs-three has it.
[[nodiscard]] EmbeddedScript three_js();
/// view.js: the view that can be turned.
[[nodiscard]] EmbeddedScript view_js();

}  // namespace alhazen
