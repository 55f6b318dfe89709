#pragma once

#include <chrono>
#include <string>

#include "alhazen/result.h"

namespace alhazen {

/// What the service manager hears: READY, STATUS, STOPPING, WATCHDOG. Without one, nothing happens.
/// Thread: thread-bound (control thread).
class Service {
 public:
  /// Reads WATCHDOG_USEC.
  Service();

  void ready();
  /// One line for `systemctl status`; said only when it changes.
  void status(const std::string& line);
  void stopping();
  /// Feeds the watchdog, at most as often as it needs.
  void feed();
  /// How often feed() must be called; zero: no watchdog.
  [[nodiscard]] std::chrono::milliseconds feed_every() const noexcept { return feed_every_; }

 private:
  std::chrono::milliseconds feed_every_{0};
  std::chrono::steady_clock::time_point fed_;
  std::string said_;
};

/// SIGTERM and SIGINT as a file descriptor: blocked for the whole process, so make it before any
/// thread begins. SIGPIPE is ignored. Thread-bound.
class Signals {
 public:
  /// Fails: unavailable (no descriptors left).
  [[nodiscard]] static Result<Signals> open();
  Signals(Signals&& other) noexcept;
  Signals& operator=(Signals&& other) noexcept;
  ~Signals();

  /// Readable when a signal waits.
  [[nodiscard]] int fd() const noexcept { return fd_; }
  /// The name of the signal that waited.
  [[nodiscard]] std::string take() const;

 private:
  explicit Signals(int fd) noexcept : fd_(fd) {}
  int fd_ = -1;
};

}  // namespace alhazen
