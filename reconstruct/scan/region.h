#pragma once

#include <cstddef>

#include "alhazen/image.h"

namespace alhazen {

/// How many pixels a box of pixels holds.
[[nodiscard]] inline std::size_t pixel_count(const Region& box) {
  return static_cast<std::size_t>(box.width) * static_cast<std::size_t>(box.height);
}

}  // namespace alhazen
