#pragma once

#include <cstdint>
#include <deque>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "alhazen/result.h"

namespace alhazen {

/// The events that were published, numbered, with the last ones kept for readers that missed some.
///
/// Thread: thread-bound (control thread).
/// Invariant: numbers start at 1 and rise by one; `epoch` changes with every start of the daemon.
class EventLog {
 public:
  EventLog(std::string epoch, std::size_t capacity);

  struct Published {
    std::string topic;
    std::uint64_t seq = 0;
    std::string text;  ///< the whole event as JSON
  };

  /// Numbers an event and keeps it. The reference holds until the next call.
  const Published& add(std::string_view topic, const nlohmann::json& body);

  [[nodiscard]] const std::string& epoch() const noexcept { return epoch_; }
  [[nodiscard]] std::uint64_t last() const noexcept { return last_; }

  /// Events after `after`, oldest first, at most `limit`: {epoch, events, next, last, lost}.
  /// `lost` counts those that are no longer kept.
  /// Fails: conflict (another epoch: the daemon was restarted), invalid (`after` lies ahead).
  [[nodiscard]] Result<nlohmann::json> replay(std::string_view epoch, std::uint64_t after,
                                              std::size_t limit) const;

 private:
  std::string epoch_;
  std::size_t capacity_;
  std::uint64_t last_ = 0;
  std::deque<Published> kept_;
};

}  // namespace alhazen
