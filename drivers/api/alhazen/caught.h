#pragma once

#include <exception>
#include <new>
#include <string>
#include <type_traits>
#include <utility>

#include "alhazen/result.h"

namespace alhazen {
namespace detail {

template <class T>
concept AnyResult = requires(const T& answer) {
  answer.error();
};

}  // namespace detail

/// Runs `body`; an exception of the throwing library inside becomes an Error. For the edges of leaf
/// files only. `body` returns a Result, a Status or a plain value.
template <class Body>
[[nodiscard]] auto caught(Code code, std::string_view what, Body&& body) noexcept {
  using Out = std::invoke_result_t<Body>;
  constexpr bool kIsResult = detail::AnyResult<Out>;
  using Answer = std::conditional_t<kIsResult, Out, Result<Out>>;
  try {
    if constexpr (kIsResult || !std::is_void_v<Out>) {
      return Answer(std::forward<Body>(body)());
    } else {
      std::forward<Body>(body)();
      return Answer();
    }
  } catch (const std::bad_alloc&) {
    return Answer(Error{Code::exhausted, std::string(what) + ": out of memory"});
  } catch (const std::exception& e) {
    return Answer(Error{code, std::string(what) + ": " + e.what()});
  }
}

}  // namespace alhazen
