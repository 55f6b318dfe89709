#pragma once

#include <memory>
#include <string_view>

#include "alhazen/driver.h"
#include "alhazen/result.h"

namespace alhazen {

/// The daemon's log: one line an event on stderr, written at once: with the time for people,
/// with the prefix that the journal reads where stderr leads there. Thread-safe.
class StderrLog final : public Log {
 public:
  explicit StderrLog(Severity least = Severity::info);
  ~StderrLog() override;
  StderrLog(const StderrLog&) = delete;
  StderrLog& operator=(const StderrLog&) = delete;

  void write(Severity severity, std::string_view line) noexcept override;
  /// From now on, less severe lines are dropped (verb log.level). Thread-safe.
  void set_level(Severity least) noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;  // spdlog's types stay out of this header
};

/// debug, info, warning, error. Fails: invalid, listing them.
[[nodiscard]] Result<Severity> severity_of(std::string_view name);

}  // namespace alhazen
