#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <variant>

#include "alhazen/check.h"

namespace alhazen {

/// What went wrong, named by what the one who receives it can do about it.
/// The list is part of the control protocol: adding one is a protocol change.
enum class Code : std::uint8_t {
  cancelled,    ///< somebody asked to stop: unwind, do not log as a failure
  timeout,      ///< no answer in time: retry the same call
  unavailable,  ///< device absent, unplugged, claimed: re-open, then retry
  corrupt,      ///< data damaged: retake the frame, re-read the file
  invalid,      ///< the request or the configuration is wrong: fix it, never retry
  conflict,     ///< right request, wrong moment: wait or change state first
  unsupported,  ///< this device or build cannot: choose another way
  exhausted,    ///< disk, memory, buffers: an operator must free something
  internal,     ///< our bug: report it
};

/// The protocol's word for a code.
[[nodiscard]] constexpr std::string_view name_of(Code code) noexcept {
  constexpr std::string_view kNames[] = {"cancelled",   "timeout",   "unavailable",
                                         "corrupt",     "invalid",   "conflict",
                                         "unsupported", "exhausted", "internal"};
  return kNames[static_cast<std::size_t>(code)];
}

/// Why a call failed. Never changed after construction, only wrapped in context on the way out.
struct Error {
  Code code = Code::internal;
  std::string what;        ///< one sentence with the values: "exposure 12 us is below 20 us"
  std::string where = {};  ///< outermost first: "scan 42 / camera left / configure"

  /// The same error seen from one level further out.
  [[nodiscard]] Error in(std::string_view context) && {
    where = where.empty() ? std::string(context) : std::string(context) + " / " + where;
    return std::move(*this);
  }
  [[nodiscard]] Error in(std::string_view context) const& { return Error(*this).in(context); }

  /// "invalid: exposure 12 us is below 20 us (camera left / configure)".
  [[nodiscard]] std::string text() const {
    std::string line = std::string(name_of(code)) + ": " + what;
    return where.empty() ? line : line + " (" + where + ")";
  }
};

/// A value, or why there is none. Ignoring one does not compile.
template <class T>
class [[nodiscard]] Result {
 public:
  // Implicit, so that `return value;` and `return Error{…};` read as what they are.
  // NOLINTNEXTLINE(google-explicit-constructor)
  Result(T value) : content_(std::in_place_index<0>, std::move(value)) {}
  // NOLINTNEXTLINE(google-explicit-constructor)
  Result(Error error) : content_(std::in_place_index<1>, std::move(error)) {}

  [[nodiscard]] explicit operator bool() const noexcept { return content_.index() == 0; }

  /// REQUIRES: bool(*this).
  [[nodiscard]] T& operator*() & { return *checked(); }
  [[nodiscard]] const T& operator*() const& { return *checked(); }
  [[nodiscard]] T&& operator*() && { return std::move(*checked()); }
  [[nodiscard]] T* operator->() { return checked(); }
  [[nodiscard]] const T* operator->() const { return checked(); }

  /// REQUIRES: !bool(*this).
  [[nodiscard]] Error& error() {
    ALHAZEN_CHECK(content_.index() == 1);
    return *std::get_if<1>(&content_);
  }
  [[nodiscard]] const Error& error() const {
    ALHAZEN_CHECK(content_.index() == 1);
    return *std::get_if<1>(&content_);
  }

  /// The same result, its error seen from one level further out.
  [[nodiscard]] Result in(std::string_view context) && {
    if (content_.index() == 1) return std::move(error()).in(context);
    return std::move(*this);
  }

 private:
  [[nodiscard]] T* checked() {
    ALHAZEN_CHECK(content_.index() == 0);
    return std::get_if<0>(&content_);
  }
  [[nodiscard]] const T* checked() const {
    ALHAZEN_CHECK(content_.index() == 0);
    return std::get_if<0>(&content_);
  }

  std::variant<T, Error> content_;
};

/// Success, or why not.
template <>
class [[nodiscard]] Result<void> {
 public:
  Result() = default;
  // NOLINTNEXTLINE(google-explicit-constructor)
  Result(Error error) : error_(std::move(error)) {}

  [[nodiscard]] explicit operator bool() const noexcept { return !error_; }
  void operator*() const { ALHAZEN_CHECK(!error_); }

  /// REQUIRES: !bool(*this).
  [[nodiscard]] Error& error() {
    ALHAZEN_CHECK(error_.has_value());
    return *error_;  // NOLINT(bugprone-unchecked-optional-access): checked above
  }
  [[nodiscard]] const Error& error() const {
    ALHAZEN_CHECK(error_.has_value());
    return *error_;  // NOLINT(bugprone-unchecked-optional-access): checked above
  }

  [[nodiscard]] Result in(std::string_view context) && {
    if (error_) return std::move(*error_).in(context);
    return {};
  }

 private:
  std::optional<Error> error_;
};
using Status = Result<void>;

}  // namespace alhazen

/// The value of `expression`, or return its error from the enclosing function. May be nested.
#define ALHAZEN_TRY(expression) ALHAZEN_TRY_NAMED(expression, __COUNTER__)
#define ALHAZEN_TRY_NAMED(expression, number) ALHAZEN_TRY_EXPANDED(expression, number)
#define ALHAZEN_TRY_EXPANDED(expression, number)                               \
  __extension__({                                                              \
    auto alhazen_try_##number = (expression);                                  \
    if (!alhazen_try_##number) return std::move(alhazen_try_##number.error()); \
    *std::move(alhazen_try_##number);                                          \
  })
