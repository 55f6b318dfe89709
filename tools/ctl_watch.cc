#include "tools/ctl_watch.h"

#include <signal.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "alhazen/caught.h"
#include "daemon/base/exit_code.h"
#include "daemon/control/message.h"
#include "daemon/jobs/job.h"
#include "tools/ctl_show.h"

namespace alhazen::ctl {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

volatile sig_atomic_t interrupted = 0;

/// What is drawn of a job: bars on a terminal, a line per tenth elsewhere.
class Picture {
 public:
  explicit Picture(bool terminal) : terminal_(terminal) {}

  void stages(const json& stages, std::uint64_t retakes) {
    retakes_ = retakes;
    const auto now = steady_clock::now();
    for (const json& row : stages) {
      Stage& stage = stage_named(row.at("stage").get<std::string>());
      const double share = row.at("share").get<double>();
      // A stage is known from the job's start, and begins when it first gets on.
      if (share <= 0) continue;
      if (stage.since == steady_clock::time_point()) stage.since = now, stage.first = share;
      stage.share = share;
      stage.done = row.value("done", std::uint64_t{0});
      stage.total = row.value("total", std::uint64_t{0});
      stage.seconds = std::chrono::duration<double>(now - stage.since).count();
      if (!terminal_ && (share >= stage.told + 0.1 || (share >= 1 && stage.told < 1))) {
        stage.told = share;
        std::printf("%-8s %s\n", stage.name.c_str(), figures(stage).c_str());
        std::fflush(stdout);
      }
    }
    draw();
  }

  /// A line that stays.
  void say(const std::string& line) {
    erase();
    std::printf("%s\n", printable(line).c_str());
    std::fflush(stdout);
    draw();
  }

 private:
  struct Stage {
    std::string name;
    double share = 0, first = 0, told = 0, seconds = 0;
    std::uint64_t done = 0, total = 0;
    steady_clock::time_point since;
  };

  Stage& stage_named(const std::string& name) {
    for (Stage& stage : stages_)
      if (stage.name == name) return stage;
    stages_.emplace_back();
    stages_.back().name = name;
    return stages_.back();
  }

  static std::string figures(const Stage& stage) {
    char text[96];
    std::snprintf(text, sizeof text, "%5.1f %%", 100 * stage.share);
    std::string line = text;
    if (stage.total > 0) {
      line += "  " + std::to_string(stage.done) + "/" + std::to_string(stage.total);
      const double rate = (stage.share - stage.first) * static_cast<double>(stage.total) /
                          std::max(0.1, stage.seconds);
      if (rate > 0 && stage.share < 1) {
        std::snprintf(text, sizeof text, "  %.1f/s", rate);
        line += text;
      }
    }
    // The first moments say nothing about the rest.
    if (stage.share < 1 && stage.share - stage.first > 0.02)
      line += "  " +
              duration_text(stage.seconds * (1 - stage.share) / (stage.share - stage.first)) +
              " left";
    return line;
  }

  void erase() {
    if (drawn_ > 0) std::printf("\x1b[%zuA\x1b[J", drawn_);
    drawn_ = 0;
  }

  void draw() {
    if (!terminal_) return;
    erase();
    constexpr int kWidth = 30;
    for (const Stage& stage : stages_) {
      const int filled = static_cast<int>(std::clamp(stage.share, 0.0, 1.0) * kWidth);
      std::printf("%-8s [%s%s] %s\n", stage.name.c_str(),
                  std::string(static_cast<std::size_t>(filled), '#').c_str(),
                  std::string(static_cast<std::size_t>(kWidth - filled), '.').c_str(),
                  figures(stage).c_str());
      ++drawn_;
    }
    if (retakes_ > 0) {
      std::printf("%-8s %llu\n", "retakes", static_cast<unsigned long long>(retakes_));
      ++drawn_;
    }
    std::fflush(stdout);
  }

  const bool terminal_;
  std::vector<Stage> stages_;
  std::uint64_t retakes_ = 0;
  std::size_t drawn_ = 0;
};

int code_of(const json& job) {
  const JobState state = job_state(job.at("state").get<std::string>()).value_or(JobState::failed);
  if (state == JobState::done || state == JobState::done_with_gaps) return 0;
  if (state == JobState::cancelled) return exit_code(Code::cancelled);
  if (const auto error = job.find("error"); error != job.end())
    return exit_code(error_from_json(*error).code);
  return exit_code(Code::conflict);  // stopped: it can be resumed
}

void say_end(const json& job, Picture& picture) {
  picture.say("job " + job.at("id").get<std::string>() + ": " + job.at("state").get<std::string>());
  if (const auto error = job.find("error"); error != job.end()) {
    const Error why = error_from_json(*error);
    picture.say(why.text());
    if (const auto hint = hint_of(why.code); !hint.empty())
      picture.say("hint: " + std::string(hint));
  }
  const auto result = job.find("result");
  if (result == job.end()) return;
  const std::string directory = job.value("directory", "");
  if (const auto files = result->find("files"); files != result->end())
    for (const auto& [name, file] : files->items()) {
      const std::string path = file.get<std::string>();
      std::string line = name + ": ";
      if (!path.starts_with('/')) line += directory + "/";
      picture.say(line + path);
    }
  if (const auto checks = result->find("checks"); checks != result->end())
    for (const json& row : *checks)
      picture.say((row.at("ok").get<bool>() ? "ok    " : "FAILS ") +
                  row.at("name").get<std::string>() + ": " + row.at("detail").get<std::string>());
}

void say_event(const std::string& topic, const json& body, Picture& picture) {
  if (topic == "scan.progress")
    picture.stages(body.at("stages"), body.at("retakes").get<std::uint64_t>());
  else if (topic == "scan.warning")
    picture.say("warning: " + body.at("warning").get<std::string>());
  else if (topic == "scan.retake")
    picture.say("retake: stop " + body.at("stop").dump() + ", display " +
                body.at("display").get<std::string>() + ", camera " +
                body.at("camera").get<std::string>() + ": " + body.at("what").get<std::string>());
  else if (topic == "preview.mesh")
    picture.say("preview after " + body.at("stops").dump() +
                " stops: " + body.at("file").get<std::string>());
  else if (topic == "preview.camera")
    picture.say(body.at("camera").get<std::string>() + ": " + body.at("file").get<std::string>());
  else if (topic == "job.state" && body.at("state") == "paused")
    picture.say("paused: " + body.at("pause_reason").get<std::string>());
}

}  // namespace

void catch_interrupt() {
  struct sigaction action {};
  action.sa_handler = [](int) { interrupted = 1; };
  sigaction(SIGINT, &action, nullptr);
}

Result<int> watch_job(Client& client, const std::string& job, const WatchOptions& options) {
  return caught(Code::corrupt, "event", [&]() -> Result<int> {
    catch_interrupt();
    Picture picture(options.terminal);
    const json args = {{"job", job}};
    // Events make it quick; asking now and then makes it right, whatever events were lost.
    constexpr milliseconds kAskEvery{1000};
    steady_clock::time_point ask_at;
    std::string waiting_for;
    std::string goes_on = "job " + job;
    goes_on.append(" goes on; alhazenctl job abort ").append(job).append(" ends it");
    while (true) {
      if (interrupted != 0) return Error{Code::cancelled, goes_on};
      bool ended = false;
      const auto event = ALHAZEN_TRY(client.next_event(milliseconds(250)));
      if (event) {
        const json parsed = json::parse(event->text);
        const json& body = parsed.at("body");
        if (body.value("job", body.value("id", "")) == job) {
          if (options.json)
            std::printf("%s\n", event->text.c_str());
          else
            say_event(event->topic, body, picture);
          if (const auto state = job_state(body.value("state", "")); state && is_at_rest(*state))
            ended = true;
        }
      }
      if (!ended && steady_clock::now() < ask_at) continue;
      ask_at = steady_clock::now() + kAskEvery;
      const json reply = ALHAZEN_TRY(client.ask("job.get", args));
      const json& now = reply.at("job");
      if (!options.json) picture.stages(now.at("stages"), now.at("retakes").get<std::uint64_t>());
      if (const std::string why = now.value("waiting_for", ""); why != waiting_for) {
        waiting_for = why;
        if (!why.empty() && !options.json) picture.say("waiting: " + why);
      }
      const auto state = job_state(now.at("state").get<std::string>());
      if (!state || !is_at_rest(*state)) continue;
      if (options.json)
        std::printf("%s\n", dump(now).c_str());
      else
        say_end(now, picture);
      return code_of(now);
    }
  });
}

Status watch_events(Client& client, const std::string& topic, bool as_json) {
  return caught(Code::corrupt, "event", [&]() -> Status {
    catch_interrupt();
    while (interrupted == 0) {
      const auto event = ALHAZEN_TRY(client.next_event(milliseconds(250)));
      if (!event || !event->topic.starts_with(topic)) continue;
      if (as_json) {
        std::printf("%s\n", event->text.c_str());
      } else {
        const json parsed = json::parse(event->text);
        std::printf("%s  %-14s %s\n", parsed.at("at").get<std::string>().c_str(),
                    event->topic.c_str(), dump(parsed.at("body")).c_str());
      }
      std::fflush(stdout);
    }
    return {};
  });
}

}  // namespace alhazen::ctl
