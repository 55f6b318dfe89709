#include "reconstruct/pattern/draw.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

TEST(Sequence, ShowsWhiteBlackThenEveryBitWithItsInverse) {
  for (const auto& [width, height] :
       {std::pair{2, 2}, {1280, 1024}, {1023, 1025}, {16384, 16383}}) {
    const std::vector<Pattern> sequence = *make_sequence(Coding::gray, width, height);
    ASSERT_EQ(sequence.size(),
              2 + 2 * static_cast<std::size_t>(gray_bits(width) + gray_bits(height)));
    EXPECT_EQ(sequence[0].kind, PatternKind::white);
    EXPECT_EQ(sequence[1].kind, PatternKind::black);
    for (std::size_t i = 2; i < sequence.size(); i += 2) {
      EXPECT_FALSE(sequence[i].inverted);
      Pattern inverse = sequence[i];
      inverse.inverted = true;
      EXPECT_EQ(sequence[i + 1], inverse);
    }
    EXPECT_EQ(sequence[2].bit, gray_bits(width) - 1);
    EXPECT_EQ(sequence.back().bit, 0);
  }
}

TEST(Sequence, RefusesWhatItCannotCode) {
  for (const auto& [width, height] : {std::pair{1, 5}, {5, 0}, {16385, 5}, {5, -3}}) {
    const auto sequence = make_sequence(Coding::gray, width, height);
    ASSERT_FALSE(sequence);
    EXPECT_EQ(sequence.error().code, Code::invalid);
    EXPECT_NE(sequence.error().what.find("[2, 16384]"), std::string::npos);
  }
}

TEST(Sequence, PhasesComeAfterCoarseBits) {
  const std::vector<Pattern> sequence = *make_sequence(Coding::gray_phase, 1920, 64);
  int phases = 0, lowest_u = 99, lowest_v = 99;
  std::set<std::pair<int, int>> shown;
  for (const Pattern& pattern : sequence) {
    if (pattern.kind == PatternKind::gray) {
      EXPECT_EQ(phases, 0) << "a bit after the phases";
      int& lowest = pattern.axis == Axis::u ? lowest_u : lowest_v;
      lowest = std::min(lowest, pattern.bit);
    }
    if (pattern.kind != PatternKind::phase) continue;
    ++phases;
    EXPECT_EQ(pattern.axis, Axis::u);  // 64 rows have no two cells of 64
    EXPECT_TRUE(shown.emplace(pattern.period_px, pattern.step).second);
  }
  EXPECT_EQ(lowest_u, kPhaseGrayBit);
  EXPECT_EQ(lowest_v, 0);
  EXPECT_EQ(shown.size(), kPhasePeriods_px.size() * kPhaseSteps);
}

/// The position that the pictures spell at one display pixel.
int read_position(const std::vector<Picture>& pictures, Axis axis, std::size_t pixel) {
  std::uint32_t gray = 0;
  for (const Picture& picture : pictures) {
    const Pattern& pattern = *picture.pattern;
    if (pattern.kind != PatternKind::gray || pattern.axis != axis || pattern.inverted) continue;
    if (picture.image.mono8()[pixel] == 255) gray |= 1U << pattern.bit;
  }
  return static_cast<int>(binary_from_gray(gray));
}

TEST(Draw, PicturesOfAnySizeSpellEveryPosition) {
  std::minstd_rand random(5);
  std::uniform_int_distribution<int> side(2, 70);
  for (int round = 0; round < 60; ++round) {
    // The first rounds are the extremes, one side at a time.
    const int width = round == 0 ? 16384 : round == 1 ? 2 : side(random);
    const int height = round == 0 ? 2 : round == 1 ? 16384 : side(random);
    std::vector<Picture> pictures;
    const std::vector<Pattern> sequence = *make_sequence(Coding::gray, width, height);
    for (const Pattern& pattern : sequence) {
      pictures.push_back(*draw(pattern, width, height));
      ASSERT_EQ(pictures.back().image.width(), width);
      ASSERT_EQ(pictures.back().image.height(), height);
    }
    std::size_t pixel = 0;
    for (int v = 0; v < height; ++v) {
      for (int u = 0; u < width; ++u, ++pixel) {
        ASSERT_EQ(read_position(pictures, Axis::u, pixel), u);
        ASSERT_EQ(read_position(pictures, Axis::v, pixel), v);
      }
    }
  }
}

TEST(Draw, InverseIsTheComplement) {
  for (const Axis axis : {Axis::u, Axis::v}) {
    const Pattern pattern{.kind = PatternKind::gray, .axis = axis, .bit = 2};
    Pattern inverse = pattern;
    inverse.inverted = true;
    const Picture one = *draw(pattern, 37, 21), other = *draw(inverse, 37, 21);
    for (std::size_t i = 0; i < one.image.size_px(); ++i) {
      ASSERT_EQ(one.image.mono8()[i] + other.image.mono8()[i], 255);
    }
  }
}

TEST(Draw, PhasesAreCosinesOfLinearLight) {
  for (const double gamma : {1.0, 2.2, 3.1}) {
    for (const Axis axis : {Axis::u, Axis::v}) {
      const Pattern pattern{
          .kind = PatternKind::phase, .axis = axis, .period_px = 24, .step = 1, .steps = 5};
      const Picture picture = *draw(pattern, 60, 50, gamma);
      for (int v = 0; v < 50; ++v) {
        for (int u = 0; u < 60; ++u) {
          const double wanted = 0.5 + 0.5 * std::cos(2 * std::numbers::pi *
                                                     ((axis == Axis::u ? u : v) / 24.0 - 1 / 5.0));
          const double value = picture.image.mono8()[static_cast<std::size_t>(v * 60 + u)] / 255.0;
          // Half a step of the panel's values.
          const double low = std::pow(std::max(0.0, value - 0.5 / 255), gamma),
                       high = std::pow(value + 0.5 / 255, gamma);
          ASSERT_GE(wanted, low - 1e-9);
          ASSERT_LE(wanted, high + 1e-9);
        }
      }
    }
  }
}

TEST(Draw, RefusesSizesAndBitsThatAreNotThere) {
  const Pattern bit_5{.kind = PatternKind::gray, .axis = Axis::v, .bit = 5};
  EXPECT_TRUE(draw(bit_5, 2, 33));
  const auto beyond = draw(bit_5, 64, 32);
  ASSERT_FALSE(beyond);
  EXPECT_EQ(beyond.error().text(),
            "invalid: bit 5 of axis v does not exist on 64 x 32 px; it must be in [0, 4]");
  EXPECT_EQ(draw({.kind = PatternKind::white}, 1, 2).error().code, Code::invalid);
  EXPECT_EQ(draw({.kind = PatternKind::white}, 2, 16385).error().code, Code::invalid);
  const Pattern phase{.kind = PatternKind::phase, .period_px = 16, .step = 2, .steps = 4};
  EXPECT_TRUE(draw(phase, 8, 8));
  const auto refused = [&](auto&& change, double gamma = 2.2) {
    Pattern wrong = phase;
    change(wrong);
    EXPECT_EQ(draw(wrong, 8, 8, gamma).error().code, Code::invalid);
  };
  refused([](Pattern& wrong) { wrong.period_px = 1; });
  refused([](Pattern& wrong) { wrong.steps = 2; });
  refused([](Pattern& wrong) { wrong.step = 4; });
  refused([](Pattern& wrong) { wrong.step = -1; });
  refused([](Pattern&) {}, 0.4);
  refused([](Pattern&) {}, std::nan(""));
}

}  // namespace
}  // namespace alhazen
