#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "alhazen/driver.h"
#include "daemon/devices/device_set.h"
#include "daemon/devices/loader.h"
#include "daemon/plan/plan.h"
#include "reconstruct/geometry/rig.h"

namespace alhazen {

/// What a fake device does instead of answering a call rightly.
enum class Fault : std::uint8_t {
  timeout,           ///< answers nothing until the deadline
  corrupt,           ///< an incomplete frame; a number that is none
  stale,             ///< the frame before once more, as it was
  stale_by_counter,  ///< a new frame under the old counter
  stale_by_time,     ///< a new frame exposed before the trigger
  stale_by_pixels,   ///< the old pixels under new time and counter
  lost,              ///< unavailable until it is opened again
  lost_for_good,     ///< unavailable, and so is opening it again
  slow,              ///< answers rightly, a second late
};

/// How the fake rig is made.
struct FakeOptions {
  int cameras = 2, displays = 2;    ///< "c0" …, "d0" …; the table is "table"
  int width_px = 8, height_px = 8;  ///< of sensors and displays alike
  Micros latency{20'000};           ///< from show() to steady light
  Micros readout{5'000};            ///< from the end of an exposure to the frame
  double speed_rad_s = 1.0;         ///< 0: turns in no time
  double degrees_per_px = 30.0;     ///< the table turns what a camera sees by one pixel so far
  bool hasty_display = false;       ///< show() answers "steady now"
  bool hasty_table = false;         ///< move_to() returns at once, the table turns on
  bool blind = false;               ///< cameras see nothing of the displays
  bool pixels = true;  ///< false: frames of one grey, made once (for measuring overhead)
};

/// One call of a device, as it arrived.
struct FakeCall {
  Time at{};
  std::string device, call;
  std::string detail;  ///< of show: "white", "u2-"; of move_to: degrees
  bool steady = true;  ///< of trigger: all displays steady and the table at rest
};

/// Scripted cameras, displays and a turntable that share one world: pixel (x, y) of camera c sees
/// pixel (x + shift, y) of every display added up, where shift follows the angle of the table (and
/// the display's number, so that light maps tell displays apart). A display shows the old picture
/// until it is steady; an exposure records the mixture by time, and where the table is when it
/// begins.
///
/// Thread-safe. A driver entry finds its rig by the setting `rig`.
class FakeRig {
 public:
  explicit FakeRig(Clock& clock, FakeOptions options = {});
  FakeRig(const FakeRig&) = delete;
  FakeRig& operator=(const FakeRig&) = delete;
  ~FakeRig();

  /// Call number `nth` (1 = first) of `call` ("configure", "trigger", "wait_frame", "show",
  /// "home", "move_to", "open") on `device` shows `fault`; `times` such calls in a row.
  void script(const std::string& device, const std::string& call, int nth, Fault fault,
              int times = 1);
  /// Runs at call number `nth` of all device calls, before it is answered.
  void at_call(int nth, std::function<void()> action);

  /// Configuration and loader for a DeviceSet of this rig.
  [[nodiscard]] DeviceSpecs specs() const;
  [[nodiscard]] static const AlhazenDriverEntry& entry();
  /// Calibrated geometry with the same names and sizes: cameras on a ring, displays beside.
  [[nodiscard]] Rig rig() const;
  [[nodiscard]] DeviceFacts facts() const;

  /// All calls so far; with `device` or `call` given, only those.
  [[nodiscard]] std::vector<FakeCall> calls(const std::string& device = {},
                                            const std::string& call = {}) const;
  [[nodiscard]] int call_count() const;
  /// Where camera pixel column x sees display `display` with the table at `angle_rad`.
  [[nodiscard]] int seen_column(int x, int display, double angle_rad) const;
  /// Every display shows black at this moment.
  [[nodiscard]] bool is_dark() const;
  [[nodiscard]] int halts() const { return halts_.load(); }
  [[nodiscard]] const FakeOptions& options() const { return options_; }

 private:
  friend class FakeCamera;
  friend class FakeDisplay;
  friend class FakeTurntable;
  friend class FakeDriver;

  struct Shown {
    Image image;
    Time steady{};  // it replaces the one before at this moment
  };
  struct Scripted {
    Fault fault = Fault::timeout;
    int first = 1, times = 1;
  };
  /// Notes the call; the fault scripted for it.
  std::optional<Fault> enter(const std::string& device, const std::string& call,
                             std::string detail = {});
  [[nodiscard]] double angle_at(Time when) const;
  [[nodiscard]] bool all_steady(Time when) const;
  /// Mean value of a display's pixel over an exposure.
  [[nodiscard]] double light(std::size_t display, std::size_t pixel, Time begin, Time end) const;
  [[nodiscard]] Image expose(Time begin, Time end, const Region& region) const;

  Clock& clock_;
  const FakeOptions options_;
  std::string id_;
  mutable std::mutex mutex_;
  std::map<std::pair<std::string, std::string>, std::vector<Scripted>> script_;
  std::map<std::pair<std::string, std::string>, int> counts_;
  std::map<std::string, bool> lost_, lost_for_good_;
  std::multimap<int, std::function<void()>> actions_;
  std::vector<FakeCall> calls_;
  int call_number_ = 0;
  std::vector<std::vector<Shown>> shown_;  // per display, in order; the last few
  double from_rad_ = 0, to_rad_ = 0;
  Time turn_begin_{}, turn_end_{};
  Image grey_;
  std::atomic<int> halts_{0};
};

}  // namespace alhazen
