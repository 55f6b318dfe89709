#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace alhazen::ctl {

/// A reply for people: lists of objects as tables, everything else as indented lines. Control
/// characters that a device or a note may hold are shown, never sent to the terminal.
[[nodiscard]] std::string show(std::string_view verb, const nlohmann::json& reply);

/// "1 h 02 min", "3.4 s".
[[nodiscard]] std::string duration_text(double seconds);

/// A text without anything that steers a terminal.
[[nodiscard]] std::string printable(std::string_view text);

}  // namespace alhazen::ctl
