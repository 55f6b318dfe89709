#pragma once

#include <string>

#include "alhazen/result.h"
#include "tools/ctl_client.h"

namespace alhazen::ctl {

struct WatchOptions {
  bool json = false;      ///< every event as one line of JSON, the job at the end
  bool terminal = false;  ///< bars that move; else a line now and then
};

/// Follows a job to its end: progress of every stage, rate and time left, retakes, warnings,
/// previews. REQUIRES: client.subscribe() succeeded.
/// Returns: the exit code that its end deserves.
/// Fails: as Client; cancelled (Ctrl-C: the job goes on).
[[nodiscard]] Result<int> watch_job(Client& client, const std::string& job,
                                    const WatchOptions& options);

/// Prints events whose topic begins with `topic` until Ctrl-C.
Status watch_events(Client& client, const std::string& topic, bool json);

/// From now on Ctrl-C ends watching instead of the process.
void catch_interrupt();

}  // namespace alhazen::ctl
