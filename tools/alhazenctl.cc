// alhazenctl: one sub-command per verb of the control socket, made from the daemon's own table.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <list>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/base/exit_code.h"
#include "daemon/control/message.h"
#include "daemon/control/verbs.h"
#include "tools/ctl_client.h"
#include "tools/ctl_options.h"
#include "tools/ctl_show.h"
#include "tools/ctl_watch.h"

namespace alhazen::ctl {
namespace {

using nlohmann::json;

/// What holds for every sub-command.
struct Common {
  std::string endpoint = "ipc:///run/alhazen/control", events;
  int timeout_ms = 5000;
  bool json = false;
};

/// A sub-command of a verb and what was typed for it.
struct Command {
  const Verb* verb = nullptr;
  CLI::App* app = nullptr;
  std::vector<Option> options;
  std::map<std::string, std::vector<std::string>> given;
  std::string args, idem;
  bool watch = false;
};

void add_common(CLI::App& app, Common& common) {
  app.add_flag("--json", common.json, "the answer as JSON, for scripts");
  app.add_option("--endpoint", common.endpoint, "control socket of the daemon")
      ->envname("ALHAZEN_ENDPOINT")
      ->capture_default_str();
  app.add_option("--events", common.events, "event socket; default as the daemon says");
  app.add_option("--timeout", common.timeout_ms, "how long to wait for an answer, ms")
      ->check(CLI::Range(1, 3'600'000))
      ->capture_default_str();
}

/// What stands behind an option in the help.
std::string type_name(const Argument& argument) {
  switch (argument.type) {
    case Argument::Type::text:
      return "TEXT";
    case Argument::Type::id:
      return "NAME";
    case Argument::Type::whole:
    case Argument::Type::number:
      return "NUMBER";
    case Argument::Type::flag:
      return "true|false";
    case Argument::Type::choice: {
      std::string words;
      for (const std::string& word : argument.choices) words += (words.empty() ? "" : "|") + word;
      return words;
    }
    case Argument::Type::list:
      return type_name(argument.fields.front()) + ",...";
    case Argument::Type::table:
      return "JSON";
  }
  return "";
}

void add_verb(CLI::App& group, const Verb& verb, Common& common, std::list<Command>& commands) {
  Command& command = commands.emplace_back();
  command.verb = &verb;
  command.options = options_of(verb);
  command.app = group.add_subcommand(std::string(verb.word()), verb.help);
  for (const Option& option : command.options) {
    std::vector<std::string>& values = command.given[option.name()];
    const bool positional = option.argument->positional;
    CLI::Option* made =
        command.app->add_option((positional ? "" : "--") + option.name(), values, option.help());
    made->type_name(type_name(*option.argument));
    if (option.is_list())
      made->delimiter(',');
    else
      made->expected(1);
    // --args may hold it, so only the daemon can tell that it is missing.
    if (positional && option.required && verb.arguments.size() == 1) made->required();
  }
  command.app->add_option("--args", command.args,
                          "arguments as a JSON object, or @FILE; options win over it");
  if (verb.changes)
    command.app->add_option("--idem", command.idem,
                            "repeats with the same key within a day do nothing twice");
  if (verb.makes_job)
    command.app->add_flag("--watch,-w", command.watch, "follow the job to its end");
  std::string footer = "Answer: " + verb.reply;
  if (!verb.errors.empty()) footer += "\nErrors: " + verb.errors;
  command.app->footer(footer);
  add_common(*command.app, common);
}

Result<json> base_arguments(const std::string& args) {
  if (args.empty()) return json::object();
  std::string text = args;
  if (args.front() == '@') {
    std::ifstream file(args.substr(1), std::ios::binary);
    if (!file) return Error{Code::unavailable, "cannot read " + args.substr(1)};
    text.assign(std::istreambuf_iterator<char>(file), {});
  }
  json parsed = ALHAZEN_TRY(parse_json(text).in("--args"));
  if (!parsed.is_object()) return Error{Code::invalid, "--args is no object"};
  return parsed;
}

void print(const json& reply, const Common& common, std::string_view verb) {
  const std::string text = common.json ? dump(reply, 2) + "\n" : show(verb, reply);
  std::fwrite(text.data(), 1, text.size(), stdout);
}

Result<int> perform(const Command& command, const Common& common) {
  json args =
      arguments_of(command.options, command.given, ALHAZEN_TRY(base_arguments(command.args)));
  Client client =
      ALHAZEN_TRY(Client::connect(common.endpoint, std::chrono::milliseconds(common.timeout_ms)));
  // Before the job begins, so that none of its events is missed.
  if (command.watch) ALHAZEN_TRY(client.subscribe(common.events));
  const json reply = ALHAZEN_TRY(client.ask(command.verb->name, args, command.idem));
  if (!command.watch) {
    print(reply, common, command.verb->name);
    return 0;
  }
  std::vector<std::string> jobs;
  if (reply.contains("job")) jobs.push_back(reply.at("job").get<std::string>());
  if (reply.contains("jobs"))
    for (const json& row : reply.at("jobs")) jobs.push_back(row.at("job").get<std::string>());
  int worst = 0;
  for (const std::string& job : jobs) {
    if (!common.json) std::printf("job %s\n", job.c_str());
    const int code = ALHAZEN_TRY(
        watch_job(client, job, {common.json, !common.json && isatty(STDOUT_FILENO) == 1}));
    if (worst == 0) worst = code;
  }
  return worst;
}

/// What a person may do about an error that the daemon did not answer with, or did.
std::string hint_about(const Error& error) {
  if (error.code == Code::unavailable)
    return "is alhazend running, and is it this endpoint? --endpoint or ALHAZEN_ENDPOINT names it";
  if (error.code == Code::timeout) return "--timeout gives it more time";
  return std::string(hint_of(error.code));
}

int complain(const Error& error, bool as_json) {
  if (as_json) {
    json told = to_json(error);
    told["hint"] = hint_about(error);
    std::printf("%s\n", dump({{"error", std::move(told)}}, 2).c_str());
  } else {
    std::fprintf(stderr, "alhazenctl: %s\n", printable(error.text()).c_str());
    if (const std::string hint = hint_about(error); !hint.empty())
      std::fprintf(stderr, "hint: %s\n", hint.c_str());
  }
  return exit_code(error.code);
}

int run(int argc, char** argv) {
  Common common;
  std::list<Command> commands;
  CLI::App cli{
      "alhazenctl: asks the scanning daemon alhazend to do things, and tells what it does.\n\n"
      "A first scan:\n"
      "  alhazenctl status                            is the rig ready?\n"
      "  alhazenctl plan list                         which plans there are\n"
      "  alhazenctl plan estimate --plan-preset fine  how long, how much disk\n"
      "  alhazenctl scan submit bunny --plan-preset fine --watch\n"
      "  alhazenctl scan list                         what was scanned, and where it lies\n",
      "alhazenctl"};
  cli.set_version_flag("--version", ALHAZEN_VERSION);
  cli.require_subcommand(1);
  cli.footer(
      "alhazenctl GROUP --help lists a group, alhazenctl GROUP VERB --help all about a verb.\n"
      "Exit codes by kind of error: 0 done, 64 wrong request, 69 something is not there,\n"
      "70 a bug, 74 disk or memory full, 75 not now: try again, 130 cancelled.");

  static const std::map<std::string_view, const char*> kGroups = {
      {"session", "the daemon itself"},
      {"rig", "the rig as a whole"},
      {"device", "cameras, displays, turntable"},
      {"plan", "plans and what they take"},
      {"scan", "scans"},
      {"reconstruct", "meshes from scans"},
      {"job", "whatever the daemon works on"},
      {"queue", "jobs that wait"},
      {"preview", "a look through the cameras"},
      {"events", "what happens"},
      {"config", "the configuration"},
      {"log", "the log"},
      {"service", "the service"}};
  std::map<std::string, CLI::App*, std::less<>> groups;
  for (const Verb& verb : verbs()) {
    const std::string group(verb.group());
    if (!groups.contains(group)) {
      const auto about = kGroups.find(verb.group());
      groups[group] = cli.add_subcommand(group, about == kGroups.end() ? "" : about->second);
      groups[group]->require_subcommand(1);
    }
    add_verb(*groups[group], verb, common, commands);
    // The three of the session, as everybody types them.
    if (group == "session") add_verb(cli, verb, common, commands);
  }
  std::string watched, topic;
  CLI::App* job_watch = groups.at("job")->add_subcommand("watch", "follows a job to its end");
  job_watch->add_option("job", watched, "id of the job")->required();
  add_common(*job_watch, common);
  CLI::App* events_watch = groups.at("events")->add_subcommand("watch", "prints what happens");
  events_watch->add_option("topic", topic, "only topics that begin so: scan, job, device, preview");
  add_common(*events_watch, common);
  std::string shell;
  CLI::App* completion_app = cli.add_subcommand("completion", "a completion script for your shell");
  completion_app->add_option("shell", shell, "bash or zsh")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh"}));
  try {
    cli.parse(argc, argv);
  } catch (const CLI::Success& success) {
    return cli.exit(success);
  } catch (const CLI::ParseError& error) {
    // Nothing is parsed yet, so the flag is looked for as it was typed.
    const bool as_json = std::find(argv, argv + argc, std::string_view("--json")) != argv + argc;
    return complain({Code::invalid, std::string(error.what()) + " (--help tells more)"}, as_json);
  }

  if (completion_app->parsed()) {
    std::fputs(completion(shell == "zsh").c_str(), stdout);
    return 0;
  }
  const auto follow = [&](const auto& how) -> Result<int> {
    Client client =
        ALHAZEN_TRY(Client::connect(common.endpoint, std::chrono::milliseconds(common.timeout_ms)));
    ALHAZEN_TRY(client.subscribe(common.events));
    return how(client);
  };
  Result<int> outcome = 0;
  if (job_watch->parsed())
    outcome = follow([&](Client& client) {
      return watch_job(client, watched, {common.json, !common.json && isatty(STDOUT_FILENO) == 1});
    });
  if (events_watch->parsed())
    outcome = follow([&](Client& client) -> Result<int> {
      ALHAZEN_TRY(watch_events(client, topic, common.json));
      return 0;
    });
  for (const Command& command : commands)
    if (command.app->parsed()) outcome = perform(command, common);
  return outcome ? *outcome : complain(outcome.error(), common.json);
}

}  // namespace
}  // namespace alhazen::ctl

int main(int argc, char** argv) { return alhazen::ctl::run(argc, argv); }
