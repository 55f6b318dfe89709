#include "reconstruct/scan/pixel_memory.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <thread>
#include <vector>

#include "reconstruct/scan/light_map.h"

namespace alhazen {
namespace {

constexpr std::size_t kMiB = std::size_t{1} << 20;

/// Fills the store with blocks of a size that no test asks for, so that all start alike.
void fill_store() {
  constexpr std::size_t kBytes = kMiB + 1, kBlocks = kMostKeptBytes / kBytes + 1;
  std::vector<void*> blocks;
  for (std::size_t i = 0; i < kBlocks; ++i) blocks.push_back(take_pixels(kBytes));
  for (void* block : blocks) give_pixels(block, kBytes);
}

TEST(PixelMemory, GivesTheYoungestBlockOfTheSameSizeAgain) {
  void* first = take_pixels(3 * kMiB);
  void* second = take_pixels(3 * kMiB);
  void* larger = take_pixels(3 * kMiB + 64);
  for (void* block : {first, second, larger}) {
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(block) % kPixelAlignment, 0U);
  }
  give_pixels(first, 3 * kMiB);
  give_pixels(second, 3 * kMiB);
  give_pixels(larger, 3 * kMiB + 64);
  EXPECT_EQ(take_pixels(3 * kMiB), second);
  EXPECT_EQ(take_pixels(3 * kMiB), first);
  EXPECT_EQ(take_pixels(3 * kMiB + 64), larger);
  give_pixels(first, 3 * kMiB);
  give_pixels(second, 3 * kMiB);
  give_pixels(larger, 3 * kMiB + 64);
}

TEST(PixelMemory, KeepsNoMoreThanItMay) {
  fill_store();
  EXPECT_LE(kept_pixel_bytes(), kMostKeptBytes);
  EXPECT_GT(kept_pixel_bytes(), kMostKeptBytes - 2 * kMiB);
  const std::size_t before = kept_pixel_bytes();
  // The oldest go, so the store follows a change of size.
  void* block = take_pixels(5 * kMiB);
  give_pixels(block, 5 * kMiB);
  EXPECT_LE(kept_pixel_bytes(), kMostKeptBytes);
  EXPECT_EQ(take_pixels(5 * kMiB), block);
  EXPECT_LT(kept_pixel_bytes(), before);
  give_pixels(block, 5 * kMiB);
}

TEST(PixelMemory, HoldsNoMoreThanWasOnceInUseAtOnce) {
  // In a process of its own, that used nothing before.
  testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(
      {
        std::size_t most = 0;
        for (std::size_t i = 0; i < 40; ++i) {
          give_pixels(take_pixels(8 * kMiB + 64 * i), 8 * kMiB + 64 * i);
          most = std::max(most, kept_pixel_bytes());
        }
        std::_Exit(most >= 8 * kMiB && most <= 8 * kMiB + 64 * 39 ? 0 : 1);
      },
      testing::ExitedWithCode(0), "");
}

TEST(PixelMemory, LeavesSmallAndHugeBlocksToTheSystem) {
  const std::size_t before = kept_pixel_bytes();
  for (const std::size_t bytes :
       {std::size_t{0}, std::size_t{1}, kLeastKeptBytes - 1, kMostKeptBytes + 1}) {
    give_pixels(take_pixels(bytes), bytes);
    EXPECT_EQ(kept_pixel_bytes(), before);
  }
}

TEST(PixelMemory, NoBlockIsGivenToTwoThreads) {
  std::vector<std::jthread> threads;
  for (int id = 1; id <= 4; ++id) {
    threads.emplace_back([id] {
      for (int round = 0; round < 200; ++round) {
        PixelList<std::uint8_t> list(kLeastKeptBytes, static_cast<std::uint8_t>(id));
        for (const std::uint8_t value : list) ASSERT_EQ(value, id);
      }
    });
  }
}

}  // namespace
}  // namespace alhazen
