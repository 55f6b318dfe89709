#include "reconstruct/pattern/gray_code.h"

#include <gtest/gtest.h>

#include <bit>

namespace alhazen {
namespace {

TEST(GrayCode, RoundTripsAndNeighboursDifferInOneBit) {
  for (std::uint32_t value = 0; value < (1U << 16); ++value) {
    ASSERT_EQ(binary_from_gray(gray_from_binary(value)), value);
    ASSERT_EQ(std::popcount(gray_from_binary(value) ^ gray_from_binary(value + 1)), 1);
  }
}

TEST(GrayCode, BitsCoverEverySize) {
  EXPECT_EQ(gray_bits(2), 1);
  EXPECT_EQ(gray_bits(1024), 10);
  EXPECT_EQ(gray_bits(1025), 11);
  for (int size = 2; size <= 16384; ++size) ASSERT_LE(size, 1 << gray_bits(size));
}

}  // namespace
}  // namespace alhazen
