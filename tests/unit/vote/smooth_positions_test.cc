#include "reconstruct/vote/smooth_positions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <functional>
#include <random>
#include <utility>

namespace alhazen {
namespace {

constexpr int kWidth = 60, kHeight = 50;
constexpr float kJump_px = 100;

/// A mirror's map from pixels to the display about (x, y), curved along both and across.
double place(double x, double y) {
  return 300 + 17 * x - 6 * y + 0.11 * x * x - 0.07 * y * y + 0.05 * x * y;
}
constexpr double kSecondX = 0.22, kSecondY = -0.14;  // f'' along each axis

Positions make(const std::function<double(int, int)>& u) {
  Positions positions;
  positions.width = kWidth;
  positions.height = kHeight;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      positions.uv_px.push_back(static_cast<float>(u(x, y)));
      positions.uv_px.push_back(static_cast<float>(2 * x + 9 * y));
    }
  }
  positions.is_valid.assign(positions.uv_px.size() / 2, 1);
  positions.sigma_u_px = positions.sigma_v_px = 0.05F;
  return positions;
}

std::size_t index(int x, int y) {
  return static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x);
}

double bilinear(const Positions& positions, double x, double y) {
  const int i = static_cast<int>(x), j = static_cast<int>(y);
  const auto at = [&](int a, int b) {
    return static_cast<double>(positions.uv_px[2 * index(a, b)]);
  };
  const double fx = x - i, fy = y - j;
  return (1 - fy) * ((1 - fx) * at(i, j) + fx * at(i + 1, j)) +
         fy * ((1 - fx) * at(i, j + 1) + fx * at(i + 1, j + 1));
}

/// Mean error of looking up anywhere but near the rim.
double mean_error(const Positions& positions) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> x(4, kWidth - 5), y(4, kHeight - 5);
  double sum = 0;
  constexpr int kCount = 200'000;
  for (int i = 0; i < kCount; ++i) {
    const double at_x = x(random), at_y = y(random);
    sum += bilinear(positions, at_x, at_y) - place(at_x, at_y);
  }
  return sum / kCount;
}

TEST(SmoothPositions, TakesOffWhatPixelsAndLookUpAdd) {
  // A pixel says the mean over its square: f + f''/24 an axis.
  Positions positions = make([](int x, int y) { return place(x, y) + (kSecondX + kSecondY) / 24; });
  const double before = mean_error(positions);
  EXPECT_NEAR(before, (kSecondX + kSecondY) / 8, 1e-3);
  for (const bool is_coarse : {false, true}) {
    Positions corrected = positions;
    corrected.sigma_u_px = is_coarse ? 2 : 0.05F;
    smooth_positions(corrected, kJump_px, kJump_px);
    EXPECT_LT(std::abs(mean_error(corrected)), 0.05 * std::abs(before)) << is_coarse;
  }
}

TEST(SmoothPositions, ReplacesAWrongPositionByItsNeighboursOwn) {
  Positions positions = make(place), clean = positions;
  positions.uv_px[2 * index(20, 20)] = 1500;
  positions.uv_px[2 * index(40, 31) + 1] = -700;
  smooth_positions(positions, kJump_px, kJump_px);
  smooth_positions(clean, kJump_px, kJump_px);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      ASSERT_EQ(positions.is_valid[index(x, y)], 1);
      ASSERT_NEAR(positions.uv_px[2 * index(x, y)], clean.uv_px[2 * index(x, y)], 2e-3);
      ASSERT_NEAR(positions.uv_px[2 * index(x, y) + 1], clean.uv_px[2 * index(x, y) + 1], 2e-3);
    }
  }
}

TEST(SmoothPositions, DropsWrongNeighbours) {
  Positions positions = make(place);
  positions.uv_px[2 * index(20, 20)] = 1500;
  positions.uv_px[2 * index(21, 20)] = 40;
  smooth_positions(positions, kJump_px, kJump_px);
  EXPECT_EQ(positions.is_valid[index(20, 20)], 0);
  EXPECT_EQ(positions.is_valid[index(21, 20)], 0);
  EXPECT_EQ(positions.is_valid[index(23, 20)], 1);
  EXPECT_NEAR(positions.uv_px[2 * index(24, 20)], place(24, 20), 0.2);
}

TEST(SmoothPositions, KeepsToOneSideOfATear) {
  // Two parts of an object, side by side.
  const auto torn = [](int x, int y) { return place(x, y) + (x >= 30 ? 5000 : 0); };
  Positions positions = make(torn);
  smooth_positions(positions, kJump_px, kJump_px);
  for (int y = 2; y < kHeight - 2; ++y) {
    for (int x = 2; x < kWidth - 2; ++x) {
      ASSERT_NEAR(positions.uv_px[2 * index(x, y)], torn(x, y), 0.1) << x << " " << y;
    }
  }
}

TEST(SmoothPositions, ShrinksErrorsOfCoarseCodesMore) {
  std::mt19937 random(5);
  for (const float sigma_px : {0.1F, 2.0F}) {
    std::normal_distribution<double> noise(0, sigma_px);
    Positions positions = make([&](int x, int y) { return place(x, y) + noise(random); });
    Positions clean = make(place);
    positions.sigma_u_px = clean.sigma_u_px = sigma_px;
    smooth_positions(positions, kJump_px, kJump_px);
    smooth_positions(clean, kJump_px, kJump_px);
    double squares = 0;
    int count = 0;
    for (int y = 3; y < kHeight - 3; ++y) {
      for (int x = 3; x < kWidth - 3; ++x, ++count) {
        squares += std::pow(static_cast<double>(positions.uv_px[2 * index(x, y)]) -
                                static_cast<double>(clean.uv_px[2 * index(x, y)]),
                            2);
      }
    }
    // The middle of a least-squares quadratic over 5 x 5 pixels keeps sqrt(27/175) = 0.39 of the
    // error, over 3 x 3 sqrt(5/9) = 0.75; what takes the bias off adds to both.
    EXPECT_LT(std::sqrt(squares / count), (sigma_px > 1 ? 0.5 : 1.0) * sigma_px);
    EXPECT_GT(std::sqrt(squares / count), (sigma_px > 1 ? 0.39 : 0.75) * sigma_px);
  }
}

}  // namespace
}  // namespace alhazen
