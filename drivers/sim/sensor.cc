#include "drivers/sim/sensor.h"

#include <cmath>

#include "drivers/sim/emission.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "drivers/sim/sensor.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace alhazen::sim {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

/// Noise of mean 0 and variance 1 from the pixel's number: the sum of eight random bytes is normal
/// to 3 parts in 1000 of its distribution function, and reaches 4 standard deviations and more.
/// Bits: two rounds of the finaliser of MurmurHash3 (A. Appleby, public domain) over number and
/// key.
template <class D, class V>
auto noise(D floats, V pixel, const Sensor::Numbers& numbers) {
  const hn::RebindToUnsigned<D> words;
  const auto round = [&](V x, std::uint32_t multiplier_a, std::uint32_t multiplier_b) {
    x = hn::Xor(x, hn::ShiftRight<16>(x));
    x = hn::Mul(x, hn::Set(words, multiplier_a));
    x = hn::Xor(x, hn::ShiftRight<13>(x));
    x = hn::Mul(x, hn::Set(words, multiplier_b));
    return hn::Xor(x, hn::ShiftRight<16>(x));
  };
  const auto byte_sum = [&](V x) {
    const auto low = hn::Set(words, 0x00FF00FFU);
    const auto pairs = hn::Add(hn::And(x, low), hn::And(hn::ShiftRight<8>(x), low));
    return hn::Add(hn::And(pairs, hn::Set(words, 0xFFFFU)), hn::ShiftRight<16>(pairs));
  };
  const V a = round(hn::Xor(pixel, hn::Set(words, numbers.key_a)), 0x85EBCA6BU, 0xC2B2AE35U);
  const V b = round(hn::Add(a, hn::Set(words, numbers.key_b)), 0x7FEB352DU, 0x846CA68BU);
  const hn::RebindToSigned<D> whole;
  const auto sum = hn::ConvertTo(floats, hn::BitCast(whole, hn::Add(byte_sum(a), byte_sum(b))));
  constexpr float kMean = 8 * 127.5F;
  constexpr float kDeviation = 209.0215F;  // sqrt(8 · (256² − 1) / 12)
  return hn::Mul(hn::Sub(sum, hn::Set(floats, kMean)), hn::Set(floats, 1 / kDeviation));
}

/// Digital numbers as 32-bit words.
template <class D, class V>
auto convert(D floats, V radiance, hn::VFromD<hn::RebindToUnsigned<D>> pixel,
             const Sensor::Numbers& n) {
  const auto zero = hn::Zero(floats);
  const auto light = hn::Mul(hn::Max(radiance, zero), hn::Set(floats, n.electrons_per_radiance));
  const auto variance =
      hn::Add(hn::Mul(light, hn::Set(floats, n.shot)), hn::Set(floats, n.read_variance_e2));
  const auto held = hn::Min(hn::Add(light, hn::Mul(hn::Sqrt(variance), noise(floats, pixel, n))),
                            hn::Set(floats, n.full_well_e));
  const auto dn =
      hn::Add(hn::Mul(held, hn::Set(floats, n.dn_per_electron)), hn::Set(floats, n.black_dn));
  return hn::NearestInt(hn::Min(hn::Max(dn, zero), hn::Set(floats, n.white_dn)));
}

template <class Pixel>
void read_row(const float* HWY_RESTRICT radiance, std::size_t count, std::uint32_t first_pixel,
              const Sensor::Numbers& numbers, Pixel* HWY_RESTRICT out) {
  const hn::ScalableTag<float> floats;
  const hn::RebindToUnsigned<decltype(floats)> words;
  const hn::Rebind<Pixel, decltype(floats)> pixels;
  const std::size_t lanes = hn::Lanes(floats);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const auto pixel = hn::Iota(words, first_pixel + static_cast<std::uint32_t>(i));
    hn::StoreU(
        hn::DemoteTo(pixels, convert(floats, hn::LoadU(floats, radiance + i), pixel, numbers)),
        pixels, out + i);
  }
  const hn::CappedTag<float, 1> one;
  const hn::RebindToUnsigned<decltype(one)> one_word;
  const hn::Rebind<Pixel, decltype(one)> one_pixel;
  for (; i < count; ++i) {
    const auto pixel = hn::Set(one_word, first_pixel + static_cast<std::uint32_t>(i));
    hn::StoreU(hn::DemoteTo(one_pixel, convert(one, hn::LoadU(one, radiance + i), pixel, numbers)),
               one_pixel, out + i);
  }
}

void read_row8(const float* radiance, std::size_t count, std::uint32_t first_pixel,
               const Sensor::Numbers& numbers, std::uint8_t* out) {
  read_row(radiance, count, first_pixel, numbers, out);
}
void read_row16(const float* radiance, std::size_t count, std::uint32_t first_pixel,
                const Sensor::Numbers& numbers, std::uint16_t* out) {
  read_row(radiance, count, first_pixel, numbers, out);
}

}  // namespace HWY_NAMESPACE
}  // namespace alhazen::sim
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace alhazen::sim {

HWY_EXPORT(read_row8);
HWY_EXPORT(read_row16);

Sensor::Sensor(const SensorTruth& truth, Micros exposure, double gain_db, std::uint64_t seed)
    : bits_(truth.bits) {
  const double white = static_cast<double>((1 << truth.bits) - 1),
               black = truth.black_level_share * white;
  numbers_.electrons_per_radiance =
      static_cast<float>(truth.full_well_e * static_cast<double>(exposure.count()) /
                         static_cast<double>(truth.saturation_exposure.count()));
  numbers_.full_well_e = static_cast<float>(truth.full_well_e);
  numbers_.read_variance_e2 = static_cast<float>(truth.read_noise_e * truth.read_noise_e);
  numbers_.shot = truth.shot_noise ? 1.0F : 0.0F;
  numbers_.dn_per_electron =
      static_cast<float>(std::pow(10.0, gain_db / 20) * (white - black) / truth.full_well_e);
  numbers_.black_dn = static_cast<float>(black);
  numbers_.white_dn = static_cast<float>(white);
  const std::uint64_t key = mixed(seed, 0x5E5);
  numbers_.key_a = static_cast<std::uint32_t>(key);
  numbers_.key_b = static_cast<std::uint32_t>(key >> 32);
}

void Sensor::read(const float* radiance, std::size_t count, std::uint32_t first_pixel,
                  std::byte* out) const {
  if (bits_ == 8) HWY_DYNAMIC_DISPATCH(read_row8)
  (radiance, count, first_pixel, numbers_, reinterpret_cast<std::uint8_t*>(out));
  else HWY_DYNAMIC_DISPATCH(read_row16)(radiance, count, first_pixel, numbers_,
                                        reinterpret_cast<std::uint16_t*>(out));
}

}  // namespace alhazen::sim
#endif  // HWY_ONCE
