#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/clock.h"
#include "alhazen/result.h"
#include "daemon/devices/device_set.h"
#include "daemon/plan/plan.h"
#include "reconstruct/decode/decoder.h"
#include "reconstruct/scan/light_map.h"
#include "reconstruct/scan/scan.h"

namespace alhazen {

/// Facts of the opened devices for make_plan(); an absent device keeps the facts of its last time,
/// or is left out where it never was open.
[[nodiscard]] DeviceFacts facts_of(const DeviceSet& devices);

/// Where a running capture may be held.
enum class HoldAt : std::uint8_t { step, stop };

/// The brake of a running capture: the control thread holds and releases, the rig lane waits here
/// between steps with all displays black. Thread-safe.
class Hold {
 public:
  /// Asks to wait at the next step or stop. `reason` is for people ("operator", "disk").
  void hold(HoldAt at, std::string reason);
  /// Lets go on.
  void release();
  /// Why it is held or will be; empty: it is not.
  [[nodiscard]] std::string reason() const;

  /// For the capture: whether to wait at such a boundary.
  [[nodiscard]] bool wanted(HoldAt boundary) const;
  /// For the capture: waits until released; false once `stop` is requested.
  [[nodiscard]] bool wait(std::stop_token stop);

 private:
  mutable std::mutex mutex_;
  std::condition_variable_any released_;
  std::optional<HoldAt> at_;
  std::string reason_;
};

struct CaptureProgress {
  std::uint64_t done = 0, total = 0;  ///< steps, those of committed stacks counted as done
  Step step;                          ///< the one that was just taken
};

/// A frame that was thrown away and is taken again.
struct Retake {
  Step step;
  std::string camera;
  int attempt = 1;  ///< the one that failed, 1 = first
  Error cause;
};

/// A stack that could not be taken (OnGap::accept).
struct Gap {
  StackKey key;
  Error cause;
};

/// Whom to tell. Empty functions: nobody listens. They must not block. on_light_map comes from the
/// writer thread, the others from the thread that called capture_scan().
struct CaptureHooks {
  std::function<void(const CaptureProgress&)> on_step;
  std::function<void(const Retake&)> on_retake;
  /// All stacks of a stop are taken (not yet necessarily committed).
  std::function<void(int stop, double measured_rad)> on_stop_done;
  /// The map is safe on disk.
  std::function<void(std::shared_ptr<const LightMap>)> on_light_map;
  std::function<void(const Gap&)> on_gap;
  /// True: now waiting (reason in Hold::reason()); false: going on.
  std::function<void(bool held)> on_hold;
  std::function<void(const std::string&)> on_warning;
};

struct CaptureOptions {
  DecodeOptions decode;
  OnGap on_gap = OnGap::fail;
  /// Sets of frames (one of every camera) that may wait for the writer. 1 … 64.
  int queue_sets = 3;
};

/// What a capture did.
struct Captured {
  std::uint64_t steps = 0, frames = 0;  ///< taken in this run
  std::uint64_t retakes = 0;            ///< frames thrown away and taken again
  std::uint64_t unchanged = 0;          ///< equal to the frame before and confirmed by a retake
  std::uint32_t reopened = 0;           ///< devices
  std::uint64_t light_maps = 0;         ///< committed in this run
  std::uint64_t skipped = 0;            ///< stacks that were committed before
  std::vector<Gap> gaps;
  double seconds = 0;  ///< on the given clock
};

/// Takes every stack of the scan's plan that its directory does not already prove, decodes and
/// commits it. Blocks until done; one thread (the writer) runs beside the caller's and is joined
/// before return. At the end, whatever it is, displays are black and the table is at rest.
///
/// Retakes: the only retry policy of the house; see sequencer.h.
/// Caller:  rig lane (owner of `devices`).
/// Fails:   cancelled (stop requested; what is committed stays), timeout, corrupt, unavailable
///          (after all retakes, with the history of attempts), invalid (a device is missing or
///          does not fit the plan), conflict (the room is too bright, ambient.h), exhausted never:
///          the capture is held with reason "disk" until released.
[[nodiscard]] Result<Captured> capture_scan(Scan& scan, DeviceSet& devices, Clock& clock,
                                            const CaptureOptions& options, Hold& hold,
                                            const CaptureHooks& hooks, const std::stop_token& stop);

}  // namespace alhazen
