#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "daemon/plan/plan.h"

namespace alhazen {

/// What one camera's link has to carry while patterns run.
struct LinkLoad {
  std::string camera;
  double megabytes_per_s = 0;
};

/// What a plan will take (verb plan.estimate).
struct Estimate {
  std::uint64_t steps = 0, frames = 0, stacks = 0;
  double seconds = 0;              ///< devices only, without retakes; decoding keeps pace
  std::uint64_t bytes_disk = 0;    ///< light maps and the frames that are kept, uncompressed
  std::uint64_t bytes_memory = 0;  ///< capture's peak: running decoders and waiting frames
  std::vector<LinkLoad> links;     ///< in the plan's order of cameras
  std::vector<std::string> notes;  ///< what deserves a look before the scan
};

/// Pure. Uses what the devices say about themselves; a display's latency is not among it, two
/// refresh periods are assumed.
[[nodiscard]] Estimate estimate(const Manifest& plan, const DeviceFacts& devices);

}  // namespace alhazen
