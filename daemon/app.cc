#include "daemon/app.h"

#include <fcntl.h>
#include <sys/eventfd.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <system_error>
#include <thread>
#include <utility>

#include "daemon/control/commands.h"
#include "daemon/control/events.h"
#include "daemon/control/server.h"
#include "daemon/jobs/jobs.h"
#include "daemon/log.h"
#include "daemon/system_clock.h"
#include "daemon/virtual_clock.h"

namespace alhazen {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
namespace fs = std::filesystem;

/// Events that are kept for readers that missed some: some minutes of a scan.
constexpr std::size_t kKeptEvents = 20'000;

/// The data directory is one daemon's at a time. The lock ends with the process, however it ends.
class DirectoryLock {
 public:
  static Result<DirectoryLock> take(const fs::path& directory) {
    std::error_code error;
    fs::create_directories(directory, error);
    if (error)
      return Error{Code::unavailable,
                   "cannot make '" + directory.string() + "': " + error.message()};
    const fs::path file = directory / "lock";
    DirectoryLock lock(::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640));
    if (lock.fd_ < 0)
      return Error{Code::unavailable, "'" + file.string() + "': " + std::strerror(errno)};
    if (flock(lock.fd_, LOCK_EX | LOCK_NB) == 0) {
      const std::string mine = std::to_string(getpid()) + "\n";
      // For people only: the lock itself is what counts.
      if (ftruncate(lock.fd_, 0) == 0)
        static_cast<void>(pwrite(lock.fd_, mine.data(), mine.size(), 0) > 0);
      return lock;
    }
    if (errno != EWOULDBLOCK)
      return Error{Code::unavailable, "'" + file.string() + "': " + std::strerror(errno)};
    std::array<char, 32> holder{};
    const ssize_t length = pread(lock.fd_, holder.data(), holder.size() - 1, 0);
    std::string who(holder.data(), length > 0 ? static_cast<std::size_t>(length) : 0);
    while (!who.empty() && who.back() == '\n') who.pop_back();
    return Error{Code::conflict, "another daemon" + (who.empty() ? "" : " (process " + who + ")") +
                                     " uses '" + directory.string() + "'"};
  }
  DirectoryLock(DirectoryLock&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  DirectoryLock& operator=(DirectoryLock&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~DirectoryLock() {
    if (fd_ >= 0) close(fd_);
  }

 private:
  explicit DirectoryLock(int fd) noexcept : fd_(fd) {}
  int fd_;
};

std::string new_epoch() {
  std::random_device random;
  constexpr char kDigits[] = "0123456789abcdef";
  std::string epoch;
  for (int i = 0; i < 16; ++i) epoch += kDigits[random() % 16];
  return epoch;
}

json shown(const Config& config) {
  const auto devices = [](const std::vector<DeviceSpec>& specs) {
    json rows = json::object();
    for (const DeviceSpec& spec : specs) rows[spec.name] = {{"driver", spec.driver}};
    return rows;
  };
  json drivers = json::object();
  for (const DriverSpec& driver : config.devices.drivers)
    drivers[driver.name] = {{"use", driver.use}};
  json cameras = devices(config.devices.cameras);
  for (const DeviceSpec& spec : config.devices.cameras)
    cameras[spec.name].update(
        {{"exposure_us", spec.preferred.exposure.count()}, {"gain_db", spec.preferred.gain_db}});
  return {{"file", config.file.string()},
          {"data_directory", config.data_directory.string()},
          {"rig_file", config.rig_file.string()},
          {"plan_folder", config.plan_folder.string()},
          {"driver_folder", config.driver_folder.string()},
          {"preview_directory", config.preview_directory.string()},
          {"control_endpoint", config.control_endpoint},
          {"event_endpoint", config.event_endpoint},
          {"clock", config.clock == ClockKind::system ? "system" : "virtual"},
          {"drivers", std::move(drivers)},
          {"cameras", std::move(cameras)},
          {"displays", devices(config.devices.displays)},
          {"turntables", devices(config.devices.turntables)}};
}

/// House §8: two cores stay free for the cameras while real devices run; simulated ones leave
/// nothing to wait for.
int arena_threads(const Config& config) {
  const int cores = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  for (const DriverSpec& driver : config.devices.drivers)
    if (driver.use != "sim") return std::max(1, cores - 2);
  return cores;
}

}  // namespace

struct App::State {
  State(Config given, Options wanted, DirectoryLock taken)
      : config(std::move(given)),
        options(wanted),
        lock(std::move(taken)),
        log(config.log_level),
        wake(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    ALHAZEN_CHECK(wake >= 0);
    if (config.clock == ClockKind::virtual_time)
      clock = std::make_unique<VirtualClock>();
    else
      clock = std::make_unique<SystemClock>();
  }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() { close(wake); }

  void publish(std::string_view topic, const json& body) {
    server->publish(events.add(topic, body));
  }
  void say_state();
  /// Refuses new work from now on and begins to close; what runs is kept. Once.
  void end() {
    if (deadline) return;
    deadline = steady_clock::now() + options.shutdown_deadline;
    service.stopping();
    jobs->close();
  }

  const Config config;
  const Options options;
  DirectoryLock lock;
  StderrLog log;
  std::unique_ptr<Clock> clock;
  Service service;
  const int wake;
  std::optional<steady_clock::time_point> deadline;  ///< of ending, once it has begun
  bool was_ready = false;
  std::string state;
  Counters counters;
  EventLog events{new_epoch(), kKeptEvents};
  std::unique_ptr<Server> server;
  std::unique_ptr<Jobs> jobs;
  std::optional<Commands> commands;
};

App::App(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}
App::~App() = default;

Result<std::unique_ptr<App>> App::open(Config config, Loader loader, Options options) {
  // Whatever can be wrong with drivers, rig and plans is said before anything is touched.
  for (const DriverSpec& driver : config.devices.drivers)
    if (const auto entry = loader.load(driver.use); !entry) return driver.blame(entry.error());
  ALHAZEN_TRY(check_clock(config, loader));
  Site site;
  site.rig = ALHAZEN_TRY(Rig::load(config.rig_file).in("rig file " + config.rig_file.string()));
  site.presets = ALHAZEN_TRY(load_presets(config.plan_folder));
  site.data_directory = config.data_directory;
  site.preview_directory = config.preview_directory;
  site.rig_file = config.rig_file;
  site.software_version = software_version();
  site.arena_threads = arena_threads(config);

  DirectoryLock lock = ALHAZEN_TRY(DirectoryLock::take(config.data_directory));
  auto state = std::make_unique<State>(std::move(config), options, std::move(lock));
  State& app = *state;
  app.server = ALHAZEN_TRY(Server::open(app.config.control_endpoint, app.config.event_endpoint));
  auto room = std::make_unique<RigRoom>(app.config.devices, std::move(loader), *app.clock, app.log);
  app.jobs = ALHAZEN_TRY(
      Jobs::open(std::move(site), std::move(room), app.log,
                 [&app](std::string_view topic, const json& body) { app.publish(topic, body); }));
  app.commands.emplace(*app.jobs, app.events, app.counters,
                       Commands::Daemon{software_version(), app.server->event_endpoint(),
                                        std::make_shared<const json>(shown(app.config)),
                                        [&app](Severity level) { app.log.set_level(level); },
                                        [&app] { app.end(); }});
  return std::unique_ptr<App>(new App(std::move(state)));
}

Status App::run() {
  State& app = *state_;
  app.log.write(Severity::info, "alhazend " + software_version() + " at " + control_endpoint());
  app.jobs->open_devices();
  const std::vector<int> fds = {app.wake, app.jobs->event_fd(),
                                app.options.signals ? app.options.signals->fd() : app.wake};
  const Server::Answer answer = [&app](std::string_view request) {
    return app.commands->answer(request);
  };
  milliseconds sleep{0};
  while (!app.jobs->closed()) {
    if (app.service.feed_every().count() > 0) sleep = std::min(sleep, app.service.feed_every());
    const std::vector<bool> readable = ALHAZEN_TRY(app.server->wait(fds, sleep, answer));
    if (readable[0]) app.end();
    if (app.options.signals && readable[2]) {
      app.log.write(Severity::info, "ending by " + app.options.signals->take());
      app.end();
    }
    app.jobs->take_events();
    if (app.jobs->fault()) app.end();
    sleep = app.jobs->tick();
    app.counters.dropped = app.server->dropped();
    app.counters.replies_lost = app.server->replies_lost();
    app.say_state();
    if (const std::string silent = app.jobs->silent_lane(); silent.empty())
      app.service.feed();
    else
      app.service.status("no sign of life: " + silent);
    if (app.deadline && steady_clock::now() > *app.deadline) {
      app.log.write(Severity::error, "not ended in time, waiting for " + app.jobs->waiting_for() +
                                         "; ending at once");
      std::_Exit(70);
    }
  }
  app.say_state();
  app.log.write(Severity::info, "ended");
  if (app.jobs->fault()) return *app.jobs->fault();
  return {};
}

void App::State::say_state() {
  std::string now = commands->state();
  if (!was_ready && jobs->devices() != nullptr) {
    was_ready = true;
    service.ready();
    log.write(Severity::info,
              "ready: " + std::to_string(jobs->devices()->describe().size()) + " devices");
  }
  if (now == state) return;
  state = std::move(now);
  service.status(state);
  publish("daemon.state", {{"state", state}});
}

void App::shut_down() noexcept {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto written = write(state_->wake, &one, sizeof one);
}

std::string App::control_endpoint() const { return state_->server->control_endpoint(); }
std::string App::event_endpoint() const { return state_->server->event_endpoint(); }

std::string software_version() { return ALHAZEN_VERSION; }

}  // namespace alhazen
