#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <variant>
#include <vector>

#include "alhazen/result.h"
#include "daemon/jobs/job.h"

namespace alhazen {

enum class LaneName : std::uint8_t { rig, compute };
[[nodiscard]] constexpr std::string_view name_of(LaneName lane) noexcept {
  return lane == LaneName::rig ? "rig" : "compute";
}

/// How far a stage of a job is; of several waiting ones only the latest is kept.
struct Told {
  StageProgress progress;
  double elapsed_s = 0;  ///< on the rig's clock since this run began; 0: not told
};
/// Something clients are to hear of, published as it is.
struct Noted {
  std::string topic;
  std::shared_ptr<const nlohmann::json> body;
};
struct Warned {
  std::string line;
};
struct Retaken {
  std::shared_ptr<const nlohmann::json> body;
};
/// The capture waits (`reason`), or goes on (empty).
struct Held {
  std::string reason;
};
/// The scan directory is there: light maps may be fed to the compute lane.
struct ScanOpened {};
/// The devices were opened, or their state changed.
struct DevicesChanged {
  Status opened;
};
/// A lane's part of a job is over; the lane is idle.
struct Ended {
  LaneName lane = LaneName::rig;
  Status status;
  std::shared_ptr<const nlohmann::json> result;  ///< merged into the job's; may be null
  bool gaps = false;                             ///< whole stacks are missing
};

struct LaneEvent {
  std::string job;  ///< empty: of the lane itself
  std::variant<Told, Noted, Warned, Retaken, Held, ScanOpened, DevicesChanged, Ended> what;
};

/// From the lanes to the control thread, which waits on fd() in its poll. Thread-safe; never blocks
/// the sender; bounded, because progress overwrites progress and everything else is counted by the
/// plan.
class EventQueue {
 public:
  EventQueue();
  ~EventQueue();
  EventQueue(const EventQueue&) = delete;
  EventQueue& operator=(const EventQueue&) = delete;

  /// Readable while something waits.
  [[nodiscard]] int fd() const noexcept { return fd_; }
  void push(LaneEvent event);
  /// Everything that waits, oldest first. Caller: control thread.
  [[nodiscard]] std::vector<LaneEvent> take();

 private:
  const int fd_;
  std::mutex mutex_;
  std::vector<LaneEvent> waiting_;
};

}  // namespace alhazen
