#include "reconstruct/decode/kernels.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <bit>
#include <cstring>
#include <memory>
#include <random>
#include <vector>

namespace alhazen::decode {
namespace {

/// Everything that one set of kernels makes of a tile, as bytes.
struct alignas(kOutAlignment) Result {
  std::array<float, kTile_px> u, v, sigma_u, sigma_v, contrast;
  std::array<Label, kTile_px> label;
  std::array<std::uint8_t, kTile_px> bit_u, bit_v;
  std::array<std::uint16_t, kTile_px> difference, threshold;
  std::array<std::uint8_t, 100 * kPlaneBytes> planes;
};

struct Case {
  int bits_u, lowest_u, bits_v, lowest_v, full_scale;
};

template <class Dn>
std::unique_ptr<Result> run(const Kernels& kernels, const Case& c, unsigned seed) {
  auto result = std::make_unique<Result>();
  std::memset(result.get(), 0, sizeof(Result));
  std::minstd_rand random(seed);
  const auto frame = [&](int shift) {
    std::vector<Dn> list(kTile_px);
    // Differences of every size must come up, equal ones and both extremes too.
    for (Dn& dn : list) {
      const auto value = static_cast<int>(random() >> 8) % (c.full_scale + 1);
      dn = static_cast<Dn>(random() % 16 == 0 ? c.full_scale : value >> shift);
    }
    return list;
  };
  const ContrastRule rule = {.full_scale = static_cast<std::uint16_t>(c.full_scale),
                             .least = static_cast<std::uint16_t>(c.full_scale / 12),
                             .noise = static_cast<std::uint16_t>(c.full_scale / 85),
                             .modulation_q16 = 16384};
  const std::vector<Dn> white = frame(0), black = frame(2);
  auto* difference = reinterpret_cast<Dn*>(result->difference.data());
  auto* threshold = reinterpret_cast<Dn*>(result->threshold.data());
  FinalRule final;
  final.least = rule.least;
  final.coarsest = 256;
  final.per_dn = 1.0F / static_cast<float>(c.full_scale);
  final.noise_cells_dn = static_cast<float>(c.full_scale) / 200;
  final.u = {1, c.lowest_u, c.bits_u, static_cast<std::uint16_t>((1 << c.bits_u) - 2)};
  final.v = {1 + kPlanesPerBit * static_cast<std::size_t>(c.bits_u - c.lowest_u), c.lowest_v,
             c.bits_v, static_cast<std::uint16_t>((1 << c.bits_v) * 3 / 4)};
  const FinalOut out = {result->u.data(),       result->v.data(),        result->sigma_u.data(),
                        result->sigma_v.data(), result->contrast.data(), result->label.data(),
                        result->bit_u.data(),   result->bit_v.data()};
  const int pairs = c.bits_u - c.lowest_u + c.bits_v - c.lowest_v;
  for (int i = -1; i < pairs; ++i) {
    const std::vector<Dn> first = frame(0), second = frame((i + 3) % 3);
    std::uint8_t* plane =
        result->planes.data() + (1 + 3 * static_cast<std::size_t>(i < 0 ? 0 : i)) * kPlaneBytes;
    if constexpr (sizeof(Dn) == 1) {
      i < 0 ? kernels.contrast8(rule, white.data(), black.data(), kTile_px, difference, threshold,
                                result->planes.data())
            : kernels.pair8(first.data(), second.data(), threshold, kTile_px, plane);
    } else {
      i < 0 ? kernels.contrast16(rule, white.data(), black.data(), kTile_px, difference, threshold,
                                 result->planes.data())
            : kernels.pair16(first.data(), second.data(), threshold, kTile_px, plane);
    }
  }
  if constexpr (sizeof(Dn) == 1) {
    kernels.finish8(final, result->planes.data(), difference, out);
  } else {
    kernels.finish16(final, result->planes.data(), difference, out);
  }
  return result;
}

/// Runs a check on every instruction set that this processor has.
template <class Check>
void on_every_target(const Check& check) {
  const std::int64_t all = hwy::SupportedTargets();
  for (std::int64_t rest = all; rest != 0; rest &= rest - 1) {
    const std::int64_t target = rest & -rest;
    hwy::SetSupportedTargetsForTest(target);
    SCOPED_TRACE(hwy::TargetName(target));
    check();
  }
  hwy::SetSupportedTargetsForTest(0);
}

TEST(Kernels, VectorsAgreeWithTheReferenceBitForBit) {
  const Case cases[] = {{11, 0, 10, 0, 255},  {14, 0, 14, 0, 255},  {1, 0, 1, 0, 255},
                        {8, 0, 9, 0, 255},    {10, 3, 11, 9, 255},  {7, 2, 8, 7, 255},
                        {11, 0, 10, 0, 4095}, {14, 8, 14, 0, 4095}, {12, 0, 5, 0, 65535},
                        {11, 0, 10, 0, 1023}};
  on_every_target([&] {
    unsigned seed = 1;
    for (const Case& c : cases) {
      SCOPED_TRACE(c.bits_u);
      const bool is_8 = c.full_scale == 255;
      const auto reference = is_8 ? run<std::uint8_t>(scalar_kernels(), c, ++seed)
                                  : run<std::uint16_t>(scalar_kernels(), c, ++seed);
      const auto vector = is_8 ? run<std::uint8_t>(vector_kernels(), c, seed)
                               : run<std::uint16_t>(vector_kernels(), c, seed);
      ASSERT_EQ(
          std::memcmp(&reference->difference, &vector->difference, sizeof reference->difference),
          0);
      ASSERT_EQ(std::memcmp(&reference->threshold, &vector->threshold, sizeof reference->threshold),
                0);
      ASSERT_EQ(std::memcmp(&reference->planes, &vector->planes, sizeof reference->planes), 0);
      for (std::size_t i = 0; i < kTile_px; ++i) {
        ASSERT_EQ(reference->label[i], vector->label[i]) << i;
        ASSERT_EQ(reference->bit_u[i], vector->bit_u[i]) << i;
        ASSERT_EQ(reference->bit_v[i], vector->bit_v[i]) << i;
        for (const auto list :
             {&Result::u, &Result::v, &Result::sigma_u, &Result::sigma_v, &Result::contrast}) {
          ASSERT_EQ(std::bit_cast<std::uint32_t>((*reference.*list)[i]),
                    std::bit_cast<std::uint32_t>((*vector.*list)[i]))
              << i;
        }
      }
    }
  });
}

TEST(Kernels, RandomBitsComeToEveryLabel) {
  // A comparison of two kernels that both say "none" would prove little.
  std::array<int, 6> seen{};
  for (unsigned seed = 1; seed < 40; ++seed) {
    const auto result = run<std::uint8_t>(scalar_kernels(), {3, 0, 2, 0, 255}, seed);
    for (const Label label : result->label) ++seen[static_cast<std::size_t>(label)];
  }
  EXPECT_GT(seen[static_cast<std::size_t>(Label::none)], 1000);
  EXPECT_GT(seen[static_cast<std::size_t>(Label::mirror)], 1000);
  EXPECT_GT(seen[static_cast<std::size_t>(Label::mixed)], 1000);
  EXPECT_GT(seen[static_cast<std::size_t>(Label::saturated)], 1000);
}

}  // namespace
}  // namespace alhazen::decode
