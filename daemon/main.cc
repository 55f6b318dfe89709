// alhazend: flags, configuration, App, exit code.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <string>
#include <system_error>

#include "daemon/app.h"
#include "daemon/base/exit_code.h"
#include "daemon/config.h"
#include "daemon/control/message.h"
#include "daemon/log.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

struct Flags {
  std::string config = "/etc/alhazen/rig.toml", data, endpoint, events, log, drivers;
  bool check = false;
};

/// Where drivers lie when nobody said so: ../lib/alhazen of the executable where it is installed,
/// ../lib of a build.
fs::path default_driver_folder() {
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  if (error) return "/usr/lib/alhazen";
  const fs::path lib = self.parent_path().parent_path() / "lib";
  return fs::is_directory(lib / "alhazen", error) ? lib / "alhazen" : lib;
}

Status serve(const Flags& flags) {
  // Before any thread begins, so that all of them leave these signals to the control thread.
  Signals signals = ALHAZEN_TRY(Signals::open());
  Config config = ALHAZEN_TRY(Config::load(flags.config));
  if (!flags.data.empty()) config.data_directory = fs::absolute(flags.data);
  if (!flags.endpoint.empty()) config.control_endpoint = flags.endpoint;
  if (!flags.events.empty()) config.event_endpoint = flags.events;
  if (!flags.log.empty()) config.log_level = ALHAZEN_TRY(severity_of(flags.log).in("--log"));
  if (!flags.drivers.empty()) config.driver_folder = fs::absolute(flags.drivers);
  if (config.driver_folder.empty()) config.driver_folder = default_driver_folder();
  if (flags.check) {
    std::printf("%s is right\n", flags.config.c_str());
    return {};
  }
  Loader loader(config.driver_folder);
  const auto app = ALHAZEN_TRY(App::open(std::move(config), std::move(loader), {&signals}));
  return app->run();
}

int run(int argc, char** argv) {
  Flags flags;
  CLI::App cli{
      "alhazend: scans mirror-like objects with the cameras, displays and turntable of a rig.\n"
      "Clients (alhazenctl) speak to it over its control socket. Ends in order on SIGTERM or\n"
      "SIGINT: a running scan is kept and can be resumed.",
      "alhazend"};
  cli.set_version_flag("--version", software_version());
  cli.add_option("-c,--config,config", flags.config, "configuration of the rig (TOML)")
      ->capture_default_str();
  cli.add_option("--data", flags.data, "directory of scans and index, instead of the configured");
  cli.add_option("--endpoint", flags.endpoint, "control socket, instead of the configured");
  cli.add_option("--events", flags.events, "event socket, instead of the configured");
  cli.add_option("--drivers", flags.drivers, "folder of alhazen-*.so, instead of the configured");
  cli.add_option("--log", flags.log, "least severity: debug, info, warning, error");
  cli.add_flag("--check", flags.check, "judge the configuration and end");
  cli.footer(
      "Exit codes: 0 ended in order; 64 wrong flags or configuration; 69 a file, driver or\n"
      "endpoint is not there; 74 disk or memory; 75 another daemon is at work; 70 a bug.");
  try {
    cli.parse(argc, argv);
  } catch (const CLI::Success& success) {
    return cli.exit(success);
  } catch (const CLI::ParseError& error) {
    std::fprintf(stderr, "alhazend: %s\nalhazend --help tells the flags\n", error.what());
    return exit_code(Code::invalid);
  }
  const Status served = serve(flags);
  if (served) return 0;
  std::fprintf(stderr, "alhazend: %s\n", served.error().text().c_str());
  return exit_code(served.error().code);
}

}  // namespace
}  // namespace alhazen

int main(int argc, char** argv) { return alhazen::run(argc, argv); }
