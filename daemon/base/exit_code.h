#pragma once

#include "alhazen/result.h"

namespace alhazen {

/// What a program ends with on such an error: what its caller can do about it (sysexits.h; 130 as
/// after Ctrl-C).
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
