#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"

namespace alhazen {

/// What one argument of a verb may be: the one description from which arguments are checked, the
/// client's options and help are made, and `hello` tells a script what it may send.
///
/// Thread: reentrant, immutable.
struct Argument {
  enum class Type : std::uint8_t {
    text,    ///< any text; min … max is its length in bytes
    id,      ///< 1 … 64 characters out of a-z A-Z 0-9 . _ -
    whole,   ///< a whole number, min … max
    number,  ///< a finite number, min … max
    flag,    ///< true or false
    choice,  ///< one of `choices`
    list,    ///< min … max elements, each as `fields[0]`
    table,   ///< a JSON object with the keys of `fields`
  };

  std::string name;
  Type type = Type::text;
  std::string help;
  double min = 0, max = 0;
  std::string unit;                  ///< for people: "mm", "deg", "us"
  std::vector<std::string> choices;  ///< Type::choice
  std::vector<Argument> fields;      ///< Type::table: its keys; Type::list: one, its element
  std::string fallback;  ///< JSON text taken where the key is absent; empty: it stays absent
  bool required = false;
  bool positional = false;  ///< the client takes it without a name: `alhazenctl job get 17`

  [[nodiscard]] static Argument text(std::string name, std::string help, double min, double max);
  [[nodiscard]] static Argument id(std::string name, std::string help);
  [[nodiscard]] static Argument whole(std::string name, std::string help, double min, double max,
                                      std::string unit = {});
  [[nodiscard]] static Argument number(std::string name, std::string help, double min, double max,
                                       std::string unit = {});
  [[nodiscard]] static Argument flag(std::string name, std::string help);
  [[nodiscard]] static Argument choice(std::string name, std::string help,
                                       std::vector<std::string> choices);
  [[nodiscard]] static Argument list(std::string name, std::string help, double min, double max,
                                     Argument element);
  [[nodiscard]] static Argument table(std::string name, std::string help,
                                      std::vector<Argument> fields);

  /// The same argument, compulsory, with a default, or given by position.
  [[nodiscard]] Argument compulsory() &&;
  [[nodiscard]] Argument or_else(std::string json) &&;
  [[nodiscard]] Argument by_position() &&;

  /// What a value must be, for messages and help: "a whole number in [0, 12] mm".
  [[nodiscard]] std::string wanted() const;
  /// The same as JSON Schema, for `hello`.
  [[nodiscard]] nlohmann::json schema() const;
};

/// Checks `value` against a table of arguments and fills in defaults; `path` names it in messages
/// ("args").
/// Fails: invalid, naming the key and what is allowed: unknown key, missing key, wrong type, out of
///        range.
[[nodiscard]] Result<nlohmann::json> check_arguments(const std::vector<Argument>& arguments,
                                                     const nlohmann::json& value,
                                                     std::string_view path);

}  // namespace alhazen
