#pragma once

#if defined(__SANITIZE_THREAD__)
#include <atomic>
#include <optional>
#include <thread>
#else
#include <tbb/parallel_for.h>
#endif

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace alhazen {

/// Runs body(i) for all i in [0, count), in the caller's TBB arena.
template <class Body>
void for_each_index(std::size_t count, const Body& body) {
#if defined(__SANITIZE_THREAD__)
  // Debian's TBB is not built with the thread sanitizer, which therefore can tell no race from a
  // hand-over of tasks. It can with two threads that share a counter and nothing else.
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = 0; (i = next.fetch_add(1, std::memory_order_relaxed)) < count;) body(i);
  };
  constexpr std::size_t kWorthAThread = 16;
  std::optional<std::jthread> other;
  if (count >= kWorthAThread) other.emplace(work);
  work();
#else
  tbb::parallel_for(std::size_t{0}, count, body);
#endif
}

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
