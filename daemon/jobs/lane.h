#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <stop_token>
#include <string>
#include <thread>

#include "daemon/base/bounded_queue.h"

namespace alhazen {

/// A thread that runs one piece of work after the other. The control thread hands over the next
/// when it heard the end of the one before, so handing over never waits.
///
/// Thread: start() belongs to the control thread; beat() and silence() are thread-safe.
class Lane {
 public:
  using Work = std::function<void()>;

  explicit Lane(std::string name);
  /// Waits for the work in progress: stop it first.
  ~Lane();
  Lane(const Lane&) = delete;
  Lane& operator=(const Lane&) = delete;

  [[nodiscard]] const std::string& name() const noexcept { return name_; }

  /// Hands over work. REQUIRES: the work before has announced its end.
  void start(Work work);

  /// A sign of life of the work in progress.
  void beat() noexcept;
  /// How long the work in progress has given no sign; zero when there is none.
  [[nodiscard]] std::chrono::milliseconds silence() const noexcept;

 private:
  void run();

  const std::string name_;
  BoundedQueue<Work> inbox_{1};
  std::atomic<bool> busy_{false};
  std::atomic<std::chrono::steady_clock::rep> last_beat_{0};
  std::jthread thread_;  // last: it uses all the others
};

}  // namespace alhazen
