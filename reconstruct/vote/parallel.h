#pragma once

#if defined(__SANITIZE_THREAD__)
#include <atomic>
#include <optional>
#include <thread>
#else
#include <tbb/parallel_for.h>
#endif

#include <cstddef>

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

}  // namespace alhazen
