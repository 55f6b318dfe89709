#pragma once

#include <span>
#include <string>
#include <vector>

#include "reconstruct/scan/scan.h"

namespace alhazen {

/// What a scan directory lacks or has twice, a sentence each, for people: light maps that are
/// missing (whole stops, displays and cameras are named as such), stops at one and the same angle,
/// and a rig.json that is not the one it was planned with. `present`: Scan::light_maps().
[[nodiscard]] std::vector<std::string> shortcomings(const Scan& scan,
                                                    std::span<const StackKey> present);

}  // namespace alhazen
