#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/image.h"
#include "drivers/sim/emission.h"
#include "drivers/sim/rigid.h"
#include "drivers/sim/scene.h"
#include "drivers/sim/shape.h"

namespace alhazen::sim {

/// How light travels to one camera while object and displays stand still: which patches of which
/// display each pixel sees, and how bright. Pictures are evaluated from it without tracing again.
/// Immutable once traced.
struct Transport {
  struct Light {
    Patches patches;                   ///< row by row
    std::vector<std::uint32_t> begin;  ///< first patch of each row, and the end
  };
  Region region;
  std::vector<Light> lights;  ///< per display of the scene
  /// Radiance with all panels black: ambient light and what black panels let through, row-major.
  std::vector<float> dark;
  std::uint64_t ray_count = 0;     ///< sight lines that were followed, each bounce one
  std::uint64_t uneven_count = 0;  ///< pixels that needed sub-pixel samples

  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// Follows camera sight lines over the mirror to the displays.
///
/// Every pixel's corners are followed (shared with its neighbours). Where none meets a display, the
/// pixel is dark. An even pixel (its corners and its middle end on one display after the same
/// bounces, and the map between is linear to kEvenShare) becomes one patch. Any other pixel is
/// sampled samples_across² times, evenly spread. Scene and shape must outlive it. Thread-safe.
class Renderer {
 public:
  Renderer(const Scene& scene, const Shape& shape) : scene_(scene), shape_(shape) {}

  /// `rig_from_object` is how the turntable holds the object (and displays fixed to it). Uses all
  /// cores; the answer does not depend on how many.
  /// REQUIRES: `region` lies within the camera's picture.
  [[nodiscard]] Transport trace(const CameraTruth& camera, const Rigid& rig_from_object,
                                const Region& region) const;

  /// Largest deviation from a linear map, as a share of the patch, that counts as even.
  static constexpr double kEvenShare = 0.2;

 private:
  const Scene& scene_;
  const Shape& shape_;
};

}  // namespace alhazen::sim
