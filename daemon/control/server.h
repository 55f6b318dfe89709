#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"
#include "daemon/control/events.h"

namespace alhazen {

/// The two ZeroMQ sockets: ROUTER for requests, XPUB for events.
///
/// Thread: thread-bound (control thread); the sockets never leave it.
class Server {
 public:
  /// Binds both. An ipc:// socket lies in a directory of mode 0750, which is made where it is
  /// missing; a socket file nobody listens at any more is removed if it is ours. A tcp:// endpoint
  /// must be on the loopback.
  /// Fails: invalid (not an endpoint; a directory others may write; TCP off the loopback), conflict
  ///        (another daemon listens there), unavailable (cannot bind).
  [[nodiscard]] static Result<std::unique_ptr<Server>> open(const std::string& control_endpoint,
                                                            const std::string& event_endpoint);
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;
  ~Server();

  /// What a request is answered with.
  using Answer = std::function<std::string(std::string_view request)>;

  /// Waits until a request, or one of `fds`, or `at_most` has come; answers what has come of
  /// requests. Returns which of `fds` are readable.
  /// Fails: internal (the sockets are broken).
  [[nodiscard]] Result<std::vector<bool>> wait(std::span<const int> fds,
                                               std::chrono::milliseconds at_most,
                                               const Answer& answer);

  /// Sends an event to whoever listens. Never blocks: a slow reader loses it and sees the gap.
  void publish(const EventLog::Published& event);

  /// Messages that could not be answered; replies whose client had gone.
  [[nodiscard]] std::uint64_t dropped() const noexcept;
  [[nodiscard]] std::uint64_t replies_lost() const noexcept;
  /// Where clients connect: with the port that was found for tcp://127.0.0.1:*.
  [[nodiscard]] std::string control_endpoint() const;
  [[nodiscard]] std::string event_endpoint() const;

 private:
  struct State;
  explicit Server(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

}  // namespace alhazen
