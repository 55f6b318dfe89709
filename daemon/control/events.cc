#include "daemon/control/events.h"

#include <nlohmann/json.hpp>
#include <utility>

#include "daemon/control/message.h"
#include "daemon/jobs/job.h"

namespace alhazen {

using nlohmann::json;

EventLog::EventLog(std::string epoch, std::size_t capacity)
    : epoch_(std::move(epoch)), capacity_(capacity) {
  ALHAZEN_CHECK(capacity > 0);
}

const EventLog::Published& EventLog::add(std::string_view topic, const json& body) {
  if (kept_.size() == capacity_) kept_.pop_front();
  ++last_;
  kept_.push_back({std::string(topic), last_,
                   dump({{"topic", std::string(topic)},
                         {"epoch", epoch_},
                         {"seq", last_},
                         {"at", utc_now()},
                         {"body", body}})});
  return kept_.back();
}

Result<json> EventLog::replay(std::string_view epoch, std::uint64_t after,
                              std::size_t limit) const {
  if (!epoch.empty() && epoch != epoch_)
    return Error{Code::conflict, "epoch " + std::string(epoch) + " is over, this one is " + epoch_ +
                                     ": read status anew, then replay from 0"};
  if (after > last_)
    return Error{Code::invalid, "args.after is " + std::to_string(after) + "; it must be at most " +
                                    std::to_string(last_) + ", the last event"};
  json events = json::array();
  const std::uint64_t first_kept = last_ - kept_.size() + 1;
  const std::uint64_t begin = std::max(after + 1, first_kept);
  std::uint64_t next = after;
  std::size_t bytes = 0;
  for (std::uint64_t seq = begin; seq <= last_ && events.size() < limit; ++seq) {
    const Published& event = kept_[static_cast<std::size_t>(seq - first_kept)];
    // An answer obeys the limit of a message, too; half of it leaves room for everything else.
    bytes += event.text.size();
    if (bytes > kLargestMessage / 2 && !events.empty()) break;
    events.push_back(json::parse(event.text));
    next = seq;
  }
  return json{{"epoch", epoch_},
              {"events", std::move(events)},
              {"next", std::max(next, begin - 1)},
              {"last", last_},
              {"lost", begin - (after + 1)}};
}

}  // namespace alhazen
