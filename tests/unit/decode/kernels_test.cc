#include "reconstruct/decode/kernels.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <memory>
#include <random>
#include <span>
#include <vector>

namespace alhazen::decode {
namespace {

constexpr std::size_t kTiles = 9, kPixels = kTiles * kTile_px, kTileBytes = 100 * kPlaneBytes;

/// Everything that one set of kernels makes of some tiles, as bytes.
struct alignas(kOutAlignment) Result {
  std::array<float, kPixels> u, v;
  std::array<Imath::half, kPixels> sigma_u, sigma_v;
  std::array<Label, kPixels> label;
  std::array<std::uint8_t, kPixels> contrast, bit_u, bit_v;
  alignas(kOutAlignment) std::array<std::uint16_t, kPixels> difference;
  alignas(kOutAlignment) std::array<std::uint8_t, kTiles * kTileBytes> planes;
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
    std::vector<Dn> list(kPixels);
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
  FinalRule final;
  final.coarsest = 256;
  final.to_255 = 255.0F / static_cast<float>(c.full_scale);
  final.noise_square = static_cast<float>(c.full_scale) * static_cast<float>(c.full_scale) / 40'000;
  final.u = {2, c.lowest_u, c.bits_u, static_cast<std::uint16_t>((1 << c.bits_u) - 2)};
  final.v = {2 + kPlanesPerBit * static_cast<std::size_t>(c.bits_u - c.lowest_u), c.lowest_v,
             c.bits_v, static_cast<std::uint16_t>((1 << c.bits_v) * 3 / 4)};
  const int bits = c.bits_u - c.lowest_u + c.bits_v - c.lowest_v;
  std::vector<std::vector<Dn>> frames;
  std::vector<FramePair<Dn>> pairs;
  for (int i = 0; i < bits; ++i) {
    frames.push_back(frame(0));
    frames.push_back(frame((i + 3) % 3));
    pairs.push_back({frames[frames.size() - 2].data(), frames.back().data(),
                     result->planes.data() + (2 + 3 * static_cast<std::size_t>(i)) * kPlaneBytes});
  }
  const auto run_all = [&](const auto& contrast, const auto& fold, const auto& finish) {
    contrast(rule, white.data(), black.data(), kTiles, kTileBytes, difference,
             result->planes.data());
    std::span<const FramePair<Dn>> rest(pairs);
    for (std::size_t count = 1; !rest.empty(); count = count % kMaxPairsAtOnce + 1) {
      const std::size_t some = std::min(count, rest.size());
      fold(rule, difference, rest.first(some), kTiles, kTileBytes);
      rest = rest.subspan(some);
    }
    for (std::size_t tile = 0; tile < kTiles; ++tile) {
      const std::size_t i = tile * kTile_px;
      finish(
          final, result->planes.data() + tile * kTileBytes, difference + i,
          FinalOut{&result->u[i], &result->v[i], &result->sigma_u[i], &result->sigma_v[i],
                   &result->contrast[i], &result->label[i], &result->bit_u[i], &result->bit_v[i]});
    }
  };
  if constexpr (sizeof(Dn) == 1) {
    run_all(kernels.contrast8, kernels.pairs8, kernels.finish8);
  } else {
    run_all(kernels.contrast16, kernels.pairs16, kernels.finish16);
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
      ASSERT_EQ(std::memcmp(&reference->planes, &vector->planes, sizeof reference->planes), 0);
      for (std::size_t i = 0; i < kPixels; ++i) {
        ASSERT_EQ(reference->label[i], vector->label[i]) << i;
        ASSERT_EQ(reference->bit_u[i], vector->bit_u[i]) << i;
        ASSERT_EQ(reference->bit_v[i], vector->bit_v[i]) << i;
        ASSERT_EQ(reference->contrast[i], vector->contrast[i]) << i;
        for (const auto list : {&Result::u, &Result::v}) {
          ASSERT_EQ(std::bit_cast<std::uint32_t>((*reference.*list)[i]),
                    std::bit_cast<std::uint32_t>((*vector.*list)[i]))
              << i;
        }
        for (const auto list : {&Result::sigma_u, &Result::sigma_v}) {
          ASSERT_EQ((*reference.*list)[i].bits(), (*vector.*list)[i].bits()) << i;
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
