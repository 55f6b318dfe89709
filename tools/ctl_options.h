#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "daemon/control/verbs.h"

namespace alhazen::ctl {

/// One option of a sub-command, made from an argument of its verb: plan.stops → --plan-stops.
struct Option {
  std::vector<std::string> path;  ///< keys from the arguments down
  const Argument* argument = nullptr;
  bool required = false;

  [[nodiscard]] std::string name() const;  ///< "plan-stops"
  [[nodiscard]] bool is_list() const { return argument->type == Argument::Type::list; }
  [[nodiscard]] std::string help() const;
};

/// Every option of a verb, in the order of the table. Lists of objects are left out: they come by
/// --args.
[[nodiscard]] std::vector<Option> options_of(const Verb& verb);

/// What a person typed (option name → values), as arguments of the protocol, put over `base`.
/// A text that is no number stays a text: the daemon says what it must be.
[[nodiscard]] nlohmann::json arguments_of(
    const std::vector<Option>& options,
    const std::map<std::string, std::vector<std::string>>& given, nlohmann::json base);

/// A script for bash or zsh that completes groups, verbs and options.
[[nodiscard]] std::string completion(bool zsh);

}  // namespace alhazen::ctl
