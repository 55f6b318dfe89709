#pragma once

#include <chrono>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "alhazen/result.h"

namespace alhazen::ctl {

/// One event of the daemon.
struct Event {
  std::string topic, text;  ///< text: the whole event as JSON
};

/// A client of the daemon's two sockets. Thread-bound.
class Client {
 public:
  /// Fails: unavailable (no socket there, not an endpoint).
  [[nodiscard]] static Result<Client> connect(const std::string& control_endpoint,
                                              std::chrono::milliseconds timeout);
  Client(Client&&) noexcept;
  Client& operator=(Client&&) noexcept;
  ~Client();

  /// Asks and waits for the answer: the reply's `ok`.
  /// Fails: as the daemon says; timeout (no answer in time); corrupt (not an answer).
  [[nodiscard]] Result<nlohmann::json> ask(std::string_view verb, const nlohmann::json& args,
                                           const std::string& idem = {});

  /// From now on events come. `endpoint` empty: the one that hello names.
  Status subscribe(std::string endpoint);
  /// The next event; nothing when none came in time or a signal did.
  [[nodiscard]] Result<std::optional<Event>> next_event(std::chrono::milliseconds at_most);

 private:
  struct State;
  explicit Client(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

}  // namespace alhazen::ctl
