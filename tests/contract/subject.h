#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <optional>
#include <ostream>
#include <stop_token>
#include <string>

#include "alhazen/clock.h"
#include "alhazen/result.h"

namespace alhazen::contract {

/// A device that a contract suite is run on: how to open it afresh, and the clock it lives by.
template <class Device>
struct Subject {
  std::string name;
  std::function<Result<std::unique_ptr<Device>>()> open;
  Clock* clock = nullptr;

  friend void PrintTo(const Subject& subject, std::ostream* out) { *out << subject.name; }
};

/// One line of a state table: what a call answers in a state, and the state it leaves behind.
struct Transition {
  const char* state;
  const char* call;
  std::optional<Code> answer;  ///< none: success
  const char* next;
};

/// A stop token that has been asked to stop already.
inline std::stop_token stopped() {
  std::stop_source source;
  source.request_stop();
  return source.get_token();
}

/// The code of a Result, none for success.
template <class Answer>
std::optional<Code> code_of(const Answer& answer) {
  return answer ? std::nullopt : std::optional(answer.error().code);
}

inline std::string text_of(std::optional<Code> code) {
  return code ? std::string(name_of(*code)) : "success";
}

/// How late an answer may come after its deadline.
inline constexpr Micros kDeadlineSlack{50'000};

}  // namespace alhazen::contract
