#include "tests/support/daemon.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <iterator>
#include <utility>

#include "daemon/config.h"
#include "drivers/sim/calibrated_rig.h"

namespace alhazen::testing {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

/// Nothing here takes longer on the slowest machine under a sanitizer; whoever waits so long has
/// found a defect.
constexpr milliseconds kPatience{60'000};

std::string contents(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

TestClient::TestClient(const std::string& control_endpoint, const std::string& event_endpoint) {
  control_.set(zmq::sockopt::linger, 0);
  events_.set(zmq::sockopt::linger, 0);
  events_.set(zmq::sockopt::rcvhwm, 0);
  events_.set(zmq::sockopt::subscribe, "");
  control_.connect(control_endpoint);
  events_.connect(event_endpoint);
}

std::string TestClient::raw(std::string_view bytes) {
  control_.send(zmq::buffer(bytes), zmq::send_flags::none);
  zmq::pollitem_t item{control_.handle(), 0, ZMQ_POLLIN, 0};
  if (zmq_poll(&item, 1, static_cast<long>(kPatience.count())) <= 0) return {};
  zmq::message_t reply;
  if (!control_.recv(reply, zmq::recv_flags::dontwait)) return {};
  return reply.to_string();
}

void TestClient::send_parts(const std::vector<std::string>& parts) {
  for (std::size_t i = 0; i < parts.size(); ++i)
    control_.send(zmq::buffer(parts[i]),
                  i + 1 < parts.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
}

Json TestClient::reply(std::string_view verb, const Json& args, const std::string& idem) {
  const std::string id = "t" + std::to_string(++asked_);
  Json request = {{"v", 1}, {"id", id}, {"verb", std::string(verb)}, {"args", args}};
  if (!idem.empty()) request["idem"] = idem;
  const std::string text = raw(request.dump());
  EXPECT_FALSE(text.empty()) << verb << ": no answer";
  if (text.empty()) return {{"error", {{"code", "timeout"}, {"what", "no answer"}}}};
  Json answer = Json::parse(text);
  EXPECT_EQ(answer["id"], id) << verb;
  return answer;
}

Json TestClient::ask(std::string_view verb, const Json& args) {
  Json answer = reply(verb, args);
  EXPECT_TRUE(answer.contains("ok")) << verb << " " << args.dump() << ": " << answer.dump();
  return answer.contains("ok") ? answer["ok"] : Json::object();
}

std::optional<Json> TestClient::event(milliseconds at_most) {
  zmq::pollitem_t item{events_.handle(), 0, ZMQ_POLLIN, 0};
  if (zmq_poll(&item, 1, static_cast<long>(at_most.count())) <= 0) return std::nullopt;
  zmq::message_t topic, text;
  if (!events_.recv(topic, zmq::recv_flags::dontwait) || !topic.more() ||
      !events_.recv(text, zmq::recv_flags::dontwait))
    return std::nullopt;
  Json parsed = Json::parse(text.to_string_view());
  EXPECT_EQ(parsed["topic"], topic.to_string());
  return parsed;
}

bool TestClient::until(const std::function<bool(const Json& event)>& wanted) {
  const auto deadline = steady_clock::now() + kPatience;
  while (steady_clock::now() < deadline)
    if (const auto next = event(milliseconds(200)); next && wanted(*next)) return true;
  return false;
}

Json TestClient::await_end(const std::string& job,
                           const std::function<void(const Json& event)>& seen) {
  const auto is_over = [](const Json& state) {
    for (const char* end : {"done", "done_with_gaps", "failed", "cancelled", "interrupted"})
      if (state == end) return true;
    return false;
  };
  const auto deadline = steady_clock::now() + 2 * kPatience;
  while (steady_clock::now() < deadline) {
    const auto next = event(milliseconds(100));
    if (next && seen) seen(*next);
    if (next && !((*next)["topic"] == "job.state" && (*next)["body"]["id"] == job &&
                  is_over((*next)["body"]["state"])))
      continue;
    Json now = ask("job.get", {{"job", job}})["job"];
    if (is_over(now["state"])) return now;
  }
  ADD_FAILURE() << "job " << job << " does not end: " << ask("status").dump(1);
  return ask("job.get", {{"job", job}})["job"];
}

TestSite::TestSite(const std::string& faults) {
  static std::atomic<int> number{0};
  folder_ = fs::temp_directory_path() / ("alhazen_flow_" + std::to_string(getpid()) + "_" +
                                         std::to_string(number.fetch_add(1)));
  fs::remove_all(folder_);
  fs::create_directories(folder_ / "plans");
  std::ofstream(folder_ / "plans" / "two.toml") << "summary = \"two stops\"\nstops = 2\n";
  set_faults(faults);
  const auto scene = sim::Scene::load(folder_ / "world.toml", {});
  EXPECT_TRUE(scene) << scene.error().text();
  std::ofstream(folder_ / "rig.json") << sim::calibrated_rig(*scene, {});
  std::ofstream config(config_file());
  config << "[daemon]\ndata = \"data\"\nrig = \"rig.json\"\nplans = \"plans\"\n"
         << "preview = \"preview\"\nclock = \"virtual\"\nlog_level = \"error\"\n"
         << "drivers = \"" << ALHAZEN_BINARY_DIR << "/lib\"\n"
         << "control = \"" << control_endpoint() << "\"\nevents = \"" << event_endpoint() << "\"\n"
         << "[driver.lab]\nuse = \"sim\"\nworld = \"world.toml\"\n";
  for (const auto& camera : scene->cameras)
    config << "[camera." << camera.id << "]\ndriver = \"lab\"\nid = \"" << camera.id << "\"\n";
  for (const auto& display : scene->displays)
    config << "[display." << display.id << "]\ndriver = \"lab\"\nid = \"" << display.id << "\"\n";
  config << "[turntable.plate]\ndriver = \"lab\"\n";
}

TestSite::~TestSite() {
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

void TestSite::set_faults(const std::string& faults) const {
  std::ofstream(folder_ / "world.toml")
      << contents(ALHAZEN_SOURCE_DIR "/config/worlds/small.toml") << "\n"
      << faults;
}

std::string TestSite::control_endpoint() const {
  return "ipc://" + (folder_ / "run" / "control").string();
}
std::string TestSite::event_endpoint() const {
  return "ipc://" + (folder_ / "run" / "events").string();
}

Result<std::unique_ptr<App>> open_app(const TestSite& site) {
  Config config = ALHAZEN_TRY(Config::load(site.config_file()));
  Loader loader(config.driver_folder);
  return App::open(std::move(config), std::move(loader), {});
}

TestDaemon::TestDaemon(const TestSite& site) : site_(site) {
  auto opened = open_app(site);
  EXPECT_TRUE(opened) << opened.error().text();
  if (!opened) return;
  app_ = *std::move(opened);
  thread_ = std::jthread([this] { ended_ = app_->run(); });
  TestClient waiting = client();
  const auto deadline = steady_clock::now() + kPatience;
  while (steady_clock::now() < deadline && !waiting.ask("status").value("ready", false))
    static_cast<void>(waiting.event(milliseconds(20)));
}

TestDaemon::~TestDaemon() {
  if (!app_) return;
  const Status ended = end();
  EXPECT_TRUE(ended) << ended.error().text();
}

Status TestDaemon::end() {
  if (!app_) return ended_;
  app_->shut_down();
  if (thread_.joinable()) thread_.join();
  app_.reset();
  return ended_;
}

TestClient TestDaemon::client() const { return {site_.control_endpoint(), site_.event_endpoint()}; }

Json small_scan() {
  return {{"object", {{"id", "sphere"}}},
          {"plan", {{"stops", 3}}},
          {"volume", {{"edge_mm", 26}}},
          {"level", 5}};
}

Json tiny_scan() {
  return {{"object", {{"id", "sphere"}}},
          {"plan", {{"stops", 2}, {"displays", {"above"}}, {"cameras", {"c0", "c1"}}}},
          {"volume", {{"edge_mm", 26}}},
          {"level", 4}};
}

const std::map<std::string, std::string>& undisturbed_results() {
  static const std::map<std::string, std::string> kResults = [] {
    const TestSite site;
    TestDaemon daemon(site);
    TestClient client = daemon.client();
    const Json submitted = client.ask("scan.submit", small_scan());
    const Json job = client.await_end(submitted["job"]);
    EXPECT_EQ(job["state"], "done") << job.dump(1);
    return results_of(site.scan(submitted["scan"]));
  }();
  return kResults;
}

std::size_t thread_count() {
  const fs::directory_iterator tasks("/proc/self/task");
  return static_cast<std::size_t>(std::distance(begin(tasks), end(tasks)));
}

std::map<std::string, std::string> results_of(const fs::path& scan) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::directory_iterator(scan / "light_maps"))
    files[entry.path().filename().string()] = contents(entry.path());
  files["mesh.ply"] = contents(scan / "mesh.ply");
  return files;
}

}  // namespace alhazen::testing
