#pragma once

#include <vector>

#include "alhazen/result.h"
#include "reconstruct/scan/light_map.h"
#include "reconstruct/scan/scan.h"

namespace alhazen {

/// A light map to look at, with the size of the display that it speaks of.
struct LightMapSample {
  LightMap map;  ///< cropped
  int display_width_px = 0, display_height_px = 0;
};

/// Of the first stop that has light maps, one for each display: that of the camera which saw most
/// of it in the mirror. Ordered as the displays; none of a display that was seen in no mirror.
/// Fails: as Scan::light_maps() and Scan::load_light_map().
[[nodiscard]] Result<std::vector<LightMapSample>> light_map_samples(const Scan& scan);

}  // namespace alhazen
