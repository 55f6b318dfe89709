#include "reconstruct/vote/clearance.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace alhazen {
namespace {

constexpr Region kBox{100, 40, 53, 37};

/// Mostly clear, in patches: what direct sight looks like.
std::vector<std::uint8_t> patches() {
  std::vector<std::uint8_t> is_clear(std::size_t{53} * 37, 1);
  std::mt19937 random(4);
  for (int hole = 0; hole < 6; ++hole) {
    const auto x = random() % 50, y = random() % 34;
    for (std::size_t i = 0; i < 9; ++i) is_clear[(y + i / 3) * 53 + x + i % 3] = 0;
  }
  return is_clear;
}

std::size_t pixel_of(int x, int y) {
  const int pixel = y * kBox.width + x;
  return static_cast<std::size_t>(pixel);
}

TEST(Clearance, IsThatOfBruteForce) {
  const std::vector<std::uint8_t> is_clear = patches();
  const Clearance clearance(kBox, is_clear);
  const auto clear_at = [&](int x, int y) {
    return x >= 0 && y >= 0 && x < kBox.width && y < kBox.height && is_clear[pixel_of(x, y)] != 0;
  };
  int most = 0;
  for (int y = 0; y < kBox.height; ++y) {
    for (int x = 0; x < kBox.width; ++x) {
      int far = 0;
      const auto is_ring_clear = [&] {
        for (int dy = -far; dy <= far; ++dy) {
          for (int dx = -far; dx <= far; ++dx)
            if (!clear_at(x + dx, y + dy)) return false;
        }
        return true;
      };
      while (is_ring_clear()) ++far;
      ASSERT_EQ(clearance.px[pixel_of(x, y)], far) << x << ' ' << y;
      most = std::max(most, far);
    }
  }
  EXPECT_GT(most, 5);
}

TEST(Clearance, HoldsBallsOnClearPixelsAlone) {
  const Clearance clearance(kBox, std::vector<std::uint8_t>(std::size_t{53} * 37, 1));
  // The middle is 19 pixels from what lies beyond.
  EXPECT_TRUE(clearance.holds(126, 58, 17));
  EXPECT_FALSE(clearance.holds(126, 58, 17.5F));
  EXPECT_FALSE(clearance.holds(99, 58, 0));
  EXPECT_FALSE(clearance.holds(std::nanf(""), 58, 0));
  EXPECT_FALSE(clearance.holds(126, 58, std::numeric_limits<float>::infinity()));
}

TEST(Clearance, MayHoldWhereverItHolds) {
  const Clearance clearance(kBox, patches());
  std::mt19937 random(9);
  std::uniform_real_distribution<float> x_px(90, 165), y_px(30, 90), size(0, 6), shift(-1, 1);
  int held = 0, spared = 0;
  for (int round = 0; round < 20'000; ++round) {
    const float x = x_px(random), y = y_px(random), reach = size(random), radius = size(random) / 2;
    const bool holds =
        clearance.holds(x + reach * shift(random), y + reach * shift(random), radius);
    // Half a pixel to the nearest one.
    const bool may_hold = clearance.may_hold(PixelRange::about(x, y, reach + 0.5), radius);
    ASSERT_TRUE(may_hold || !holds);
    held += holds ? 1 : 0;
    spared += may_hold ? 0 : 1;
  }
  EXPECT_GT(held, 1000);
  EXPECT_GT(spared, 1000);
}

TEST(Tiles, SayTheMostOfARectangle) {
  Tiles tiles({8, 4, 40, 20});
  EXPECT_EQ(tiles.most({0, 0, 100, 100}), 0);
  tiles.raise(39, 19, 7);
  tiles.raise(39, 19, 3);
  tiles.raise(0, 0, 2);
  EXPECT_EQ(tiles.most({0, 0, 100, 100}), 7);
  EXPECT_EQ(tiles.most({8, 4, 20, 12}), 2);
  EXPECT_EQ(tiles.most({0, 0, 7, 100}), 0);
  EXPECT_EQ(tiles.most({48, 0, 60, 100}), 0);
  EXPECT_EQ(Tiles().most({-1, -1, 1, 1}), 0);
}

TEST(PixelRange, HoldsThePixelsAboutAPoint) {
  const auto is = [](const PixelRange& range, int x0, int y0, int x1, int y1) {
    return range.x0 == x0 && range.y0 == y0 && range.x1 == x1 && range.y1 == y1;
  };
  EXPECT_TRUE(is(PixelRange::about(8.5, 20.25, 4), 4, 16, 12, 24));
  EXPECT_TRUE(is(PixelRange::about(1.5, 2, 3), -1, -1, 4, 5));
  EXPECT_EQ(PixelRange::about(-1e300, 0, 1).x1, -1);
  EXPECT_GT(PixelRange::about(1e300, 0, 1).x0, 65535);
  EXPECT_EQ(PixelRange::about(std::nan(""), 0, 1).x1, -1);
}

}  // namespace
}  // namespace alhazen
