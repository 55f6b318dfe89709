#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <variant>

#include "alhazen/result.h"

namespace alhazen {

/// Version of the envelope: the key "v" of every message.
inline constexpr int kProtocol = 1;
/// Longest message that is read; a longer one is refused with `invalid`.
inline constexpr std::size_t kLargestMessage = std::size_t{1} << 20U;
/// Deepest nesting of objects and lists in a message.
inline constexpr int kDeepestMessage = 16;

/// One request: a verb with its arguments, not yet checked against the verb's table.
struct Request {
  std::string id;  ///< the client's own; the reply carries it
  std::string verb;
  std::shared_ptr<const nlohmann::json> args;  ///< an object; never null
  std::optional<std::string> idem;             ///< same key within 24 h: the stored answer
  std::int64_t deadline_ms = 0;                ///< how long the client waits; 0: it did not say
};

/// A message that is no request, with as much of its id as could be read.
struct Refusal {
  std::optional<std::string> id;
  Error error;
};

/// Reads the envelope. Hostile input welcome: any bytes, any nesting.
/// Refuses: invalid (too long, not JSON, nested too deeply, a key twice, not an object, unknown or
///          missing envelope key, wrong type, out of range), naming the key and what is allowed.
[[nodiscard]] std::variant<Request, Refusal> parse_request(std::string_view bytes);

/// The text of a request (for clients).
[[nodiscard]] std::string to_text(const Request& request);

/// What a client may do about an error, in a sentence; empty where the error says it all.
[[nodiscard]] std::string_view hint_of(Code code) noexcept;
/// Whether the same request may succeed later without being changed.
[[nodiscard]] bool is_retryable(Code code) noexcept;

/// An error as the protocol writes it: {code, what, where, hint, retryable}.
[[nodiscard]] nlohmann::json to_json(const Error& error);
/// The reverse. Anything that is not such an object becomes `internal`.
[[nodiscard]] Error error_from_json(const nlohmann::json& error);

/// The text of an answer. `rev` is the object of revision counters.
[[nodiscard]] std::string reply_text(std::string_view id, const nlohmann::json& ok,
                                     const nlohmann::json& rev);
[[nodiscard]] std::string refusal_text(const std::optional<std::string>& id, const Error& error,
                                       const nlohmann::json& rev);

/// JSON as text that is always valid UTF-8, whatever a device calls itself.
[[nodiscard]] std::string dump(const nlohmann::json& value, int indent = -1);

/// Parses JSON within the protocol's limits of length and nesting, refusing a key given twice.
/// Fails: invalid.
[[nodiscard]] Result<nlohmann::json> parse_json(std::string_view bytes);

}  // namespace alhazen
