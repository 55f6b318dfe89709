#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "alhazen/image.h"

namespace alhazen {

/// What a camera pixel saw of one display. Values are part of the file format.
enum class Label : std::uint8_t {
  none = 0,          ///< nothing that decodes
  mirror = 1,        ///< the display, by reflection
  direct_sight = 2,  ///< the display itself: free space along the whole ray
  mixed = 3,         ///< several positions at once: silhouettes, display edges
  saturated = 4,
  second_bounce = 5,  ///< by more than one reflection
};

/// Which light map: one display seen by one camera at one stop of the turntable.
struct StackKey {
  int stop = 0;
  std::string display, camera;
  friend bool operator==(const StackKey&, const StackKey&) = default;
  friend auto operator<=>(const StackKey&, const StackKey&) = default;
};

/// Per camera pixel, the display position whose light arrives there.
///
/// Thread: reentrant. Immutable after decoding.
/// Shape:  every list is region.height × region.width, row-major.
/// Frames: u right, v down in display pixels, centres at integers; NaN where the label is not
/// mirror
///         or direct_sight.
/// Source: Gray code with inverse patterns, decoded per pixel to the finest resolvable bit
///         (Weinmann, Osep, Ruiters, Klein, ICCV 2013).
struct LightMap {
  StackKey key;
  double angle_rad = 0;  ///< measured angle of the turntable
  Region region;         ///< where in the camera's sensor the lists lie
  std::vector<float> u_px, v_px;
  std::vector<float> sigma_u_px, sigma_v_px;  ///< standard deviations of u and v
  std::vector<float> contrast;                ///< (white − black) / full scale, −1 … 1
  std::vector<Label> label;
  std::vector<std::uint8_t> bit_u, bit_v;  ///< finest Gray bit that was resolved, 0 = finest

  [[nodiscard]] std::size_t size_px() const noexcept {
    return static_cast<std::size_t>(region.width) * static_cast<std::size_t>(region.height);
  }
  [[nodiscard]] bool is_position(std::size_t pixel) const {
    return label[pixel] == Label::mirror || label[pixel] == Label::direct_sight;
  }
};

}  // namespace alhazen
