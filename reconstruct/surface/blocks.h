#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "reconstruct/vote/parallel.h"

namespace alhazen {

/// Elements worked on together. Fixed, so that no result depends on how threads share the work.
inline constexpr std::size_t kBlock = 4096;

/// Runs body(begin, end) over fixed blocks of [0, count).
template <class Body>
void for_blocks(std::size_t count, const Body& body) {
  for_each_index((count + kBlock - 1) / kBlock, [&](std::size_t block) {
    body(block * kBlock, std::min(count, (block + 1) * kBlock));
  });
}

/// Σ body(begin, end) over the blocks, added in their order.
template <std::size_t kSums, class Body>
[[nodiscard]] std::array<double, kSums> sum_blocks(std::size_t count, const Body& body) {
  std::vector<std::array<double, kSums>> partial((count + kBlock - 1) / kBlock);
  for_blocks(count, [&](std::size_t begin, std::size_t end) {
    partial[begin / kBlock] = body(begin, end);
  });
  std::array<double, kSums> sum{};
  for (const std::array<double, kSums>& p : partial)
    for (std::size_t k = 0; k < kSums; ++k) sum[k] += p[k];
  return sum;
}

}  // namespace alhazen
