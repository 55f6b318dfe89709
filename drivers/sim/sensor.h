#pragma once

#include <cstddef>
#include <cstdint>

#include "drivers/sim/scene.h"

namespace alhazen::sim {

/// Light to digital numbers for one exposure: electrons = radiance · exposure / saturation_exposure
/// · full_well, with shot and read noise, cut at the full well; then gain, black level and
/// rounding. The noise is a function of the seed and the pixel alone, so a repeated exposure is
/// equal bit by bit. Reentrant.
class Sensor {
 public:
  Sensor(const SensorTruth& truth, Micros exposure, double gain_db, std::uint64_t seed);

  /// Digital numbers of `count` neighbouring pixels, the first being number `first_pixel` of the
  /// whole sensor. `out` holds one byte a pixel with 8 bits, else two.
  void read(const float* radiance, std::size_t count, std::uint32_t first_pixel,
            std::byte* out) const;

  struct Numbers {
    float electrons_per_radiance = 0, full_well_e = 0, read_variance_e2 = 0, shot = 0;
    float dn_per_electron = 0, black_dn = 0, white_dn = 0;
    std::uint32_t key_a = 0, key_b = 0;
  };

 private:
  Numbers numbers_;
  int bits_ = 8;
};

}  // namespace alhazen::sim
