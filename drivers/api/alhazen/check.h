#pragma once

#include <cstdio>
#include <cstdlib>

namespace alhazen::detail {

[[noreturn]] inline void check_failed(const char* expression, const char* file, int line) noexcept {
  std::fprintf(stderr, "%s:%d: broken invariant: %s\n", file, line, expression);
  std::abort();
}

}  // namespace alhazen::detail

/// Aborts, in release too, when our own invariant is broken; the service manager restarts and scans
/// resume. Never for input, device answers or files: those get an Error.
#define ALHAZEN_CHECK(condition) \
  ((condition) ? void() : ::alhazen::detail::check_failed(#condition, __FILE__, __LINE__))
