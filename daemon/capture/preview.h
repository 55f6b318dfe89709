#pragma once

#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "alhazen/clock.h"
#include "alhazen/image.h"
#include "alhazen/pattern.h"
#include "alhazen/result.h"
#include "daemon/devices/device_set.h"

namespace alhazen {

/// A single capture outside a scan.
struct PreviewRequest {
  std::vector<std::string> cameras;    ///< empty: all
  std::optional<std::string> display;  ///< shows `pattern`; without: all displays black
  Pattern pattern{PatternKind::white};
  std::optional<Micros> exposure;  ///< without: the camera's own of the configuration
  std::optional<double> gain_db;
};

struct PreviewFrame {
  std::string camera;
  Frame frame;
};

/// Shows, waits, triggers, collects; displays are black again afterwards. The whole sensor, no
/// retakes. Caller: rig lane. Fails: invalid (no such device, out of range), as the devices do.
[[nodiscard]] Result<std::vector<PreviewFrame>> take_preview(DeviceSet& devices, Clock& clock,
                                                             const PreviewRequest& request,
                                                             const std::stop_token& stop);

}  // namespace alhazen
