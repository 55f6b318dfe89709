#include "drivers/sim/sensor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <vector>

namespace alhazen::sim {
namespace {

SensorTruth truth(int bits) {
  SensorTruth out;
  out.bits = bits;
  out.full_well_e = 10000;
  out.read_noise_e = 20;
  out.black_level_share = 0.1;
  out.saturation_exposure = Micros(10000);
  return out;
}

struct Moments {
  double mean = 0, variance = 0;
};

Moments read(const SensorTruth& sensor, double radiance, Micros exposure, double gain_db) {
  constexpr std::size_t kPixels = 200'000;
  const std::vector<float> light(kPixels, static_cast<float>(radiance));
  std::vector<std::byte> bytes(2 * kPixels);
  Sensor(sensor, exposure, gain_db, 42).read(light.data(), kPixels, 0, bytes.data());
  Moments out;
  for (int pass = 0; pass < 2; ++pass)
    for (std::size_t i = 0; i < kPixels; ++i) {
      std::uint16_t word = static_cast<std::uint8_t>(bytes[i]);
      if (sensor.bits > 8) std::memcpy(&word, &bytes[2 * i], 2);
      if (pass == 0)
        out.mean += word / static_cast<double>(kPixels);
      else
        out.variance += (word - out.mean) * (word - out.mean) / static_cast<double>(kPixels);
    }
  return out;
}

TEST(Sensor, RecordsLightWithShotAndReadNoise) {
  for (const int bits : {8, 12, 16}) {
    const double white = (1 << bits) - 1, per_electron = 0.9 * white / 10000;
    const Moments dark = read(truth(bits), 0, Micros(5000), 0);
    EXPECT_NEAR(dark.mean, 0.1 * white, 0.02 + 1e-4 * white) << bits;
    EXPECT_NEAR(dark.variance, 400 * per_electron * per_electron + 1.0 / 12,
                0.02 * dark.variance + 0.01)
        << bits;
    const Moments half = read(truth(bits), 0.8, Micros(5000), 0);  // 4000 electrons
    EXPECT_NEAR(half.mean, 0.1 * white + 4000 * per_electron, 0.02 + 1e-4 * white) << bits;
    EXPECT_NEAR(half.variance, 4400 * per_electron * per_electron + 1.0 / 12,
                0.02 * half.variance + 0.01)
        << bits;
    const Moments quiet = read(
        [&] {
          auto s = truth(bits);
          s.shot_noise = false;
          s.read_noise_e = 0;
          return s;
        }(),
        0.8, Micros(5000), 0);
    EXPECT_NEAR(quiet.variance, 0, 1e-12);
    EXPECT_NEAR(quiet.mean, 0.1 * white + 4000 * per_electron, 0.51);
  }
}

TEST(Sensor, SaturatesAndAmplifies) {
  EXPECT_NEAR(read(truth(8), 3, Micros(10000), 0).mean, 255, 1e-6);
  EXPECT_NEAR(read(truth(12), 0.5, Micros(10000), 12).mean, 4095, 1e-6);
  const double plain = read(truth(16), 0.1, Micros(10000), 0).mean - 6553.5,
               gained = read(truth(16), 0.1, Micros(10000), 6).mean - 6553.5;
  EXPECT_NEAR(gained / plain, std::pow(10, 0.3), 0.01);
}

TEST(Sensor, NoiseIsAFunctionOfSeedAndPixelAlone) {
  const std::vector<float> light(1000, 0.5F);
  std::vector<std::byte> whole(1000), part(1000), other(1000);
  const Sensor sensor(truth(8), Micros(5000), 0, 7);
  sensor.read(light.data(), 1000, 0, whole.data());
  // In pieces of any length, as rows of a region cut them.
  for (std::size_t first = 0, length = 1; first < 1000;
       first += length, length = 1 + (length * 7) % 53) {
    const std::size_t count = std::min(length, 1000 - first);
    sensor.read(light.data() + first, count, static_cast<std::uint32_t>(first),
                part.data() + first);
  }
  EXPECT_EQ(whole, part);
  Sensor(truth(8), Micros(5000), 0, 8).read(light.data(), 1000, 0, other.data());
  EXPECT_NE(whole, other);
}

TEST(Sensor, NoiseOfNeighboursAndOfFramesIsIndependent) {
  constexpr std::size_t kPixels = 100'000;
  const std::vector<float> light(kPixels, 0.5F);
  std::vector<std::uint16_t> a(kPixels), b(kPixels);
  Sensor(truth(16), Micros(5000), 0, 1)
      .read(light.data(), kPixels, 0, reinterpret_cast<std::byte*>(a.data()));
  Sensor(truth(16), Micros(5000), 0, 2)
      .read(light.data(), kPixels, 0, reinterpret_cast<std::byte*>(b.data()));
  const double mean = 0.1 * 65535 + 0.25 * 0.9 * 65535;
  double variance = 0, beside = 0, between = 0, fourth = 0;
  for (std::size_t i = 0; i + 1 < kPixels; ++i) {
    const double x = a[i] - mean;
    variance += x * x;
    fourth += x * x * x * x;
    beside += x * (a[i + 1] - mean);
    between += x * (b[i] - mean);
  }
  EXPECT_LT(std::abs(beside / variance), 0.015);  // 4.7 standard deviations of the estimate
  EXPECT_LT(std::abs(between / variance), 0.015);
  EXPECT_NEAR(fourth * kPixels / variance / variance, 3,
              0.25);  // a normal distribution's; eight bytes give 2.85
}

}  // namespace
}  // namespace alhazen::sim
