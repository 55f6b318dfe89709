#include "daemon/devices/device_set.h"

#include <algorithm>
#include <set>
#include <utility>

#include "daemon/devices/guard.h"

namespace alhazen {
namespace {

/// One open driver instance.
struct OpenDriver {
  DriverSpec spec;
  std::unique_ptr<Driver> driver;
};

template <class Guards>
auto* find_guard(const Guards& guards, std::string_view name) {
  const auto found = std::find_if(guards.begin(), guards.end(),
                                  [&](const auto& guard) { return guard->name() == name; });
  return found == guards.end() ? nullptr : found->get();
}

DeviceDescription blank(DeviceKind kind, const DeviceSpec& spec, const OpenDriver& driver) {
  DeviceDescription description;
  description.kind = kind;
  description.name = spec.name;
  description.driver = driver.spec.name;
  description.use = driver.spec.use;
  description.camera_settings = spec.preferred;
  if (kind == DeviceKind::display) description.info = DisplayInfo{};
  if (kind == DeviceKind::turntable) description.info = TurntableInfo{};
  return description;
}

}  // namespace

struct DeviceSet::State {
  explicit State(const Host& host) : context(host) {}

  GuardContext context;
  std::vector<DeviceSpec> cameras_specs, displays_specs, turntables_specs;
  // Declared before the devices: they are destroyed before their drivers.
  std::vector<std::unique_ptr<OpenDriver>> drivers;
  std::vector<std::unique_ptr<GuardedCamera>> cameras;
  std::vector<std::unique_ptr<GuardedDisplay>> displays;
  std::vector<std::unique_ptr<GuardedTurntable>> turntables;

  /// Makes a guard for every spec and opens what is behind it.
  template <class Device, class GuardedDevice>
  Status open_all(DeviceKind kind, const std::vector<DeviceSpec>& specs,
                  Result<std::unique_ptr<Device>> (Driver::*open)(const Settings&) noexcept,
                  std::vector<std::unique_ptr<GuardedDevice>>& guards) {
    for (const DeviceSpec& spec : specs) {
      const std::string label = std::string(name_of(kind)) + " " + spec.name;
      const auto driver = std::find_if(drivers.begin(), drivers.end(), [&](const auto& candidate) {
        return candidate->spec.name == spec.driver;
      });
      if (driver == drivers.end())
        return Error{Code::invalid, label + ": there is no [driver." + spec.driver + "]"};
      guards.push_back(std::make_unique<GuardedDevice>(
          context, blank(kind, spec, **driver),
          [&spec, open, owner = driver->get()]() -> Result<std::unique_ptr<Device>> {
            auto device = (owner->driver.get()->*open)(spec.settings);
            if (device) ALHAZEN_TRY(spec.settings.all_known());
            return device;
          }));
      const Status opened = guards.back()->reopen();
      if (opened) continue;
      const Code code = opened.error().code;
      if (code == Code::invalid || code == Code::unsupported || code == Code::internal)
        return spec.place.empty() ? opened.error() : opened.error().in(spec.place);
      context.host.log.write(Severity::warning, opened.error().text());
    }
    return {};
  }

  template <class Visit>
  void for_each(Visit visit) const {
    for (const auto& guard : cameras) visit(*guard);
    for (const auto& guard : displays) visit(*guard);
    for (const auto& guard : turntables) visit(*guard);
  }
};

DeviceSet::DeviceSet(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}

DeviceSet::~DeviceSet() { halt_all(); }

Result<std::unique_ptr<DeviceSet>> DeviceSet::open(const DeviceSpecs& specs, Loader& loader,
                                                   const Host& host) {
  std::set<std::string> names;
  for (const auto* list : {&specs.cameras, &specs.displays, &specs.turntables})
    for (const DeviceSpec& spec : *list)
      if (!names.insert(spec.name).second)
        return Error{Code::invalid, "two devices are called '" + spec.name + "'"};
  if (specs.turntables.size() > 1)
    return Error{Code::invalid, "turntable " + specs.turntables[1].name +
                                    ": a rig has one turntable, " +
                                    std::to_string(specs.turntables.size()) + " are configured"};

  auto state = std::make_unique<State>(host);
  for (const DriverSpec& spec : specs.drivers) {
    const auto entry = loader.load(spec.use);
    if (!entry) return spec.blame(entry.error());
    auto open = std::make_unique<OpenDriver>();
    open->spec = spec;
    auto driver = (*entry)->open(state->context.host, open->spec.settings);
    if (!driver) return spec.blame(driver.error());
    open->driver = *std::move(driver);
    if (const Status known = open->spec.settings.all_known(); !known)
      return spec.blame(known.error());
    state->drivers.push_back(std::move(open));
  }
  state->cameras_specs = specs.cameras;
  state->displays_specs = specs.displays;
  state->turntables_specs = specs.turntables;
  ALHAZEN_TRY(state->open_all(DeviceKind::camera, state->cameras_specs, &Driver::open_camera,
                              state->cameras));
  ALHAZEN_TRY(state->open_all(DeviceKind::display, state->displays_specs, &Driver::open_display,
                              state->displays));
  ALHAZEN_TRY(state->open_all(DeviceKind::turntable, state->turntables_specs,
                              &Driver::open_turntable, state->turntables));
  return std::unique_ptr<DeviceSet>(new DeviceSet(std::move(state)));
}

void DeviceSet::bind_to_this_thread() noexcept {
  state_->context.owner.store(std::this_thread::get_id(), std::memory_order_relaxed);
}

Camera* DeviceSet::camera(std::string_view name) const { return find_guard(state_->cameras, name); }
Display* DeviceSet::display(std::string_view name) const {
  return find_guard(state_->displays, name);
}
Turntable* DeviceSet::turntable(std::string_view name) const {
  return find_guard(state_->turntables, name);
}
Turntable* DeviceSet::turntable() const {
  return state_->turntables.empty() ? nullptr : state_->turntables.front().get();
}

std::vector<std::string> DeviceSet::names(DeviceKind kind) const {
  std::vector<std::string> names;
  const auto collect = [&](const auto& guards) {
    for (const auto& guard : guards) names.push_back(guard->name());
  };
  if (kind == DeviceKind::camera) collect(state_->cameras);
  if (kind == DeviceKind::display) collect(state_->displays);
  if (kind == DeviceKind::turntable) collect(state_->turntables);
  return names;
}

CameraSettings DeviceSet::preferred_settings(std::string_view camera) const {
  for (const DeviceSpec& spec : state_->cameras_specs)
    if (spec.name == camera) return spec.preferred;
  return {};
}

Status DeviceSet::reopen(std::string_view name) {
  if (auto* guard = find_guard(state_->cameras, name)) return guard->reopen();
  if (auto* guard = find_guard(state_->displays, name)) return guard->reopen();
  if (auto* guard = find_guard(state_->turntables, name)) return guard->reopen();
  return Error{Code::invalid, "there is no device '" + std::string(name) + "'"};
}

void DeviceSet::halt_all() noexcept {
  for (const auto& guard : state_->turntables) guard->halt();
}

void DeviceSet::refresh_readings() {
  state_->for_each([](auto& guard) { guard.refresh_readings(); });
}

std::vector<DeviceDescription> DeviceSet::describe() const {
  std::vector<DeviceDescription> all;
  state_->for_each([&](const auto& guard) { all.push_back(guard.describe()); });
  return all;
}

std::optional<CallInProgress> DeviceSet::call_in_progress() const {
  const std::scoped_lock lock(state_->context.mutex);
  return state_->context.in_progress;
}

bool DeviceSet::all_ready() const {
  bool ready = true;
  state_->for_each(
      [&](const auto& guard) { ready = ready && guard.describe().state == DeviceState::ready; });
  return ready;
}

}  // namespace alhazen
