#pragma once

#include "reconstruct/run.h"

namespace alhazen {

/// Nobody listens, nobody stops.
inline const Run kNobody{};

}  // namespace alhazen
