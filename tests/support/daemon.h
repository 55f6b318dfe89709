#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>
#include <zmq.hpp>

#include "daemon/app.h"

namespace alhazen::testing {

using Json = nlohmann::json;

/// A client of its own, on purpose: it shares nothing with alhazenctl and can send anything.
/// Thread-bound.
class TestClient {
 public:
  TestClient(const std::string& control_endpoint, const std::string& event_endpoint);

  /// Sends these bytes and waits for what comes back. An empty answer: none came within 20 s.
  std::string raw(std::string_view bytes);
  /// Sends parts as they are, waits for nothing.
  void send_parts(const std::vector<std::string>& parts);

  /// A whole reply: has "ok" or "error".
  Json reply(std::string_view verb, const Json& args = Json::object(),
             const std::string& idem = {});
  /// The `ok` of a reply; fails the test with the error otherwise.
  Json ask(std::string_view verb, const Json& args = Json::object());

  /// The next event, whole; nothing within `at_most`.
  std::optional<Json> event(std::chrono::milliseconds at_most);
  /// Reads events until `wanted` says so; false after 60 s without one that does.
  bool until(const std::function<bool(const Json& event)>& wanted);
  /// Waits for a job's end; the job as job.get shows it. Events that pass are given to `seen`.
  Json await_end(const std::string& job,
                 const std::function<void(const Json& event)>& seen = nullptr);

 private:
  zmq::context_t context_{1};
  zmq::socket_t control_{context_, zmq::socket_type::dealer};
  zmq::socket_t events_{context_, zmq::socket_type::sub};
  std::uint64_t asked_ = 0;
};

/// A folder of its own with world, rig and configuration of config/worlds/small.toml; goes with
/// everything in it.
class TestSite {
 public:
  /// `faults`: TOML appended to the world file.
  explicit TestSite(const std::string& faults = {});
  TestSite(const TestSite&) = delete;
  TestSite& operator=(const TestSite&) = delete;
  ~TestSite();

  [[nodiscard]] const std::filesystem::path& folder() const { return folder_; }
  [[nodiscard]] std::filesystem::path config_file() const { return folder_ / "rig.toml"; }
  [[nodiscard]] std::filesystem::path data() const { return folder_ / "data"; }
  [[nodiscard]] std::filesystem::path scan(const std::string& id) const {
    return data() / "scans" / id;
  }
  [[nodiscard]] std::string control_endpoint() const;
  [[nodiscard]] std::string event_endpoint() const;
  void set_faults(const std::string& faults) const;

 private:
  std::filesystem::path folder_;
};

/// The whole daemon on a thread of this process, on the simulated rig in virtual time.
class TestDaemon {
 public:
  /// Starts it and waits until it is ready. Fails the test where it does not start.
  explicit TestDaemon(const TestSite& site);
  TestDaemon(const TestDaemon&) = delete;
  TestDaemon& operator=(const TestDaemon&) = delete;
  /// Ends it in order.
  ~TestDaemon();

  /// Asks it to end and waits for that; what run() said.
  Status end();
  [[nodiscard]] TestClient client() const;

 private:
  const TestSite& site_;
  std::unique_ptr<App> app_;
  Status ended_;
  std::jthread thread_;
};

/// Starts an App on a site without running it. Fails: as App::open().
[[nodiscard]] Result<std::unique_ptr<App>> open_app(const TestSite& site);

/// Arguments of the quickest scan of the small world that ends in a mesh.
[[nodiscard]] Json small_scan();
/// Of one that is over sooner, and fails for want of a surface: for what happens before.
[[nodiscard]] Json tiny_scan();

/// What small_scan() gives where nothing disturbs it; made once in a process.
[[nodiscard]] const std::map<std::string, std::string>& undisturbed_results();

/// Threads of this process.
[[nodiscard]] std::size_t thread_count();

/// Every file of a scan directory that must be equal whatever happened on the way: light maps and
/// mesh.ply, by name.
[[nodiscard]] std::map<std::string, std::string> results_of(const std::filesystem::path& scan);

}  // namespace alhazen::testing
