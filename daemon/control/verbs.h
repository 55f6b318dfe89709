#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/control/arguments.h"

namespace alhazen {

/// Who may use a verb: each role may do what the ones before it may.
enum class Role : std::uint8_t { observer, operator_, admin };
[[nodiscard]] std::string_view name_of(Role role) noexcept;

/// One row of the protocol's table.
struct Verb {
  std::string name;  ///< "group.verb"; the client's `alhazenctl group verb`
  Role role = Role::observer;
  std::string help;
  std::vector<Argument> arguments;
  std::string reply;       ///< the keys of the answer
  std::string errors;      ///< besides `invalid` for wrong arguments
  bool makes_job = false;  ///< answers at once with a job's id; its end is an event
  bool changes = false;    ///< an answer under an idempotency key is stored

  [[nodiscard]] std::string_view group() const;
  [[nodiscard]] std::string_view word() const;
};

/// The whole protocol: `hello`, argument checking, the client's sub-commands, help and completion,
/// and docs are made from this table and nothing else.
[[nodiscard]] const std::vector<Verb>& verbs();
/// Null where nobody knows the verb.
[[nodiscard]] const Verb* find_verb(std::string_view name);
/// The table as `hello` sends it.
[[nodiscard]] nlohmann::json verbs_json();
/// The table as a page of Markdown (daemon/README.md refers to it).
[[nodiscard]] std::string verbs_markdown();

}  // namespace alhazen
