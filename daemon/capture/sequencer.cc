#include "daemon/capture/sequencer.h"

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "daemon/capture/ambient.h"
#include "daemon/capture/freshness.h"
#include "reconstruct/pattern/draw.h"

namespace alhazen {
namespace {

/// Beyond twice the time a turn should take.
constexpr Micros kTurnAllowance{30'000'000};
/// A full turn where the table does not tell its speed: slow rotary stages need two minutes.
constexpr Micros kUnknownTurn{120'000'000};
/// Waits before a lost device is opened again: a camera that was reset answers after some seconds.
constexpr std::array<Micros, 6> kReopenWaits{Micros{0},         Micros{250'000},
                                             Micros{500'000},   Micros{1'000'000},
                                             Micros{2'000'000}, Micros{4'000'000}};
/// Measured and wanted angle may differ by this much before it is worth a warning (1°): the
/// measured one is what counts, but the plan's overlap of views suffers.
constexpr double kAngleWarnRad = std::numbers::pi / 180.0;

constexpr Pattern kBlack{.kind = PatternKind::black};

bool is_retakeable(Code code) { return code == Code::timeout || code == Code::corrupt; }

Error stop_requested() { return {Code::cancelled, "stop requested"}; }

}  // namespace

Sequencer::Sequencer(const Manifest& plan, DeviceSet& devices, Clock& clock, OnGap on_gap,
                     Hold& hold, const CaptureHooks& hooks, HandOver hand_over,
                     std::stop_token stop)
    : plan_(plan),
      devices_(devices),
      clock_(clock),
      on_gap_(on_gap),
      hold_(hold),
      hooks_(hooks),
      hand_over_(std::move(hand_over)),
      stop_(std::move(stop)),
      steps_(make_steps(plan)),
      table_(devices.turntable()) {
  for (const PlannedCamera& camera : plan.cameras) {
    PlanCamera mine;
    mine.name = camera.name;
    mine.device = devices.camera(camera.name);
    mine.settings = camera.settings;
    cameras_.push_back(std::move(mine));
  }
  const auto add_display = [&](const std::string& name, int width_px, int height_px, double gamma) {
    PlanDisplay mine;
    mine.name = name;
    mine.device = devices.display(name);
    mine.width_px = width_px;
    mine.height_px = height_px;
    mine.gamma = gamma;
    displays_.push_back(std::move(mine));
  };
  for (const PlannedDisplay& display : plan.displays)
    add_display(display.name, display.width_px, display.height_px, display.gamma);
  for (const std::string& name : devices.names(DeviceKind::display)) {
    const bool planned =
        std::any_of(displays_.begin(), displays_.end(),
                    [&](const PlanDisplay& display) { return display.name == name; });
    const DisplayInfo& info = devices.display(name)->info();
    if (!planned && info.width_px > 0)
      add_display(name, info.width_px, info.height_px, kUsualGamma);
  }
  if (const auto names = devices.names(DeviceKind::turntable); !names.empty())
    table_name_ = names.front();
}

Status Sequencer::run(const std::set<StackKey>& committed) {
  ALHAZEN_TRY(prepare());
  for (int stop = 0; stop < static_cast<int>(plan_.stops.size()); ++stop)
    ALHAZEN_TRY(take_stop(stop, committed));
  return {};
}

Captured Sequencer::done() const {
  Captured done = done_;
  for (const PlanCamera& camera : cameras_)
    done.unchanged += camera.freshness.confirmed_unchanged();
  return done;
}

Status Sequencer::prepare() {
  // A display that no step needs must be dark, but is no reason to refuse the scan.
  for (std::size_t i = displays_.size(); i-- > plan_.displays.size();) {
    Status dark = show(displays_[i], kBlack);
    if (dark) continue;
    if (dark.error().code == Code::cancelled) return dark;
    warn("display " + displays_[i].name +
         " is not in the plan and cannot be made black: " + dark.error().text());
    displays_.erase(displays_.begin() + static_cast<std::ptrdiff_t>(i));
  }
  return {};
}

Status Sequencer::take_stop(int stop, const std::set<StackKey>& committed) {
  for (PlanCamera& camera : cameras_) camera.gone = false;
  for (PlanDisplay& display : displays_) display.gone = false;
  bool open = false;
  for (int display = 0; display < static_cast<int>(plan_.displays.size()); ++display)
    for (int camera = 0; camera < static_cast<int>(cameras_.size()); ++camera)
      open = open || is_open(key_of(stop, display, camera), committed);
  if (!open) return {};

  ALHAZEN_TRY(hold_here(HoldAt::stop));
  bool repeated = false;
  for (;;) {
    Status taken = try_stop(stop, committed);
    if (taken) break;
    const Error error = taken.error();
    const bool lost = error.code == Code::unavailable && !culprit_.empty();
    if (lost && !repeated) {
      repeated = true;
      taken = recover(error, stop);
      if (taken) continue;
      if (taken.error().code == Code::cancelled) return taken;
    }
    if (!(lost || error.code == Code::timeout) || on_gap_ != OnGap::accept ||
        !give_up(stop, committed, error))
      return taken;
  }
  devices_.refresh_readings();
  if (hooks_.on_stop_done) hooks_.on_stop_done(stop, measured_rad_);
  return {};
}

Status Sequencer::try_stop(int stop, const std::set<StackKey>& committed) {
  const std::string place = "stop " + std::to_string(stop);
  culprit_.clear();
  ALHAZEN_TRY(all_black().in(place));
  ALHAZEN_TRY(go_to(stop).in(place));
  for (const Step& step : steps_) {
    if (step.stop != stop || !step.first_of_display) continue;
    std::vector<int> cameras;
    for (int camera = 0; camera < static_cast<int>(cameras_.size()); ++camera)
      if (is_open(key_of(stop, step.display, camera), committed) &&
          !cameras_[static_cast<std::size_t>(camera)].gone)
        cameras.push_back(camera);
    if (!cameras.empty()) ALHAZEN_TRY(take_display(step, std::move(cameras)));
  }
  return {};
}

Status Sequencer::take_display(const Step& first, std::vector<int> cameras) {
  const std::vector<Pattern>& patterns =
      plan_.displays[static_cast<std::size_t>(first.display)].patterns;
  for (const int camera : cameras)
    cameras_[static_cast<std::size_t>(camera)].freshness.begin_stack();
  if (!hand_over_(StackStart{first.stop, first.display, measured_rad_, cameras}))
    return stop_requested();
  for (std::size_t i = 0; i < patterns.size(); ++i) {
    const Step& step = steps_[first.index + i];
    ALHAZEN_TRY(hold_here(HoldAt::step));
    ALHAZEN_TRY(capture(step, i + 1 < patterns.size() ? patterns[i + 1] : kBlack, cameras));
    if (cameras.empty()) break;  // every stack of this display has become a gap
    ++done_.steps;
    if (hooks_.on_step) hooks_.on_step({step.index + 1, steps_.size(), step});
  }
  if (!hand_over_(StackEnd{})) return stop_requested();
  for (const int camera : cameras) taken_.insert(key_of(first.stop, first.display, camera));
  return show(displays_[static_cast<std::size_t>(first.display)], kBlack).in(where(first));
}

Status Sequencer::capture(const Step& step, const Pattern& next, std::vector<int>& cameras) {
  ShotSet set{step, {}, {}};
  std::vector<Try> tries;
  tries.reserve(cameras.size());
  for (const int camera : cameras) tries.push_back({camera, {}, {}, {}});
  for (int number = 1; !tries.empty(); ++number) {
    Time deadline{};
    ALHAZEN_TRY(expose(step, next, tries, deadline).in(where(step)));
    ALHAZEN_TRY(collect(step, number, deadline, tries, set).in(where(step)));
    std::erase_if(tries, [](const Try& one) { return !one.cause; });
    if (number <= kRetakes) continue;
    for (const Try& one : tries) {
      const std::string& name = cameras_[static_cast<std::size_t>(one.camera)].name;
      Error failure = Error{one.cause->code, "no usable frame in " + std::to_string(number) +
                                                 " attempts: " + one.history}
                          .in("camera " + name)
                          .in(where(step));
      culprit_.clear();  // it answers: opening it again would not help
      if (on_gap_ != OnGap::accept) {
        set.shots.clear();  // never decoded; what was refused may be kept to see why
        static_cast<void>(hand_over_(std::move(set)));
        return failure;
      }
      const StackKey key = key_of(step.stop, step.display, one.camera);
      add_gap(key, failure);
      taken_.insert(key);
      std::erase(cameras, one.camera);
    }
    break;
  }
  if (set.shots.empty() && set.refused.empty()) return {};
  if (plan_.displays[static_cast<std::size_t>(step.display)]
          .patterns[static_cast<std::size_t>(step.pattern)] == kBlack) {
    ALHAZEN_TRY(check_ambient(set));
  }
  done_.frames += set.shots.size();
  return hand_over_(std::move(set)) ? Status() : Status(stop_requested());
}

Status Sequencer::expose(const Step& step, const Pattern& next, std::vector<Try>& tries,
                         Time& deadline) {
  PlanDisplay& display = displays_[static_cast<std::size_t>(step.display)];
  const Pattern& pattern = plan_.displays[static_cast<std::size_t>(step.display)]
                               .patterns[static_cast<std::size_t>(step.pattern)];
  ALHAZEN_TRY(show(display, pattern));
  if (!clock_.sleep_until(steady_, stop_)) return stop_requested();
  for (Try& one : tries) {
    PlanCamera& camera = cameras_[static_cast<std::size_t>(one.camera)];
    one.cause.reset();
    const auto set = camera.device->configure(camera.settings);
    if (!set) {
      one.cause = set.error();
    } else if (set->region != camera.settings.region) {
      return Error{Code::unsupported,
                   "it reads out " + std::to_string(set->region.width) + "x" +
                       std::to_string(set->region.height) + " at " + std::to_string(set->region.x) +
                       "," + std::to_string(set->region.y) + " instead of the region of the plan"}
          .in("camera " + camera.name);
    }
  }
  Time ended = clock_.now();
  Micros readout{0};
  for (Try& one : tries) {
    if (one.cause) continue;
    PlanCamera& camera = cameras_[static_cast<std::size_t>(one.camera)];
    one.triggered = clock_.now();
    const auto end = camera.device->trigger();
    if (!end) {
      one.cause = end.error();
      continue;
    }
    camera.pending = true;
    ended = std::max(ended, *end);
    readout = std::max(readout, camera.device->info().readout_max);
  }
  deadline = ended + readout + kReadoutAllowance;
  if (!clock_.sleep_until(ended, stop_)) return stop_requested();
  // The next picture settles while the frames of this one are still in transfer. Where that fails
  // the frames are collected all the same: no camera may be left with one pending.
  Status shown = show(display, next);
  if (shown || shown.error().code == Code::cancelled) return shown;
  ShotSet dropped;
  ALHAZEN_TRY(collect(step, kRetakes + 1, deadline, tries, dropped));
  culprit_ = display.name;
  return shown;
}

Status Sequencer::collect(const Step& step, int number, Time deadline, std::vector<Try>& tries,
                          ShotSet& set) {
  const Pattern& pattern = plan_.displays[static_cast<std::size_t>(step.display)]
                               .patterns[static_cast<std::size_t>(step.pattern)];
  std::optional<Error> fatal;
  for (Try& one : tries) {
    PlanCamera& camera = cameras_[static_cast<std::size_t>(one.camera)];
    if (!one.cause) {
      auto frame = camera.device->wait_frame(deadline, stop_);
      if (!frame && frame.error().code == Code::cancelled) return stop_requested();
      camera.pending = false;
      if (frame) {
        const auto bytes = frame->image.bytes();
        Shot shot{one.camera, std::move(*frame), XXH3_64bits(bytes.data(), bytes.size()), number};
        if (shot.frame.settings.region != camera.settings.region)
          one.cause = Error{Code::corrupt, "a frame of another region than was set"};
        else
          one.cause = camera.freshness.judge(shot.frame, shot.checksum, pattern, one.triggered);
        (one.cause ? set.refused : set.shots).push_back(std::move(shot));
      } else {
        one.cause = frame.error();
      }
    }
    if (!one.cause) continue;
    one.history += (number > 1 ? "; " : "") + std::to_string(number) + ": " +
                   std::string(name_of(one.cause->code)) + ", " + one.cause->what;
    if (!is_retakeable(one.cause->code)) {
      // The rest is collected first; who is gone matters more than who only complains.
      if (!fatal || one.cause->code == Code::unavailable) {
        fatal = one.cause;
        culprit_ = camera.name;
      }
    } else if (number <= kRetakes) {
      ++done_.retakes;
      if (hooks_.on_retake) hooks_.on_retake({step, camera.name, number, *one.cause});
    }
  }
  if (fatal) return *std::move(fatal);
  return {};
}

Status Sequencer::check_ambient(const ShotSet& set) {
  for (const Shot& shot : set.shots) {
    PlanCamera& camera = cameras_[static_cast<std::size_t>(shot.camera)];
    if (camera.dark) continue;
    const std::string warning = ALHAZEN_TRY(judge_ambient(camera.name, shot.frame.image));
    if (!warning.empty()) warn(warning);
    camera.dark = true;
  }
  return {};
}

Status Sequencer::go_to(int stop) {
  const double wanted = plan_.stops[static_cast<std::size_t>(stop)].wanted_rad;
  if (!at_rad_) ALHAZEN_TRY(home());
  const auto turn = [&](double angle_rad) {
    return insist(table_name_, [&] {
      return table_->move_to(angle_rad, table_deadline(2 * std::numbers::pi), stop_);
    });
  };
  if (!at_rad_ || *at_rad_ >= wanted) {
    at_rad_.reset();
    measured_rad_ = ALHAZEN_TRY(turn(wanted - kRunUpRad));
  }
  at_rad_.reset();
  measured_rad_ = ALHAZEN_TRY(turn(wanted));
  at_rad_ = wanted;
  if (std::abs(measured_rad_ - wanted) > kAngleWarnRad)
    warn("stop " + std::to_string(stop) + ": the table stands at " + std::to_string(measured_rad_) +
         " rad instead of " + std::to_string(wanted) + " rad");
  return {};
}

Status Sequencer::home() {
  return insist(table_name_,
                [&] { return table_->home(table_deadline(2 * std::numbers::pi), stop_); });
}

Time Sequencer::table_deadline(double angle_rad) const {
  const TurntableInfo& info = table_->info();
  const Micros turn = info.speed_rad_s > 0
                          ? Micros(static_cast<Micros::rep>(1e6 * angle_rad / info.speed_rad_s))
                          : kUnknownTurn;
  return clock_.now() + 2 * turn + kTurnAllowance;
}

Status Sequencer::show(PlanDisplay& display, const Pattern& pattern) {
  if (display.lit == pattern) return {};
  const Picture picture =
      ALHAZEN_TRY(draw(pattern, display.width_px, display.height_px, display.gamma));
  display.lit.reset();
  const Time steady =
      ALHAZEN_TRY(insist(display.name, [&] { return display.device->show(picture, stop_); }));
  display.lit = pattern;
  steady_ = std::max(steady_, steady);
  return {};
}

Status Sequencer::all_black() {
  for (PlanDisplay& display : displays_)
    if (!display.gone) ALHAZEN_TRY(show(display, kBlack));
  return {};
}

Status Sequencer::hold_here(HoldAt boundary) {
  if (stop_.stop_requested()) return stop_requested();
  if (!hold_.wanted(boundary)) return {};
  // As far as they can be reached: whoever is lost is found at the next picture.
  if (const Status dark = all_black(); !dark) warn(dark.error().text());
  if (hooks_.on_hold) hooks_.on_hold(true);
  if (!hold_.wait(stop_)) return stop_requested();
  if (hooks_.on_hold) hooks_.on_hold(false);
  return {};
}

Status Sequencer::recover(const Error& loss, int stop) {
  const std::string device = culprit_;
  warn(loss.text() + "; it is opened again and stop " + std::to_string(stop) + " repeated");
  Status opened;
  for (const Micros wait : kReopenWaits) {
    if (!clock_.sleep_until(clock_.now() + wait, stop_)) return stop_requested();
    opened = devices_.reopen(device);
    if (opened || opened.error().code != Code::unavailable) break;
  }
  culprit_ = device;
  if (!opened)
    return Error{opened.error().code,
                 loss.what + "; opened again " + std::to_string(kReopenWaits.size()) +
                     " times: " + opened.error().what,
                 loss.where};
  ++done_.reopened;
  for (PlanCamera& camera : cameras_)
    if (camera.name == device) camera.freshness.forget();
  for (PlanDisplay& display : displays_)
    if (display.name == device) display.lit.reset();
  if (device == table_name_) at_rad_.reset();
  return {};
}

bool Sequencer::give_up(int stop, const std::set<StackKey>& committed, const Error& cause) {
  for (int display = 0; display < static_cast<int>(plan_.displays.size()); ++display)
    for (int camera = 0; camera < static_cast<int>(cameras_.size()); ++camera) {
      const StackKey key = key_of(stop, display, camera);
      if ((key.display == culprit_ || key.camera == culprit_) && is_open(key, committed)) {
        add_gap(key, cause);
        taken_.insert(key);
      }
    }
  for (PlanCamera& camera : cameras_)
    if (camera.name == culprit_) return camera.gone = true;
  for (PlanDisplay& display : displays_)
    if (display.name == culprit_) return display.gone = true;
  return false;  // nothing can be scanned without the table
}

void Sequencer::add_gap(StackKey key, const Error& cause) {
  done_.gaps.push_back({std::move(key), cause});
  if (hooks_.on_gap) hooks_.on_gap(done_.gaps.back());
}

StackKey Sequencer::key_of(int stop, int display, int camera) const {
  return {plan_.stops[static_cast<std::size_t>(stop)].index,
          plan_.displays[static_cast<std::size_t>(display)].name,
          plan_.cameras[static_cast<std::size_t>(camera)].name};
}

bool Sequencer::is_open(const StackKey& key, const std::set<StackKey>& committed) const {
  return committed.count(key) == 0 && taken_.count(key) == 0;
}

std::string Sequencer::where(const Step& step) const {
  return "stop " + std::to_string(step.stop) + " / display " +
         plan_.displays[static_cast<std::size_t>(step.display)].name + " / pattern " +
         std::to_string(step.pattern);
}

void Sequencer::warn(const std::string& sentence) const {
  if (hooks_.on_warning) hooks_.on_warning(sentence);
}

template <class Ask>
auto Sequencer::insist(const std::string& device, Ask ask) -> decltype(ask()) {
  auto answer = ask();
  for (int again = 0; again < kRetakes && !answer && answer.error().code == Code::timeout;
       ++again) {
    warn(answer.error().text() + "; asked again");
    answer = ask();
  }
  if (!answer) culprit_ = device;
  return answer;
}

void Sequencer::make_safe() {
  for (PlanCamera& camera : cameras_) {
    if (!camera.pending) continue;
    const Time deadline = clock_.now() + camera.settings.exposure +
                          camera.device->info().readout_max + kReadoutAllowance;
    (void)camera.device->wait_frame(deadline, {});
    camera.pending = false;
  }
  for (PlanDisplay& display : displays_) {
    if (display.lit == kBlack) continue;
    const auto picture = draw(kBlack, display.width_px, display.height_px);
    if (!picture) continue;
    const auto shown = display.device->show(*picture, {});
    if (!shown) warn("display " + display.name + " may not be black: " + shown.error().text());
  }
  if (table_ != nullptr) table_->halt();
}

}  // namespace alhazen
