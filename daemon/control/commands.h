#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "alhazen/driver.h"
#include "alhazen/result.h"
#include "daemon/control/events.h"
#include "daemon/control/message.h"
#include "daemon/control/verbs.h"
#include "daemon/jobs/jobs.h"

namespace alhazen {

/// What the daemon counted since it started.
struct Counters {
  std::uint64_t requests = 0;      ///< messages that were answered, refusals among them
  std::uint64_t refusals = 0;      ///< answered with an error
  std::uint64_t dropped = 0;       ///< messages that could not be answered at all
  std::uint64_t replies_lost = 0;  ///< whose client had gone or did not read
};

/// The verbs: from the text of a request to the text of its reply, always from memory.
///
/// Thread: thread-bound (control thread).
class Commands {
 public:
  /// What a verb may need besides jobs and events.
  struct Daemon {
    std::string software_version, event_endpoint;
    std::shared_ptr<const nlohmann::json> config;  ///< resolved, for config.show
    std::function<void(Severity)> set_log_level;
    std::function<void()> shut_down;
  };

  Commands(Jobs& jobs, EventLog& events, Counters& counters, Daemon daemon);

  /// Never fails: what is wrong becomes an error reply.
  [[nodiscard]] std::string answer(std::string_view message);

  /// "starting", "idle", "running", "pausing", "paused", "stopping" or "fault".
  [[nodiscard]] std::string state() const;

 private:
  using Json = nlohmann::json;
  using Handler = Result<Json> (Commands::*)(const Json& args);
  static const std::map<std::string_view, Handler>& handlers();

  [[nodiscard]] Result<Json> perform(const Request& request);
  [[nodiscard]] Json revisions() const;
  [[nodiscard]] Json reply_of(const Job& job) const;
  [[nodiscard]] Json reply_of(const ScanEntry& scan) const;
  [[nodiscard]] std::vector<std::string> obstacles() const;

  Result<Json> hello(const Json& args);
  Result<Json> ping(const Json& args);
  Result<Json> status(const Json& args);
  Result<Json> rig_describe(const Json& args);
  Result<Json> rig_check(const Json& args);
  Result<Json> device_list(const Json& args);
  Result<Json> device_describe(const Json& args);
  Result<Json> plan_list(const Json& args);
  Result<Json> plan_estimate(const Json& args);
  Result<Json> scan_submit(const Json& args);
  Result<Json> scan_list(const Json& args);
  Result<Json> scan_get(const Json& args);
  Result<Json> reconstruct_submit(const Json& args);
  Result<Json> job_list(const Json& args);
  Result<Json> job_get(const Json& args);
  Result<Json> job_pause(const Json& args);
  Result<Json> job_resume(const Json& args);
  Result<Json> job_stop(const Json& args);
  Result<Json> job_abort(const Json& args);
  Result<Json> queue_start(const Json& args);
  Result<Json> preview_take(const Json& args);
  Result<Json> events_replay(const Json& args);
  Result<Json> config_show(const Json& args);
  Result<Json> log_level(const Json& args);
  Result<Json> service_shutdown(const Json& args);

  Jobs& jobs_;
  EventLog& events_;
  Counters& counters_;
  const Daemon daemon_;
  const std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
};

/// A device as the protocol shows it: facts, settings with range and unit, readings.
[[nodiscard]] nlohmann::json to_json(const DeviceDescription& device);

}  // namespace alhazen
