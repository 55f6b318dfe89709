#include "reconstruct/decode/decoder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "reconstruct/pattern/draw.h"
#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

const StackKey kKey{3, "north", "left"};

/// A display decoded from its own pictures: pixel (x, y) must say (x, y).
LightMap decode_itself(int width_px, int height_px) {
  const std::vector<Pattern> sequence = *make_sequence(Coding::gray, width_px, height_px);
  Decoder decoder =
      *Decoder::make({}, kKey, 0.5, {0, 0, width_px, height_px}, 8, width_px, height_px, sequence);
  for (const Pattern& pattern : sequence) {
    EXPECT_FALSE(decoder.complete());
    EXPECT_TRUE(decoder.add(pattern, draw(pattern, width_px, height_px)->image));
  }
  EXPECT_TRUE(decoder.complete());
  return *std::move(decoder).finish();
}

TEST(Decoder, EveryDisplayDecodesItself) {
  for (const auto& [width, height] : {std::pair{2, 2},
                                      {3, 5},
                                      {7, 2},
                                      {64, 1023},
                                      {1025, 3},
                                      {1280, 17},
                                      {16384, 2},
                                      {2, 16383}}) {
    const LightMap map = decode_itself(width, height);
    ASSERT_EQ(map.region.width, width);
    EXPECT_EQ(map.key, kKey);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const auto i = static_cast<std::size_t>(y * width + x);
        ASSERT_EQ(map.label[i], Label::mirror) << x << " " << y;
        ASSERT_EQ(map.u_px[i], static_cast<float>(x));
        ASSERT_EQ(map.v_px[i], static_cast<float>(y));
        ASSERT_EQ(map.bit_u[i], 0);
        ASSERT_NEAR(map.sigma_u_px[i], 1 / std::sqrt(12.0), 1e-3);
        ASSERT_EQ(map.contrast[i], 1.0F);
      }
    }
  }
}

}  // namespace
}  // namespace alhazen
