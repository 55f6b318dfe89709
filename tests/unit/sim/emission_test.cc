#include "drivers/sim/emission.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

namespace alhazen::sim {
namespace {

DisplayTruth panel(int width, int height, double gamma = 1, double black = 0) {
  DisplayTruth out;
  out.width_px = width;
  out.height_px = height;
  out.gamma = gamma;
  out.black_share = black;
  return out;
}

Image picture(int width, int height, const std::function<int(int, int)>& value) {
  std::vector<std::uint8_t> pixels;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) pixels.push_back(static_cast<std::uint8_t>(value(x, y)));
  return Image::copy<std::uint8_t>(width, height, 8, pixels);
}

Patch patch(double u, double v, double wide_u, double narrow_u, double wide_v, double narrow_v) {
  const auto units = [](double px) { return static_cast<std::uint16_t>(std::lround(px * 32)); };
  return {0,
          1,
          static_cast<float>(u),
          static_cast<float>(v),
          {units(wide_u), units(narrow_u)},
          {units(wide_v), units(narrow_v)}};
}

double mean(const Emission& emission, const Patch& one) {
  Patches patches;
  patches.push_back(one);
  float row = 0;
  emission.add(patches, 0, 1, 1, &row);
  return static_cast<double>(row);
}

/// Mean of a picture's pixels over box a convolved with box b along each axis, by brute force.
double brute(const Image& image, const Patch& one) {
  constexpr int kSteps = 24;
  double sum = 0;
  const auto at = [&](double along, double across, Extent extent, double middle) {
    return middle + (along * extent.wide + across * extent.narrow) / 32.0;
  };
  for (int a = 0; a < kSteps; ++a)
    for (int b = 0; b < kSteps; ++b)
      for (int c = 0; c < kSteps; ++c)
        for (int d = 0; d < kSteps; ++d) {
          const auto share = [](int i) { return (i + 0.5) / kSteps - 0.5; };
          const double u = at(share(a), share(b), one.extent_u, static_cast<double>(one.u)),
                       v = at(share(c), share(d), one.extent_v, static_cast<double>(one.v));
          const int x = static_cast<int>(std::floor(u + 0.5)),
                    y = static_cast<int>(std::floor(v + 0.5));
          sum +=
              image.mono8()[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width()) +
                            static_cast<std::size_t>(x)] /
              255.0;
        }
  return sum / std::pow(kSteps, 4);
}

TEST(Emission, AveragesAnyPictureOverAPatch) {
  const int width = 64, height = 48;
  const std::function<int(int, int)> pictures[] = {
      [](int x, int) { return (x / 5) % 2 == 0 ? 255 : 0; },
      [](int, int y) { return (y * 37) % 256; },
      [](int x, int y) { return (x * 7 + y * 13) % 256; }, [](int, int) { return 200; }};
  for (const auto& value : pictures) {
    const Image image = picture(width, height, value);
    const Emission emission(image, panel(width, height));
    for (const Patch& one : {patch(30.2, 20.7, 16, 5, 9, 2), patch(22.0, 23.5, 7, 7, 12, 0),
                             patch(40.4, 17.1, 3, 1, 4, 4)})
      // Two Gauss points stand for the narrower box; a rectangle for the trapezoids of an area.
      EXPECT_NEAR(mean(emission, one), brute(image, one), 0.05);
  }
}

TEST(Emission, IsExactWhereNoEdgeIsNear) {
  const Image image = picture(200, 10, [](int x, int) { return x < 100 ? 0 : 255; });
  const Emission emission(image, panel(200, 10));
  EXPECT_NEAR(mean(emission, patch(50, 5, 20, 10, 1, 1)), 0, 1e-5);
  EXPECT_NEAR(mean(emission, patch(150, 5, 20, 10, 1, 1)), 1, 1e-5);
  // The edge lies between pixels 99 and 100.
  EXPECT_NEAR(mean(emission, patch(99.5, 5, 20, 10, 1, 1)), 0.5, 1e-5);
  EXPECT_NEAR(mean(emission, patch(97.5, 5, 20, 0, 1, 1)), 0.4, 1e-5);
}

TEST(Emission, ObeysGammaAndBlack) {
  const Emission emission(picture(8, 8, [](int, int) { return 128; }), panel(8, 8, 2.2, 0.01));
  EXPECT_NEAR(mean(emission, patch(4, 4, 1, 1, 1, 1)), 0.99 * std::pow(128 / 255.0, 2.2), 1e-6);
  const Emission black(picture(8, 8, [](int, int) { return 0; }), panel(8, 8, 2.2, 0.01));
  EXPECT_EQ(mean(black, patch(4, 4, 1, 1, 1, 1)), 0);
}

TEST(Emission, ManyPatchesAtOnceGiveWhatEachGives) {
  const Image image = picture(512, 4, [](int x, int) { return (x / 8) % 2 == 0 ? 255 : 0; });
  const Emission emission(image, panel(512, 4));
  Patches patches;
  std::vector<float> row(700, 0), one_by_one(700, 0);
  for (std::uint32_t i = 0; i < 700; ++i) {
    Patch one = patch(2 + 0.7 * i, 1, 0.5 + 0.05 * (i % 300), 0.01 * (i % 40), 1, 1);
    one.x = i;
    one.weight = 0.5F;
    patches.push_back(one);
  }
  emission.add(patches, 0, 700, 2, row.data());
  for (std::size_t i = 0; i < 700; ++i) emission.add(patches, i, i + 1, 2, one_by_one.data());
  for (std::size_t i = 0; i < 700; ++i) EXPECT_NEAR(row[i], one_by_one[i], 1e-5);
}

TEST(Emission, TellsPicturesApartByTheirPixels) {
  const Emission a(picture(40, 3, [](int x, int) { return x; }), panel(40, 3));
  const Emission b(picture(40, 3, [](int x, int) { return x; }), panel(40, 3));
  const Emission c(picture(40, 3, [](int x, int y) { return x == 39 && y == 2 ? 40 : x; }),
                   panel(40, 3));
  EXPECT_EQ(a.hash(), b.hash());
  EXPECT_NE(a.hash(), c.hash());
}

}  // namespace
}  // namespace alhazen::sim
