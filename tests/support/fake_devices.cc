#include "tests/support/fake_devices.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

namespace alhazen {
namespace {

/// Pictures of a display that are remembered: more than can be under way in one exposure.
constexpr std::size_t kHistory = 8;

/// Rigs by id, for the driver entry: a plain function that knows only its settings.
struct Registry {
  std::mutex mutex;
  std::map<std::string, FakeRig*> rigs;
  int made = 0;
};
Registry& registry() {
  static Registry rigs;
  return rigs;
}

std::string pattern_text(const Picture& picture) {
  if (!picture.pattern) return "picture";
  const Pattern& pattern = *picture.pattern;
  switch (pattern.kind) {
    case PatternKind::white:
      return "white";
    case PatternKind::black:
      return "black";
    case PatternKind::gray:
      return std::string(pattern.axis == Axis::u ? "u" : "v") + std::to_string(pattern.bit) +
             (pattern.inverted ? "-" : "+");
    case PatternKind::phase:
      break;
  }
  return "phase";
}

Error lost(const std::string& device) { return {Code::unavailable, device + " stopped answering"}; }

Result<FakeRig*> find_rig(const Settings& settings) {
  const std::string id = ALHAZEN_TRY(settings.text("rig"));
  const std::scoped_lock lock(registry().mutex);
  const auto found = registry().rigs.find(id);
  if (found == registry().rigs.end()) return Error{Code::invalid, "no fake rig '" + id + "'"};
  return found->second;
}

}  // namespace

class FakeCamera final : public Camera {
 public:
  FakeCamera(FakeRig& rig, std::string name) : rig_(rig), name_(std::move(name)) {
    info_.model = "fake camera";
    info_.serial = name_;
    info_.width_px = rig.options_.width_px;
    info_.height_px = rig.options_.height_px;
    info_.exposure_min = Micros{10};
    info_.exposure_max = Micros{1'000'000};
    info_.gain_max_db = 24;
    info_.readout_max = rig.options_.readout;
    settings_.region = {0, 0, info_.width_px, info_.height_px};
  }
  [[nodiscard]] const CameraInfo& info() const noexcept override { return info_; }

  Result<CameraSettings> configure(const CameraSettings& wanted) noexcept override {
    const auto fault = rig_.enter(name_, "configure");
    if (fault == Fault::timeout) return Error{Code::timeout, "no answer"};
    if (fault == Fault::lost) return lost(name_);
    if (pending_) return Error{Code::conflict, "a frame is pending"};
    settings_ = wanted;
    if (settings_.region.width == 0) settings_.region = {0, 0, info_.width_px, info_.height_px};
    return settings_;
  }

  Result<Time> trigger() noexcept override {
    const auto fault = rig_.enter(name_, "trigger");
    if (fault == Fault::timeout) return Error{Code::timeout, "no answer"};
    if (fault == Fault::lost) return lost(name_);
    if (pending_) return Error{Code::conflict, "a frame is pending"};
    pending_ = true;
    begin_ = rig_.clock_.now();
    return begin_ + settings_.exposure;
  }

  Result<Frame> wait_frame(Time deadline, std::stop_token stop) noexcept override {
    const auto fault = rig_.enter(name_, "wait_frame");
    if (fault == Fault::lost) return lost(name_);
    if (!pending_) return Error{Code::conflict, "nothing was triggered"};
    const Time arrival = begin_ + settings_.exposure + rig_.options_.readout;
    if (fault == Fault::timeout || arrival > deadline) {
      if (!rig_.clock_.sleep_until(deadline, stop)) return Error{Code::cancelled, "stop"};
      pending_ = false;
      return Error{Code::timeout, "no frame"};
    }
    if (!rig_.clock_.sleep_until(fault == Fault::slow ? arrival + Micros{1'000'000} : arrival,
                                 stop))
      return Error{Code::cancelled, "stop"};
    pending_ = false;
    if (fault == Fault::corrupt) return Error{Code::corrupt, "2 packets lost"};
    Frame frame;
    frame.settings = settings_;
    frame.exposure_begin = begin_;
    frame.exposure_end = begin_ + settings_.exposure;
    frame.device_counter = ++counter_;
    frame.image = rig_.expose(frame.exposure_begin, frame.exposure_end, settings_.region);
    if (fault == Fault::stale && last_) {
      --counter_;
      return *last_;
    }
    if (fault == Fault::stale_by_counter) frame.device_counter = --counter_;
    if (fault == Fault::stale_by_time) frame.exposure_begin -= Micros{10'000};
    if (fault == Fault::stale_by_pixels && last_) frame.image = last_->image;
    last_ = frame;
    return frame;
  }

  [[nodiscard]] Readings readings() const noexcept override {
    return {{"frames", static_cast<double>(counter_), "1", false}};
  }

 private:
  FakeRig& rig_;
  const std::string name_;
  CameraInfo info_;
  CameraSettings settings_;
  bool pending_ = false;
  Time begin_{};
  std::uint64_t counter_ = 0;
  std::optional<Frame> last_;
};

class FakeDisplay final : public Display {
 public:
  FakeDisplay(FakeRig& rig, std::string name, std::size_t index)
      : rig_(rig), name_(std::move(name)), index_(index) {
    info_.model = "fake display";
    info_.serial = name_;
    info_.width_px = rig.options_.width_px;
    info_.height_px = rig.options_.height_px;
    info_.refresh_hz = 60;
  }
  [[nodiscard]] const DisplayInfo& info() const noexcept override { return info_; }

  Result<Time> show(const Picture& picture, std::stop_token stop) noexcept override {
    const auto fault = rig_.enter(name_, "show", pattern_text(picture));
    if (fault == Fault::timeout) return Error{Code::timeout, "no answer"};
    if (fault == Fault::lost) return lost(name_);
    if (stop.stop_requested()) return Error{Code::cancelled, "stop"};
    const Time now = rig_.clock_.now();
    const std::scoped_lock lock(rig_.mutex_);
    auto& shown = rig_.shown_[index_];
    if (shown.size() == kHistory) shown.erase(shown.begin());
    shown.push_back({picture.image, now + rig_.options_.latency});
    return rig_.options_.hasty_display ? now : shown.back().steady;
  }
  [[nodiscard]] Readings readings() const noexcept override { return {}; }

 private:
  FakeRig& rig_;
  const std::string name_;
  const std::size_t index_;
  DisplayInfo info_;
};

class FakeTurntable final : public Turntable {
 public:
  FakeTurntable(FakeRig& rig, std::string name) : rig_(rig), name_(std::move(name)) {
    info_.model = "fake turntable";
    info_.serial = name_;
    info_.speed_rad_s = rig.options_.speed_rad_s;
  }
  [[nodiscard]] const TurntableInfo& info() const noexcept override { return info_; }

  Status home(Time deadline, std::stop_token stop) noexcept override {
    const auto fault = rig_.enter(name_, "home");
    if (fault == Fault::timeout) {
      if (!rig_.clock_.sleep_until(deadline, stop)) return Error{Code::cancelled, "stop"};
      return Error{Code::timeout, "the reference was not found"};
    }
    if (fault == Fault::lost) return lost(name_);
    if (stop.stop_requested()) return Error{Code::cancelled, "stop"};
    homed_ = true;
    return {};
  }

  Result<double> move_to(double angle_rad, Time deadline, std::stop_token stop) noexcept override {
    const auto fault = rig_.enter(
        name_, "move_to", std::to_string(std::lround(angle_rad * 180.0 / std::numbers::pi)));
    if (fault == Fault::lost) return lost(name_);
    if (!homed_) return Error{Code::conflict, "the table was not homed"};
    if (fault == Fault::timeout) {
      if (!rig_.clock_.sleep_until(deadline, stop)) return Error{Code::cancelled, "stop"};
      return Error{Code::timeout, "the table did not come to rest"};
    }
    Time end;
    {
      const std::scoped_lock lock(rig_.mutex_);
      const Time now = rig_.clock_.now();
      rig_.from_rad_ = rig_.angle_at(now);
      rig_.to_rad_ = angle_rad;
      rig_.turn_begin_ = now;
      const double speed = rig_.options_.speed_rad_s;
      const double turn_s = speed > 0 ? std::abs(angle_rad - rig_.from_rad_) / speed : 0;
      end = rig_.turn_end_ = now + Micros(std::llround(turn_s * 1e6));
    }
    if (!rig_.options_.hasty_table && !rig_.clock_.sleep_until(end, stop))
      return Error{Code::cancelled, "stop"};
    return fault == Fault::corrupt ? std::numeric_limits<double>::quiet_NaN() : angle_rad;
  }
  void halt() noexcept override { ++rig_.halts_; }
  [[nodiscard]] Readings readings() const noexcept override { return {}; }

 private:
  FakeRig& rig_;
  const std::string name_;
  TurntableInfo info_;
  bool homed_ = false;
};

class FakeDriver final : public Driver {
 public:
  explicit FakeDriver(FakeRig& rig) : rig_(rig) {}
  Result<std::vector<Found>> find() noexcept override { return std::vector<Found>{}; }
  Result<std::unique_ptr<Camera>> open_camera(const Settings& settings) noexcept override {
    const std::string id = ALHAZEN_TRY(open(settings));
    return std::unique_ptr<Camera>(std::make_unique<FakeCamera>(rig_, id));
  }
  Result<std::unique_ptr<Display>> open_display(const Settings& settings) noexcept override {
    const std::string id = ALHAZEN_TRY(open(settings));
    return std::unique_ptr<Display>(
        std::make_unique<FakeDisplay>(rig_, id, static_cast<std::size_t>(id.back() - '0')));
  }
  Result<std::unique_ptr<Turntable>> open_turntable(const Settings& settings) noexcept override {
    const std::string id = ALHAZEN_TRY(open(settings));
    return std::unique_ptr<Turntable>(std::make_unique<FakeTurntable>(rig_, id));
  }

 private:
  Result<std::string> open(const Settings& settings) {
    std::string id = ALHAZEN_TRY(settings.text("id"));
    const auto fault = rig_.enter(id, "open");
    if (fault) return Error{Code::unavailable, id + " is not there"};
    const std::scoped_lock lock(rig_.mutex_);
    if (rig_.lost_for_good_[id]) return Error{Code::unavailable, id + " is not there"};
    rig_.lost_[id] = false;
    return id;
  }
  FakeRig& rig_;
};

FakeRig::FakeRig(Clock& clock, FakeOptions options)
    : clock_(clock), options_(options), shown_(static_cast<std::size_t>(options.displays)) {
  const std::vector<std::uint8_t> grey(
      static_cast<std::size_t>(options_.width_px) * static_cast<std::size_t>(options_.height_px),
      128);
  grey_ = Image::copy<std::uint8_t>(options_.width_px, options_.height_px, 8, grey);
  const std::scoped_lock lock(registry().mutex);
  id_ = "rig" + std::to_string(++registry().made);
  registry().rigs[id_] = this;
}

FakeRig::~FakeRig() {
  const std::scoped_lock lock(registry().mutex);
  registry().rigs.erase(id_);
}

void FakeRig::script(const std::string& device, const std::string& call, int nth, Fault fault,
                     int times) {
  const std::scoped_lock lock(mutex_);
  script_[{device, call}].push_back({fault, nth, times});
}

void FakeRig::at_call(int nth, std::function<void()> action) {
  const std::scoped_lock lock(mutex_);
  actions_.emplace(nth, std::move(action));
}

std::optional<Fault> FakeRig::enter(const std::string& device, const std::string& call,
                                    std::string detail) {
  std::vector<std::function<void()>> actions;
  std::optional<Fault> fault;
  {
    const std::scoped_lock lock(mutex_);
    const Time now = clock_.now();
    if (options_.pixels) calls_.push_back({now, device, call, std::move(detail), all_steady(now)});
    ++call_number_;
    const auto [first, last] = actions_.equal_range(call_number_);
    for (auto it = first; it != last; ++it) actions.push_back(it->second);
    const int number = ++counts_[{device, call}];
    if (const auto scripted = script_.find({device, call}); scripted != script_.end())
      for (const Scripted& line : scripted->second)
        if (number >= line.first && number < line.first + line.times) fault = line.fault;
    if (fault == Fault::lost || fault == Fault::lost_for_good) lost_[device] = true;
    if (fault == Fault::lost_for_good) lost_for_good_[device] = true;
    if (call != "open" && lost_[device]) fault = Fault::lost;
  }
  for (const auto& action : actions) action();
  return fault;
}

DeviceSpecs FakeRig::specs() const {
  DeviceSpecs specs;
  Settings driver("fake.toml", "driver.fake", "");
  driver.set("rig", id_);
  specs.drivers.push_back({"fake", "fake", driver});
  const auto device = [&](const std::string& kind, const std::string& name) {
    Settings settings("fake.toml", kind + "." + name, "");
    settings.set("id", name);
    return DeviceSpec{name, "fake", settings, {}};
  };
  for (int i = 0; i < options_.cameras; ++i)
    specs.cameras.push_back(device("camera", "c" + std::to_string(i)));
  for (int i = 0; i < options_.displays; ++i)
    specs.displays.push_back(device("display", "d" + std::to_string(i)));
  specs.turntables.push_back(device("turntable", "table"));
  return specs;
}

const AlhazenDriverEntry& FakeRig::entry() {
  static constexpr AlhazenDriverEntry kEntry{
      kDriverAbi,
      ALHAZEN_DRIVER_BUILD,
      "fake",
      "scripted devices for tests",
      true,
      [](const Host&, const Settings& settings) noexcept -> Result<std::unique_ptr<Driver>> {
        FakeRig* rig = ALHAZEN_TRY(find_rig(settings));
        return std::unique_ptr<Driver>(std::make_unique<FakeDriver>(*rig));
      }};
  return kEntry;
}

Rig FakeRig::rig() const {
  Rig rig;
  for (int i = 0; i < options_.cameras; ++i) {
    CameraModel camera;
    camera.name = "c" + std::to_string(i);
    camera.width_px = options_.width_px;
    camera.height_px = options_.height_px;
    camera.fx_px = camera.fy_px = 2.0 * options_.width_px;
    camera.cx_px = (options_.width_px - 1) / 2.0;
    camera.cy_px = (options_.height_px - 1) / 2.0;
    // 400 mm from the axis, 50 mm above the plate, looking at the axis.
    const double azimuth = 0.3 * i;
    const Eigen::Vector3d forward(-std::cos(azimuth), -std::sin(azimuth), 0);
    const Eigen::Vector3d down(0, 0, -1);
    camera.camera_from_rig.rotation.row(0) = down.cross(forward).transpose();
    camera.camera_from_rig.rotation.row(1) = down.transpose();
    camera.camera_from_rig.rotation.row(2) = forward.transpose();
    const Eigen::Vector3d centre = -400.0 * forward + Eigen::Vector3d(0, 0, 50);
    camera.camera_from_rig.translation_mm = -(camera.camera_from_rig.rotation * centre);
    rig.cameras.push_back(camera);
  }
  for (int i = 0; i < options_.displays; ++i) {
    DisplayModel display;
    display.name = "d" + std::to_string(i);
    display.width_px = options_.width_px;
    display.height_px = options_.height_px;
    display.origin_mm = {400, 200.0 + 100.0 * i, 200};
    rig.displays.push_back(display);
  }
  return rig;
}

DeviceFacts FakeRig::facts() const {
  // Asked of devices made for the purpose: they answer info() without touching the script.
  auto& self = const_cast<FakeRig&>(*this);
  DeviceFacts facts;
  for (int i = 0; i < options_.cameras; ++i) {
    const std::string name = "c" + std::to_string(i);
    facts.cameras.push_back({name, FakeCamera(self, name).info(), {}});
  }
  for (int i = 0; i < options_.displays; ++i) {
    const std::string name = "d" + std::to_string(i);
    facts.displays.push_back({name, FakeDisplay(self, name, static_cast<std::size_t>(i)).info()});
  }
  facts.turntable = FakeTurntable(self, "table").info();
  return facts;
}

std::vector<FakeCall> FakeRig::calls(const std::string& device, const std::string& call) const {
  const std::scoped_lock lock(mutex_);
  std::vector<FakeCall> chosen;
  for (const FakeCall& one : calls_)
    if ((device.empty() || one.device == device) && (call.empty() || one.call == call))
      chosen.push_back(one);
  return chosen;
}

int FakeRig::call_count() const {
  const std::scoped_lock lock(mutex_);
  return call_number_;
}

int FakeRig::seen_column(int x, int display, double angle_rad) const {
  const double turned_px = angle_rad * 180.0 / std::numbers::pi / options_.degrees_per_px;
  const int shift = static_cast<int>(std::lround(turned_px)) + display;
  return ((x + shift) % options_.width_px + options_.width_px) % options_.width_px;
}

bool FakeRig::is_dark() const {
  const std::scoped_lock lock(mutex_);
  return std::all_of(shown_.begin(), shown_.end(), [](const std::vector<Shown>& shown) {
    if (shown.empty()) return false;  // never told to be black
    const auto pixels = shown.back().image.mono8();
    return std::all_of(pixels.begin(), pixels.end(), [](std::uint8_t value) { return value == 0; });
  });
}

double FakeRig::angle_at(Time when) const {
  if (when >= turn_end_) return to_rad_;
  if (when <= turn_begin_) return from_rad_;
  const double share = static_cast<double>((when - turn_begin_).count()) /
                       static_cast<double>((turn_end_ - turn_begin_).count());
  return from_rad_ + share * (to_rad_ - from_rad_);
}

bool FakeRig::all_steady(Time when) const {
  return when >= turn_end_ &&
         std::all_of(shown_.begin(), shown_.end(), [&](const std::vector<Shown>& shown) {
           return shown.empty() || when >= shown.back().steady;
         });
}

double FakeRig::light(std::size_t display, std::size_t pixel, Time begin, Time end) const {
  double sum = 0;
  const std::vector<Shown>& shown = shown_[display];
  for (std::size_t i = 0; i < shown.size(); ++i) {
    const Time from = std::max(begin, shown[i].steady);
    const Time until = i + 1 < shown.size() ? std::min(end, shown[i + 1].steady) : end;
    if (until > from)
      sum += shown[i].image.mono8()[pixel] * static_cast<double>((until - from).count());
  }
  return sum / static_cast<double>((end - begin).count());
}

Image FakeRig::expose(Time begin, Time end, const Region& region) const {
  if (!options_.pixels) return grey_;
  const std::scoped_lock lock(mutex_);
  const double angle = angle_at(begin);
  std::vector<std::uint8_t> pixels;
  pixels.reserve(static_cast<std::size_t>(region.width) * static_cast<std::size_t>(region.height));
  for (int y = region.y; y < region.y + region.height; ++y) {
    const std::size_t row =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(options_.width_px);
    for (int x = region.x; x < region.x + region.width; ++x) {
      double seen = 0;
      for (int d = 0; d < options_.displays && !options_.blind; ++d)
        seen += light(static_cast<std::size_t>(d),
                      row + static_cast<std::size_t>(seen_column(x, d, angle)), begin, end);
      pixels.push_back(static_cast<std::uint8_t>(std::min(10 + std::lround(seen * 0.9), 255L)));
    }
  }
  return Image::copy<std::uint8_t>(region.width, region.height, 8, pixels);
}

}  // namespace alhazen
