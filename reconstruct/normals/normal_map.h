#pragma once

#include <Eigen/Core>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "alhazen/image.h"
#include "alhazen/result.h"
#include "reconstruct/scan/region.h"

namespace alhazen {

/// What a pixel of a normal map knows.
enum class NormalLabel : std::uint8_t {
  background = 0,  ///< looks past the object: free space along the whole ray
  object = 1,      ///< sees the object, with this normal
  unknown = 2,     ///< neither is sure: no vote, no free space
};

/// Which normal map: one camera at one stop of the turntable.
struct NormalMapKey {
  int stop = 0;
  std::string camera;
  friend bool operator==(const NormalMapKey&, const NormalMapKey&) = default;
  friend auto operator<=>(const NormalMapKey&, const NormalMapKey&) = default;
};

/// Per camera pixel the outward normal of the surface seen there, whatever found it: photometric
/// stereo, a renderer, another scanner.
///
/// Thread: reentrant. Immutable after reading.
/// Shape:  every list is region.height × region.width, row-major.
/// Frames: camera frame (OpenCV's: x right, y down, z forward), so a visible normal has z < 0 on
///         the optical axis.
struct NormalMap {
  NormalMapKey key;
  double angle_rad = 0;                 ///< of the turntable
  Region region;                        ///< where in the camera's sensor the lists lie
  std::vector<Eigen::Vector3f> normal;  ///< unit where the label is object, else zero
  std::vector<NormalLabel> label;
  /// Standard deviation of each of a normal's two components: what its source is known to err by,
  /// at least the rounding of the file it came from. Range [0, 1].
  double noise_rad = 0;

  [[nodiscard]] std::size_t size_px() const noexcept { return pixel_count(region); }
};

}  // namespace alhazen
