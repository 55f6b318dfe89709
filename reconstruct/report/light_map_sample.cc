#include "reconstruct/report/light_map_sample.h"

#include <algorithm>
#include <utility>

namespace alhazen {

Result<std::vector<LightMapSample>> light_map_samples(const Scan& scan) {
  const std::vector<StackKey> keys = ALHAZEN_TRY(scan.light_maps());
  std::vector<LightMapSample> samples;
  for (const PlannedDisplay& display : scan.manifest().displays) {
    LightMapSample best{{}, display.width_px, display.height_px};
    std::ptrdiff_t most = 0;
    for (const StackKey& key : keys) {
      if (key.stop != keys.front().stop || key.display != display.name) continue;
      const LightMap map = ALHAZEN_TRY(scan.load_light_map(key));
      const auto mirrors = std::count(map.label.begin(), map.label.end(), Label::mirror);
      if (mirrors <= most) continue;
      most = mirrors;
      best.map = cropped(map);
    }
    if (most > 0) samples.push_back(std::move(best));
  }
  return samples;
}

}  // namespace alhazen
