#include "reconstruct/decode/phase.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

namespace alhazen::decode {
namespace {

constexpr int kSteps = 5;

PhaseRule rule_of(float period_px) {
  PhaseRule rule;
  rule.period_px = period_px;
  rule.steps = kSteps;
  for (int k = 0; k < kSteps; ++k) {
    rule.cosines[k] = static_cast<float>(0.4 * std::cos(2 * std::numbers::pi * k / kSteps));
    rule.sines[k] = static_cast<float>(0.4 * std::sin(2 * std::numbers::pi * k / kSteps));
  }
  rule.min_modulation = 0.4F;
  rule.noise_px_dn = period_px / 20;
  return rule;
}

/// One tile and everything that a kernel may change of it.
template <class Dn>
struct Tile {
  std::array<std::array<Dn, kTile_px>, kSteps> frames;
  std::array<Dn, kTile_px> contrast;
  std::array<float, kTile_px> position;
  std::array<Imath::half, kTile_px> sigma;
  std::array<Label, kTile_px> label;

  void refine(const PhaseKernels& kernels, const PhaseRule& rule) {
    std::array<const Dn*, kSteps> steps;
    for (std::size_t k = 0; k < kSteps; ++k) steps[k] = frames[k].data();
    const PhaseOut out{position.data(), sigma.data(), label.data()};
    if constexpr (sizeof(Dn) == 1) {
      kernels.refine8(rule, steps, contrast.data(), out);
    } else {
      kernels.refine16(rule, steps, contrast.data(), out);
    }
  }
};

template <class Dn>
std::unique_ptr<Tile<Dn>> random_tile(unsigned seed) {
  auto tile = std::make_unique<Tile<Dn>>();
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> dn(0, std::numeric_limits<Dn>::max());
  std::uniform_real_distribution<float> position(-1, 2000), sigma(0.02F, 30);
  for (std::size_t i = 0; i < kTile_px; ++i) {
    for (auto& frame : tile->frames) frame[i] = static_cast<Dn>(dn(random));
    tile->contrast[i] = static_cast<Dn>(dn(random));
    tile->label[i] = static_cast<Label>(random() % 6);
    if (random() % 3 != 0) tile->label[i] = Label::mirror;
    const bool is_position = tile->label[i] == Label::mirror;
    tile->position[i] = is_position ? position(random) : std::nanf("");
    tile->sigma[i] =
        is_position ? Imath::half(sigma(random)) : std::numeric_limits<Imath::half>::quiet_NaN();
  }
  return tile;
}

template <class Dn>
void expect_same() {
  int changed = 0, mixed = 0;
  for (unsigned seed = 1; seed < 20; ++seed) {
    const auto before = random_tile<Dn>(seed);
    Tile<Dn> reference = *before, vector = *before;
    const PhaseRule rule = rule_of(seed % 2 == 0 ? 32 : 256);
    reference.refine(scalar_phase_kernels(), rule);
    vector.refine(vector_phase_kernels(), rule);
    for (std::size_t i = 0; i < kTile_px; ++i) {
      ASSERT_EQ(reference.label[i], vector.label[i]) << i;
      ASSERT_EQ(std::memcmp(&reference.position[i], &vector.position[i], sizeof(float)), 0)
          << reference.position[i] << " " << vector.position[i];
      ASSERT_EQ(reference.sigma[i].bits(), vector.sigma[i].bits())
          << reference.sigma[i] << " " << vector.sigma[i];
      changed += reference.sigma[i].bits() != before->sigma[i].bits() ? 1 : 0;
      mixed += reference.label[i] != before->label[i] ? 1 : 0;
    }
  }
  EXPECT_GT(changed, 1000);
  EXPECT_GT(mixed, 1000);
}

TEST(Phase, VectorsAgreeWithTheReferenceBitForBit) {
  const std::int64_t all = hwy::SupportedTargets();
  for (std::int64_t rest = all; rest != 0; rest &= rest - 1) {
    const std::int64_t target = rest & -rest;
    hwy::SetSupportedTargetsForTest(target);
    SCOPED_TRACE(hwy::TargetName(target));
    expect_same<std::uint8_t>();
    expect_same<std::uint16_t>();
  }
  hwy::SetSupportedTargetsForTest(0);
}

TEST(Phase, EveryAngleIsReadToAMillionthOfAPeriod) {
  // 16 bit frames of every direction; the old position is a quarter of a period off.
  auto tile = std::make_unique<Tile<std::uint16_t>>();
  const PhaseRule rule = rule_of(1024);
  for (std::size_t i = 0; i < kTile_px; ++i) {
    const double turns = static_cast<double>(i) / kTile_px;
    for (std::size_t k = 0; k < kSteps; ++k) {
      const double angle =
          2 * std::numbers::pi * (turns - static_cast<double>(k) / static_cast<double>(kSteps));
      tile->frames[k][i] = static_cast<std::uint16_t>(std::lround(32000 * (1 + std::cos(angle))));
    }
    tile->contrast[i] = 64000;
    tile->position[i] = static_cast<float>(1024 * (3 + turns + 0.02));
    tile->sigma[i] = Imath::half(300.0F);
    tile->label[i] = Label::mirror;
  }
  tile->refine(scalar_phase_kernels(), rule);
  for (std::size_t i = 0; i < kTile_px; ++i) {
    ASSERT_EQ(tile->label[i], Label::mirror);
    // Rounding to whole DN is worth 1e-5 rad, floats of 4096 px are 2.4e-4 px apart.
    ASSERT_NEAR(tile->position[i], 1024 * (3 + static_cast<double>(i) / kTile_px), 5e-3) << i;
  }
}

}  // namespace
}  // namespace alhazen::decode
