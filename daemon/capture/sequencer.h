#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/capture/capture.h"
#include "daemon/capture/freshness.h"
#include "daemon/capture/writer.h"

namespace alhazen {

/// A capture is tried once and retaken at most this many times.
inline constexpr int kRetakes = 3;

/// Walks a plan: turn, show, wait until steady, trigger, collect, hand over. The only place of the
/// house that tries anything again:
///  - a frame that did not arrive (timeout), arrived incomplete (corrupt) or is stale (freshness.h)
///    is retaken, at most kRetakes times; then the step fails with its history. The other cameras'
///    frames of the step are kept meanwhile, and only the complete set is handed over.
///  - a display, table or trigger that timed out is asked again as often.
///  - a device that is gone (unavailable) is opened again, for some seconds, and the stop repeated
///    from the display under way, once.
///
/// The room: each camera's first black picture, within the first steps of a scan, tells how bright
/// it is (ambient.h).
///
/// Pipelined: once the latest exposure has ended the next picture is shown, while the frames of the
/// last are still in transfer. A trigger never comes before all displays are steady, nor while the
/// table moves; every stop is approached by turning in the positive direction.
///
/// Thread: rig lane.
class Sequencer {
 public:
  /// Takes the next item of the writer; false: it will take no more.
  using HandOver = std::function<bool(WriterItem)>;

  /// Everything given must outlive it. `devices` fit `plan` (capture_scan has checked).
  Sequencer(const Manifest& plan, DeviceSet& devices, Clock& clock, OnGap on_gap, Hold& hold,
            const CaptureHooks& hooks, HandOver hand_over, std::stop_token stop);

  /// Takes what `committed` does not hold. Fails: as capture_scan().
  Status run(const std::set<StackKey>& committed);

  /// All displays black, the table halted, no frame pending. Whatever cannot be reached is left
  /// alone with a warning. Ignores the stop token.
  void make_safe();

  /// What was done so far: all but light_maps, skipped and seconds.
  [[nodiscard]] Captured done() const;

 private:
  struct PlanCamera {
    std::string name;
    Camera* device = nullptr;
    CameraSettings settings;
    Freshness freshness;
    bool pending = false;  // triggered, its frame not collected
    bool gone = false;     // given up for this stop (OnGap::accept)
    bool dark = false;     // its first black picture was judged (ambient.h)
  };
  struct PlanDisplay {
    std::string name;
    Display* device = nullptr;
    int width_px = 0, height_px = 0;
    double gamma = 0;
    std::optional<Pattern> lit;  // what it shows, where that is known
    bool gone = false;           // given up for this stop (OnGap::accept)
  };
  /// One camera's way to its frame of one step.
  struct Try {
    int camera = 0;
    Time triggered{};
    std::string history;         // of the attempts that failed
    std::optional<Error> cause;  // why the last one did
  };

  Status prepare();
  Status take_stop(int stop, const std::set<StackKey>& committed);
  Status try_stop(int stop, const std::set<StackKey>& committed);
  Status take_display(const Step& first, std::vector<int> cameras);
  Status capture(const Step& step, const Pattern& next, std::vector<int>& cameras);
  Status expose(const Step& step, const Pattern& next, std::vector<Try>& tries, Time& deadline);
  Status collect(const Step& step, int number, Time deadline, std::vector<Try>& tries,
                 ShotSet& set);
  Status check_ambient(const ShotSet& set);
  Status go_to(int stop);
  Status home();
  Status show(PlanDisplay& display, const Pattern& pattern);
  Status all_black();
  Status hold_here(HoldAt boundary);
  Status recover(const Error& loss, int stop);
  bool give_up(int stop, const std::set<StackKey>& committed, const Error& cause);
  void add_gap(StackKey key, const Error& cause);
  [[nodiscard]] Time table_deadline(double angle_rad) const;
  [[nodiscard]] StackKey key_of(int stop, int display, int camera) const;
  [[nodiscard]] bool is_open(const StackKey& key, const std::set<StackKey>& committed) const;
  [[nodiscard]] std::string where(const Step& step) const;
  void warn(const std::string& sentence) const;
  /// Calls `ask` again where it timed out, at most kRetakes times; notes whose call failed.
  template <class Ask>
  auto insist(const std::string& device, Ask ask) -> decltype(ask());

  const Manifest& plan_;
  DeviceSet& devices_;
  Clock& clock_;
  const OnGap on_gap_;
  Hold& hold_;
  const CaptureHooks& hooks_;
  const HandOver hand_over_;
  const std::stop_token stop_;

  std::vector<Step> steps_;
  std::vector<PlanCamera> cameras_;    // the plan's, in its order
  std::vector<PlanDisplay> displays_;  // the plan's, in its order, then those only kept black
  Turntable* table_ = nullptr;
  std::string table_name_;
  Time steady_{};                 // from then on the light of every display can be trusted
  std::optional<double> at_rad_;  // last commanded angle, reached turning forward
  double measured_rad_ = 0;
  std::string culprit_;       // the device whose call failed last
  std::set<StackKey> taken_;  // stacks of this run that are over: handed over or gaps
  Captured done_;
};

}  // namespace alhazen
