#pragma once

#include <cstdint>
#include <vector>

#include "alhazen/image.h"
#include "drivers/sim/scene.h"

namespace alhazen::sim {

/// A piece of a display that one camera pixel (or a part of it) sees: the pixel's square, carried
/// to the display by a map that is linear there, is a parallelogram. Its shadow on an axis is a
/// trapezoid, the convolution of two boxes of widths `wide` and `narrow`.
struct Patch {
  static constexpr float kUnitsPerPx = 32;  ///< of the widths below: up to 2047 px, to 1/32
  std::uint32_t x = 0;                      ///< camera pixel within the row of its region
  float weight = 0;                         ///< radiance per radiance of the display
  float u = 0, v = 0;                       ///< middle, display pixels
  std::uint16_t wide_u = 0, narrow_u = 0, wide_v = 0, narrow_v = 0;
};

/// A picture on a display as linear light (white 1), ready to be averaged exactly over patches.
/// A picture that varies along one axis alone is kept as one line of it. Immutable, thread-safe.
class Emission {
 public:
  /// A panel of the world that shows one value everywhere.
  explicit Emission(double radiance, std::uint64_t hash = 0) : uniform_(radiance), hash_(hash) {}
  /// REQUIRES: the image has the display's size.
  Emission(const Image& image, const DisplayTruth& display);

  /// Adds weight · mean over each patch to `row[patch.x]`.
  void add(const Patch* begin, const Patch* end, double weight, float* row) const;

  /// Of the picture's pixels: what makes the noise of two exposures differ.
  [[nodiscard]] std::uint64_t hash() const noexcept { return hash_; }

 private:
  enum class Varies : std::uint8_t { nowhere, along_u, along_v, everywhere };
  /// First and second integral of the line up to a pixel's left edge, and the pixel's own value.
  struct Node {
    double twice = 0, once = 0, value = 0;
  };

  void prepare_line(const std::vector<float>& line);
  void prepare_area(const std::vector<float>& light);
  [[nodiscard]] double line_mean(float centre, std::uint16_t wide, std::uint16_t narrow) const;
  [[nodiscard]] double area_mean(const Patch& patch) const;

  Varies varies_ = Varies::nowhere;
  int width_px_ = 0, height_px_ = 0;
  double uniform_ = 0;        // nowhere: the value; along_*: the line's mean, left out of line_
  std::vector<Node> line_;    // along_u, along_v
  std::vector<double> area_;  // everywhere: summed-area table, (width + 1) × (height + 1)
  std::uint64_t hash_ = 0;
};

/// Mixes `value` into `hash` so that every bit depends on both (finaliser of SplitMix64, Steele et
/// al. 2014).
[[nodiscard]] constexpr std::uint64_t mixed(std::uint64_t hash, std::uint64_t value) noexcept {
  std::uint64_t z = hash + 0x9E3779B97F4A7C15ULL + value;
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

}  // namespace alhazen::sim
