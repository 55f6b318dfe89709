#include "daemon/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <array>
#include <utility>

namespace alhazen {
namespace {

constexpr std::array<std::pair<std::string_view, Severity>, 4> kNames{{
    {"debug", Severity::debug},
    {"info", Severity::info},
    {"warning", Severity::warning},
    {"error", Severity::error},
}};

spdlog::level::level_enum level_of(Severity severity) {
  switch (severity) {
    case Severity::debug:
      return spdlog::level::debug;
    case Severity::info:
      return spdlog::level::info;
    case Severity::warning:
      return spdlog::level::warn;
    case Severity::error:
      break;
  }
  return spdlog::level::err;
}

/// What systemd reads at the start of a line: sd-daemon(3), SD_ERR and its siblings.
std::string_view journal_prefix(Severity severity) {
  switch (severity) {
    case Severity::debug:
      return "<7>";
    case Severity::info:
      return "<6>";
    case Severity::warning:
      return "<4>";
    case Severity::error:
      break;
  }
  return "<3>";
}

}  // namespace

struct StderrLog::State {
  explicit State(bool terminal)
      : terminal_(terminal), logger_("alhazen", std::make_shared<spdlog::sinks::stderr_sink_mt>()) {
    // Under systemd the journal has its own clock, so the line needs none.
    logger_.set_pattern(terminal ? "%Y-%m-%d %H:%M:%S.%e %-7l %v" : "%v");
    logger_.flush_on(spdlog::level::debug);
  }
  const bool terminal_;
  spdlog::logger logger_;
};

StderrLog::StderrLog(Severity least)
    : state_(std::make_unique<State>(std::getenv("JOURNAL_STREAM") == nullptr)) {
  set_level(least);
}

StderrLog::~StderrLog() = default;

void StderrLog::write(Severity severity, std::string_view line) noexcept {
  // One event, one line, whatever a driver hands in.
  std::string flat(line);
  for (char& c : flat)
    if (c == '\n' || c == '\r') c = ' ';
  state_->logger_.log(level_of(severity), "{}{}",
                      state_->terminal_ ? std::string_view() : journal_prefix(severity), flat);
}

void StderrLog::set_level(Severity least) noexcept { state_->logger_.set_level(level_of(least)); }

Result<Severity> severity_of(std::string_view name) {
  for (const auto& [known, severity] : kNames)
    if (known == name) return severity;
  return Error{Code::invalid,
               "level '" + std::string(name) + "' is not one of debug, info, warning, error"};
}

}  // namespace alhazen
