#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/image.h"
#include "drivers/sim/scene.h"

namespace alhazen::sim {

/// Extent of a patch along one axis of a display: widths of two boxes, in 1/32 px.
struct Extent {
  static constexpr float kUnitsPerPx = 32;  ///< so that 16 bits reach to 2047 px
  std::uint16_t wide = 0, narrow = 0;
};

/// A piece of a display that one camera pixel (or a part of it) sees: the pixel's square, carried
/// to the display by a map that is linear there, is a parallelogram. Its shadow on an axis is a
/// trapezoid, the convolution of two boxes.
struct Patch {
  std::uint32_t x = 0;  ///< camera pixel within the row of its region
  float weight = 0;     ///< radiance per radiance of the display
  float u = 0, v = 0;   ///< middle, display pixels
  Extent extent_u, extent_v;
};

/// Many patches, part by part, so that several are averaged at once.
struct Patches {
  std::vector<std::uint32_t> x;
  std::vector<float> weight, u, v;
  std::vector<Extent> extent_u, extent_v;

  void reserve(std::size_t count);
  void push_back(const Patch& patch);
  [[nodiscard]] std::size_t size() const noexcept { return x.size(); }
};

/// A picture on a display as linear light above that of a black panel (white: 1 − black), ready to
/// be averaged over patches. A picture that varies along one axis alone is kept as one line of it.
/// Immutable, thread-safe.
class Emission {
 public:
  /// A panel that shows one value everywhere: `radiance` above black.
  explicit Emission(double radiance, std::uint64_t hash = 0) : uniform_(radiance), hash_(hash) {}
  /// REQUIRES: the image has the display's size.
  Emission(const Image& image, const DisplayTruth& display);

  /// Adds weight · patch weight · mean over the patch to `row[x]`, for patches [begin, end). The
  /// mean along a line is over the wider box at the two Gauss points of the narrower one (exact to
  /// third order); in a picture that varies both ways, over a rectangle of the same variance.
  void add(const Patches& patches, std::size_t begin, std::size_t end, double weight,
           float* row) const;

  /// Of the picture's pixels: what makes the noise of two exposures differ.
  [[nodiscard]] std::uint64_t hash() const noexcept { return hash_; }

  /// Integral of the line up to a pixel's left edge, and the pixel's own value, both without the
  /// line's mean: so they stay small, and so do their rounding errors.
  struct Node {
    float integral = 0, value = 0;
  };

 private:
  enum class Varies : std::uint8_t { nowhere, along_u, along_v, everywhere };

  void prepare_line(const std::vector<float>& line);
  void prepare_area(const std::vector<float>& light);
  [[nodiscard]] double area_mean(double u, double v, Extent extent_u, Extent extent_v) const;

  Varies varies_ = Varies::nowhere;
  int width_px_ = 0, height_px_ = 0;
  double uniform_ = 0;        // nowhere: the value; along_*: the line's mean
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
