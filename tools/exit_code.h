#pragma once

#include "alhazen/result.h"

namespace alhazen {

/// What a tool's process ends with, after sysexits.h: what the caller can do about an error.
[[nodiscard]] constexpr int exit_code(Code code) noexcept {
  switch (code) {
    case Code::cancelled:
      return 130;
    case Code::timeout:
    case Code::corrupt:
    case Code::conflict:
      return 75;  // temporary
    case Code::unavailable:
      return 69;
    case Code::invalid:
    case Code::unsupported:
      return 64;  // usage
    case Code::exhausted:
      return 74;  // input, output
    case Code::internal:
      break;
  }
  return 70;
}

}  // namespace alhazen
