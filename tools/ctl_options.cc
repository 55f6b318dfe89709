#include "tools/ctl_options.h"

#include <algorithm>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <utility>

namespace alhazen::ctl {
namespace {

using nlohmann::json;
using Type = Argument::Type;

void collect(const std::vector<Argument>& arguments, const std::vector<std::string>& path,
             bool required, std::vector<Option>& options) {
  for (const Argument& argument : arguments) {
    std::vector<std::string> here = path;
    here.push_back(argument.name);
    if (argument.type == Type::table)
      collect(argument.fields, here, required && argument.required, options);
    else if (argument.type != Type::list || argument.fields.front().type != Type::table)
      options.push_back({here, &argument, required && argument.required});
  }
}

/// One value as the protocol has it; what does not fit is sent as it was typed.
json value_of(Type type, const std::string& typed) {
  if (type == Type::flag && (typed == "true" || typed == "false")) return typed == "true";
  if (type == Type::whole || type == Type::number) {
    json number = json::parse(typed, nullptr, false);
    if (number.is_number()) return number;
  }
  return typed;
}

/// A text in single quotes for the shell.
std::string quoted(const std::string& text) {
  std::string made = "'";
  for (const char c : text) made += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return made + "'";
}

std::string joined(const std::vector<std::string>& words) {
  std::string line;
  for (const std::string& word : words) line += (line.empty() ? "" : " ") + word;
  return line;
}

}  // namespace

std::string Option::name() const {
  std::string made;
  for (const std::string& key : path) made += (made.empty() ? "" : "-") + key;
  std::replace(made.begin(), made.end(), '_', '-');
  return made;
}

std::string Option::help() const {
  std::string made = argument->help + "; " + argument->wanted();
  if (!argument->fallback.empty()) made += "; default " + argument->fallback;
  return made;
}

std::vector<Option> options_of(const Verb& verb) {
  std::vector<Option> options;
  collect(verb.arguments, {}, true, options);
  return options;
}

json arguments_of(const std::vector<Option>& options,
                  const std::map<std::string, std::vector<std::string>>& given, json base) {
  for (const Option& option : options) {
    const auto typed = given.find(option.name());
    if (typed == given.end() || typed->second.empty()) continue;
    json value;
    if (option.is_list()) {
      value = json::array();
      for (const std::string& one : typed->second)
        value.push_back(value_of(option.argument->fields.front().type, one));
    } else {
      value = value_of(option.argument->type, typed->second.back());
    }
    json* place = &base;
    for (const std::string& key : option.path) place = &(*place)[key];
    *place = std::move(value);
  }
  return base;
}

std::string completion(bool zsh) {
  std::map<std::string, std::vector<std::string>> words;
  std::vector<std::string> first = {"completion"};
  std::string cases;
  const std::vector<std::string> everywhere = {"--json", "--endpoint", "--events", "--timeout",
                                               "--help"};
  for (const Verb& verb : verbs()) {
    words[std::string(verb.group())].emplace_back(verb.word());
    std::vector<std::string> line;
    for (const Option& option : options_of(verb)) {
      if (option.argument->positional) {
        // Its value stands alone; where it is one of a list, the list is what can be typed.
        line.insert(line.end(), option.argument->choices.begin(), option.argument->choices.end());
        continue;
      }
      line.push_back("--" + option.name());
      if (option.argument->type == Type::choice)
        cases += "    " +
                 quoted(std::string(verb.group()) + " " + std::string(verb.word()) + " --" +
                        option.name()) +
                 ") words=" + quoted(joined(option.argument->choices)) + " ;;\n";
    }
    if (verb.makes_job) line.emplace_back("--watch");
    if (verb.changes) line.emplace_back("--idem");
    line.emplace_back("--args");
    line.insert(line.end(), everywhere.begin(), everywhere.end());
    // The three of the session may be typed without their group.
    const bool short_too = verb.group() == "session";
    if (short_too) first.emplace_back(verb.word());
    cases += "    " + quoted(std::string(verb.group()) + " " + std::string(verb.word()) + " ") +
             (short_too ? "|" + quoted(std::string(verb.word())) : "") +
             ") words=" + quoted(joined(line)) + " ;;\n";
  }
  for (const char* group : {"job", "events"}) {
    words[group].emplace_back("watch");
    cases += "    " + quoted(std::string(group) + " watch ") +
             ") words=" + quoted(joined(everywhere)) + " ;;\n";
  }
  for (const auto& [group, list] : words) {
    first.push_back(group);
    cases += "    " + quoted(group) + ") words=" + quoted(joined(list)) + " ;;\n";
  }
  std::string script;
  if (zsh) script += "#compdef alhazenctl\nautoload -U +X bashcompinit && bashcompinit\n";
  script +=
      "# Made by `alhazenctl completion`; source it from your shell's start-up file.\n"
      "_alhazenctl() {\n"
      "  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD-1]} key words=\n"
      "  if ((COMP_CWORD == 1)); then key=; elif ((COMP_CWORD == 2)); then key=${COMP_WORDS[1]}\n"
      "  else key=\"${COMP_WORDS[1]} ${COMP_WORDS[2]} \"\n"
      "    case $previous in --*) key+=$previous ;; esac\n"
      "  fi\n"
      "  case $key in\n"
      "    '') words=" +
      quoted(joined(first)) + " ;;\n" + cases +
      "    completion) words='bash zsh' ;;\n"
      "  esac\n"
      "  COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n"
      "}\n"
      "complete -o default -F _alhazenctl alhazenctl\n";
  return script;
}

}  // namespace alhazen::ctl
