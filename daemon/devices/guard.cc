#include "daemon/devices/guard.h"

#include <cmath>
#include <type_traits>

namespace alhazen {
namespace {

/// A call that only sets or starts something answers at once; network cameras take milliseconds.
constexpr Micros kPromptAnswer{500'000};
/// A display may wait for two refreshes and a tablet's answer over the radio.
constexpr Micros kShowAnswer{2'000'000};
/// A wait may come back this much after its deadline (scheduling) before it is worth a line.
constexpr Micros kDeadlineSlack{100'000};

std::string shown(double value) {
  std::string text = std::to_string(value);
  while (text.back() == '0') text.pop_back();
  if (text.back() == '.') text.pop_back();
  return text;
}

std::string size_text(int width, int height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

std::string us_text(Micros time) { return std::to_string(time.count()) + " us"; }

/// info() of a device that never was open.
template <class Info>
const Info& last_known(const DeviceDescription& description) {
  return std::get<Info>(description.info);
}

}  // namespace

template <class Device>
Status Guard<Device>::reopen() {
  if (!is_owner()) return stranger("open");
  std::unique_ptr<Device> old;
  {
    const std::scoped_lock lock(context_.mutex);
    old = std::move(device_);
    if (description_.state == DeviceState::ready) description_.state = DeviceState::lost;
  }
  const bool again = old != nullptr || description_.calls > 0;
  old.reset();  // closed before it is opened again: most devices know one owner
  forget();
  begin("open");
  auto opened = open_();
  const Time until = context_.host.clock.now() + Micros{10'000'000};
  if (!opened) return std::move(*end("open", until, &opened.error()));
  end("open", until, nullptr);
  const std::scoped_lock lock(context_.mutex);
  device_ = std::move(*opened);
  description_.info = device_->info();
  description_.state = DeviceState::ready;
  description_.trouble.clear();
  if (again) ++description_.reopened;
  return {};
}

template <class Device>
void Guard<Device>::refresh_readings() {
  Readings fresh = readings();
  const std::scoped_lock lock(context_.mutex);
  description_.readings = std::move(fresh);
}

template <class Device>
std::optional<Error> Guard<Device>::end(const char* what, Time until, const Error* error) {
  const Time now = context_.host.clock.now();
  if (now > until + kDeadlineSlack)
    context_.host.log.write(Severity::warning, label_ + " / " + what + " came back " +
                                                   us_text(now - until) + " later than allowed");
  std::optional<Error> outside;
  if (error != nullptr) {
    outside = error->in(what).in(label_);
    if (error->code != Code::cancelled) context_.host.log.write(Severity::debug, outside->text());
  }
  const std::scoped_lock lock(context_.mutex);
  context_.in_progress.reset();
  if (outside && outside->code != Code::cancelled) {
    ++description_.failures;
    if (outside->code == Code::unavailable) {
      if (description_.state == DeviceState::ready) description_.state = DeviceState::lost;
      description_.trouble = outside->what;
    } else if (description_.state == DeviceState::absent) {
      description_.trouble = outside->what;
    }
  }
  return outside;
}

template <class Device>
template <class Body>
auto Guard<Device>::call(const char* what, Time until, Body body) noexcept
    -> decltype(body(*this)) {
  using Answer = decltype(body(*this));
  if (!is_owner()) return Answer(stranger(what));
  if (!device_)
    return Answer(
        Error{Code::unavailable,
              label_ + " is not open" +
                  (description_.trouble.empty() ? std::string() : ": " + description_.trouble)}
            .in(what)
            .in(label_));
  begin(what);
  Answer answer = body(*device_);
  auto outside = end(what, until, answer ? nullptr : &answer.error());
  if (outside) return Answer(std::move(*outside));
  return answer;
}

template class Guard<Camera>;
template class Guard<Display>;
template class Guard<Turntable>;

const CameraInfo& GuardedCamera::info() const noexcept {
  return last_known<CameraInfo>(description_);
}

Result<CameraSettings> GuardedCamera::configure(const CameraSettings& wanted) noexcept {
  constexpr const char* kWhat = "configure";
  if (device_ && wanted_ == wanted) return set_;
  if (device_) {
    const CameraInfo& facts = info();
    if (wanted.exposure < facts.exposure_min || wanted.exposure > facts.exposure_max)
      return refusal(kWhat, "exposure " + us_text(wanted.exposure) + " is outside [" +
                                us_text(facts.exposure_min) + ", " + us_text(facts.exposure_max) +
                                "]");
    if (!(wanted.gain_db >= facts.gain_min_db && wanted.gain_db <= facts.gain_max_db))
      return refusal(kWhat, "gain " + shown(wanted.gain_db) + " dB is outside [" +
                                shown(facts.gain_min_db) + ", " + shown(facts.gain_max_db) + "]");
    const Region& region = wanted.region;
    const bool whole = region.width == 0 && region.height == 0;
    if (!whole &&
        (region.x < 0 || region.y < 0 || region.width < 1 || region.height < 1 ||
         region.x > facts.width_px - region.width || region.y > facts.height_px - region.height))
      return refusal(kWhat, "region " + size_text(region.width, region.height) + " at " +
                                std::to_string(region.x) + "," + std::to_string(region.y) +
                                " is outside the sensor of " +
                                size_text(facts.width_px, facts.height_px));
  }
  auto set = call(kWhat, context_.host.clock.now() + kPromptAnswer,
                  [&](Camera& camera) { return camera.configure(wanted); });
  if (!set) {
    wanted_.reset();
    return set;
  }
  wanted_ = wanted;
  set_ = *set;
  const std::scoped_lock lock(context_.mutex);
  description_.camera_settings = set_;
  return set;
}

Result<Time> GuardedCamera::trigger() noexcept {
  return call("trigger", context_.host.clock.now() + kPromptAnswer,
              [](Camera& camera) { return camera.trigger(); });
}

Result<Frame> GuardedCamera::wait_frame(Time deadline, std::stop_token stop) noexcept {
  return call("wait_frame", deadline, [&](Camera& camera) -> Result<Frame> {
    auto frame = camera.wait_frame(deadline, std::move(stop));
    if (!frame) return frame;
    // What a driver hands over must fit what it says about it, or nobody can decode it.
    const Image& image = frame->image;
    const Region& region = frame->settings.region;
    const int width = region.width > 0 ? region.width : info().width_px;
    const int height = region.height > 0 ? region.height : info().height_px;
    if (image.empty() || image.width() != width || image.height() != height)
      return Error{Code::corrupt, "a frame of " + size_text(image.width(), image.height()) +
                                      " px arrived for a region of " + size_text(width, height)};
    if (image.bits() != info().bits)
      return Error{Code::corrupt, "a frame of " + std::to_string(image.bits()) +
                                      " bits arrived from a camera of " +
                                      std::to_string(info().bits)};
    return frame;
  });
}

const DisplayInfo& GuardedDisplay::info() const noexcept {
  return last_known<DisplayInfo>(description_);
}

Result<Time> GuardedDisplay::show(const Picture& picture, std::stop_token stop) noexcept {
  constexpr const char* kWhat = "show";
  const Image& image = picture.image;
  if (device_ && (image.empty() || image.width() != info().width_px ||
                  image.height() != info().height_px || image.format() != PixelFormat::mono8))
    return refusal(kWhat, "a picture of " + size_text(image.width(), image.height()) +
                              " px was given; it must be " +
                              size_text(info().width_px, info().height_px) + " px, mono8");
  return call(kWhat, context_.host.clock.now() + kShowAnswer,
              [&](Display& display) { return display.show(picture, std::move(stop)); });
}

const TurntableInfo& GuardedTurntable::info() const noexcept {
  return last_known<TurntableInfo>(description_);
}

Status GuardedTurntable::home(Time deadline, std::stop_token stop) noexcept {
  return call("home", deadline,
              [&](Turntable& table) { return table.home(deadline, std::move(stop)); });
}

Result<double> GuardedTurntable::move_to(double angle_rad, Time deadline,
                                         std::stop_token stop) noexcept {
  constexpr const char* kWhat = "move_to";
  const bool endless = info().min_rad >= info().max_rad;
  if (!std::isfinite(angle_rad) ||
      (!endless && (angle_rad < info().min_rad || angle_rad > info().max_rad)))
    return refusal(kWhat, "angle " + shown(angle_rad) + " rad is outside [" +
                              shown(info().min_rad) + ", " + shown(info().max_rad) + "]");
  return call(kWhat, deadline, [&](Turntable& table) -> Result<double> {
    auto measured = table.move_to(angle_rad, deadline, std::move(stop));
    if (measured && !std::isfinite(*measured))
      return Error{Code::corrupt, "the encoder answered something that is no angle"};
    return measured;
  });
}

void GuardedTurntable::halt() noexcept {
  const std::scoped_lock lock(context_.mutex);
  if (device_) device_->halt();
}

}  // namespace alhazen
