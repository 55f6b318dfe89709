#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "alhazen/result.h"
#include "daemon/config.h"
#include "daemon/devices/loader.h"
#include "daemon/service.h"

namespace alhazen {

/// The whole daemon: builds its parts in order, runs the control thread's loop, takes them down in
/// the reverse order.
///
/// Thread: open() and run() belong to one thread, the control thread; shut_down() is thread-safe.
class App {
 public:
  struct Options {
    Signals* signals = nullptr;  ///< watched by run(); null: nobody sends any (tests)
    /// How long an orderly end may take. After it the process ends at once, with the name of who
    /// held it up in the log: what is safe stays safe, scans resume.
    std::chrono::seconds shutdown_deadline{90};
  };

  /// Takes the data directory, reads rig and plans, binds the sockets, finds what was there.
  /// Fails: as Config, Loader, Rig, Server and Jobs; conflict where another daemon has the data
  ///        directory or an endpoint.
  [[nodiscard]] static Result<std::unique_ptr<App>> open(Config config, Loader loader,
                                                         Options options);
  App(const App&) = delete;
  App& operator=(const App&) = delete;
  ~App();

  /// Serves until asked to end. Fails: as opening the devices did.
  Status run();

  /// Asks run() to end in order. Thread-safe.
  void shut_down() noexcept;

  [[nodiscard]] std::string control_endpoint() const;
  [[nodiscard]] std::string event_endpoint() const;

 private:
  struct State;
  explicit App(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

/// "0.1.0": CMake's project version.
[[nodiscard]] std::string software_version();

}  // namespace alhazen
