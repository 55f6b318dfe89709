// Whatever ends the daemon, what is safe stays safe, and the scan goes on to the same result.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>

#include "daemon/control/verbs.h"
#include "tests/support/daemon.h"

namespace alhazen::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// A program of the build, with its output in a file.
class Program {
 public:
  Program(const std::string& name, std::vector<std::string> arguments, const fs::path& output,
          std::vector<std::string> environment = {}) {
    const std::string path = ALHAZEN_BINARY_DIR "/bin/" + name;
    std::vector<char*> argv = {const_cast<char*>(path.c_str())};
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);
    std::vector<char*> envp;
    for (char** variable = environ; *variable != nullptr; ++variable) envp.push_back(*variable);
    for (std::string& variable : environment) envp.push_back(variable.data());
    envp.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 1, output.c_str(), O_WRONLY | O_CREAT | O_TRUNC,
                                     0644);
    posix_spawn_file_actions_adddup2(&actions, 1, 2);
    EXPECT_EQ(posix_spawn(&pid_, path.c_str(), &actions, nullptr, argv.data(), envp.data()), 0);
    posix_spawn_file_actions_destroy(&actions);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;
  ~Program() {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      wait();
    }
  }

  void send(int signal) const { kill(pid_, signal); }
  /// Its exit code; 128 + signal where it died of one.
  int wait() {
    int status = 0;
    EXPECT_EQ(waitpid(pid_, &status, 0), pid_);
    pid_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

 private:
  pid_t pid_ = 0;
};

std::string contents(const fs::path& file) {
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

void wait_until_ready(TestClient& client) {
  for (int i = 0; i < 600; ++i) {
    const std::string reply = client.raw(R"({"v":1,"id":"w","verb":"status"})");
    if (!reply.empty() && Json::parse(reply)["ok"]["ready"] == true) return;
    static_cast<void>(client.event(std::chrono::milliseconds(50)));
  }
  FAIL() << "the daemon is not ready";
}

TEST(Restart, AStoppedScanGoesOnInAnotherDaemon) {
  const TestSite site;
  for (const std::size_t k : {1U, 7U, 17U}) {
    Json submitted;
    {
      TestDaemon daemon(site);
      TestClient client = daemon.client();
      submitted = client.ask("scan.submit", small_scan());
      std::size_t light_maps = 0;
      ASSERT_TRUE(client.until([&](const Json& event) {
        return event["topic"] == "scan.light_map" && ++light_maps == k;
      }));
      client.ask("job.stop", {{"job", submitted["job"]}});
      EXPECT_EQ(client.await_end(submitted["job"])["state"], "interrupted");
    }
    const std::size_t safe = results_of(site.scan(submitted["scan"])).size() - 1;
    EXPECT_GE(safe, k);
    TestDaemon daemon(site);
    TestClient client = daemon.client();
    client.ask("job.resume", {{"job", submitted["job"]}});
    const Json job = client.await_end(submitted["job"]);
    EXPECT_EQ(job["state"], "done") << job.dump(1);
    EXPECT_EQ(job["result"]["capture"]["skipped"], safe);
    EXPECT_TRUE(results_of(site.scan(submitted["scan"])) == undisturbed_results()) << k;
  }
}

TEST(Restart, ShutdownWhileScanningKeepsTheScan) {
  const TestSite site;
  std::string id;
  {
    TestDaemon daemon(site);
    TestClient client = daemon.client();
    id = client.ask("scan.submit", small_scan())["job"];
    ASSERT_TRUE(client.until([](const Json& event) { return event["topic"] == "scan.light_map"; }));
    EXPECT_TRUE(client.ask("service.shutdown")["stopping"]);
    EXPECT_EQ(client.reply("scan.submit", tiny_scan())["error"]["code"], "conflict");
    const Status ended = daemon.end();
    EXPECT_TRUE(ended) << ended.error().text();
  }
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  EXPECT_EQ(client.ask("job.get", {{"job", id}})["job"]["state"], "interrupted");
  client.ask("job.resume", {{"job", id}});
  EXPECT_EQ(client.await_end(id)["state"], "done");
}

TEST(Restart, TheIndexIsMadeAgainFromTheScanDirectories) {
  const TestSite site;
  Json jobs, scans;
  {
    TestDaemon daemon(site);
    TestClient client = daemon.client();
    const Json scan = client.ask("scan.submit", tiny_scan());
    client.await_end(scan["job"]);
    client.await_end(client.ask("reconstruct.submit", {{"scan", scan["scan"]}})["job"]);
    const std::string aborted = client.ask("scan.submit", small_scan())["job"];
    ASSERT_TRUE(client.until([](const Json& event) { return event["topic"] == "scan.light_map"; }));
    client.ask("job.abort", {{"job", aborted}});
    client.await_end(aborted);
    jobs = client.ask("job.list");
    scans = client.ask("scan.list");
    EXPECT_EQ(jobs["total"], 3);
    EXPECT_EQ(scans["total"], 2);
  }
  for (const char* suffix : {"", "-wal", "-shm"})
    fs::remove(site.data() / (std::string("index.sqlite") + suffix));
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  EXPECT_EQ(client.ask("job.list"), jobs);
  EXPECT_EQ(client.ask("scan.list"), scans);
  // Numbers are not given twice.
  const Json next = client.ask("scan.submit", tiny_scan());
  EXPECT_EQ(next["job"], "j4");
  EXPECT_EQ(next["scan"], "0003-sphere");
  client.await_end(next["job"]);
}

TEST(Restart, TwoDaemonsDoNotShareADirectoryNorASocket) {
  const TestSite site;
  TestDaemon daemon(site);
  const auto second = open_app(site);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, Code::conflict);
  EXPECT_THAT(second.error().what, HasSubstr("another daemon"));

  // Another directory, but the same socket.
  const TestSite other;
  Program alhazend("alhazend",
                   {"--config", other.config_file(), "--endpoint", site.control_endpoint()},
                   other.folder() / "log");
  EXPECT_EQ(alhazend.wait(), 75);
  EXPECT_THAT(contents(other.folder() / "log"), HasSubstr("another daemon listens"));
  // The first one has not noticed anything.
  EXPECT_TRUE(daemon.client().ask("status")["live"]);
}

/// The service manager's socket, as sd_notify(3) speaks to it.
class NotifySocket {
 public:
  explicit NotifySocket(const fs::path& file) : fd_(socket(AF_UNIX, SOCK_DGRAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    file.string().copy(address.sun_path, sizeof address.sun_path - 1);
    EXPECT_EQ(bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;
  ~NotifySocket() { close(fd_); }
  /// Everything that was said so far, one message a line.
  std::string said() {
    std::array<char, 4096> message{};
    while (true) {
      const ssize_t length = recv(fd_, message.data(), message.size(), MSG_DONTWAIT);
      if (length <= 0) return said_;
      said_ += std::string(message.data(), static_cast<std::size_t>(length)) + "\n";
    }
  }

 private:
  int fd_;
  std::string said_;
};

TEST(Restart, SigtermEndsTheRealDaemonInOrder) {
  const TestSite site;
  NotifySocket manager(site.folder() / "notify");
  Program alhazend(
      "alhazend", {"--config", site.config_file(), "--log", "info"}, site.folder() / "log",
      {"NOTIFY_SOCKET=" + (site.folder() / "notify").string(), "WATCHDOG_USEC=2000000"});
  TestClient client(site.control_endpoint(), site.event_endpoint());
  wait_until_ready(client);
  const std::string id = client.ask("scan.submit", small_scan())["job"];
  ASSERT_TRUE(client.until([](const Json& event) { return event["topic"] == "scan.light_map"; }));
  alhazend.send(SIGTERM);
  EXPECT_EQ(alhazend.wait(), 0) << contents(site.folder() / "log");
  const std::string said = manager.said();
  for (const char* word : {"READY=1", "STATUS=running", "STOPPING=1", "WATCHDOG=1"})
    EXPECT_THAT(said, HasSubstr(word));
  EXPECT_FALSE(fs::exists(site.folder() / "run" / "control"));

  TestDaemon daemon(site);
  EXPECT_EQ(daemon.client().ask("job.get", {{"job", id}})["job"]["state"], "interrupted");
}

TEST(Restart, AKilledDaemonGoesOnToTheSameResult) {
  const TestSite site;
  Json submitted;
  {
    Program alhazend("alhazend", {"--config", site.config_file()}, site.folder() / "log");
    TestClient client(site.control_endpoint(), site.event_endpoint());
    wait_until_ready(client);
    submitted = client.ask("scan.submit", small_scan());
    std::size_t light_maps = 0;
    ASSERT_TRUE(client.until([&](const Json& event) {
      return event["topic"] == "scan.light_map" && ++light_maps == 5;
    }));
    alhazend.send(SIGKILL);
    EXPECT_EQ(alhazend.wait(), 128 + SIGKILL);
  }
  // Its sockets and its lock are left over; neither is in the way.
  EXPECT_TRUE(fs::exists(site.folder() / "run" / "control"));
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json found = client.ask("job.get", {{"job", submitted["job"]}})["job"];
  EXPECT_EQ(found["state"], "interrupted");
  EXPECT_THAT(found["error"]["what"].get<std::string>(), HasSubstr("ended while the job ran"));
  client.ask("job.resume", {{"job", submitted["job"]}});
  EXPECT_EQ(client.await_end(submitted["job"])["state"], "done");
  EXPECT_TRUE(results_of(site.scan(submitted["scan"])) == undisturbed_results());
}

TEST(Restart, TheClientTellsWhatBecomesOfAScan) {
  const TestSite site;
  TestDaemon daemon(site);
  const auto ctl = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--endpoint", site.control_endpoint()});
    Program alhazenctl("alhazenctl", std::move(arguments), site.folder() / "ctl");
    const int code = alhazenctl.wait();
    return std::pair(code, contents(site.folder() / "ctl"));
  };
  const auto [done, text] = ctl({"scan", "submit", "sphere", "--plan-stops", "3", "--level", "6",
                                 "--volume-edge-mm", "26", "--watch"});
  EXPECT_EQ(done, 0) << text;
  for (const char* word : {"steps", "decode", "vote", "surface", "done", "mesh.ply"})
    EXPECT_THAT(text, HasSubstr(word));
  EXPECT_EQ(text.find('\x1b'), std::string::npos) << "no terminal, no bars";

  const auto [json_code, json_text] = ctl({"job", "get", "j1", "--json"});
  EXPECT_EQ(json_code, 0);
  EXPECT_EQ(Json::parse(json_text)["job"]["state"], "done");
  EXPECT_EQ(ctl({"job", "get", "j9"}).first, 64);
  EXPECT_EQ(ctl({"job", "abort", "j1"}).first, 75);
  EXPECT_EQ(ctl({"scan", "submit", "x", "--level", "99"}).first, 64);
  EXPECT_EQ(ctl({"no", "verb"}).first, 64);
  EXPECT_THAT(ctl({"scan", "submit", "x", "--level", "99"}).second, HasSubstr("[4, 11]"));
  // Flags that cannot be parsed are told as JSON, too.
  const auto [wrong_code, wrong_text] = ctl({"job", "get", "--json"});
  EXPECT_EQ(wrong_code, 64);
  EXPECT_EQ(Json::parse(wrong_text)["error"]["code"], "invalid");
  Program nobody("alhazenctl", {"ping", "--endpoint", "ipc:///nowhere/control"},
                 site.folder() / "ctl");
  EXPECT_EQ(nobody.wait(), 69);
  EXPECT_THAT(contents(site.folder() / "ctl"), HasSubstr("is alhazend running"));
}

TEST(Restart, TheClientCompletesOnlyWhatItAccepts) {
  const TestSite site;
  const auto told = [&](std::vector<std::string> arguments) {
    Program alhazenctl("alhazenctl", std::move(arguments), site.folder() / "ctl");
    EXPECT_EQ(alhazenctl.wait(), 0);
    return contents(site.folder() / "ctl");
  };
  const std::string script = told({"completion", "bash"});
  for (const Verb& verb : verbs()) {
    const std::string group(verb.group()), word(verb.word());
    const std::size_t row = script.find("'" + group + " " + word + " ')");
    const std::size_t alias = script.find("'" + group + " " + word + " '|");
    const std::size_t at = std::min(row, alias);
    ASSERT_NE(at, std::string::npos) << verb.name;
    const std::size_t begin = script.find("words='", at) + 7;
    std::istringstream words(script.substr(begin, script.find('\'', begin) - begin));
    const std::string help = told({group, word, "--help"});
    for (std::string one; words >> one;) EXPECT_THAT(help, HasSubstr(one)) << verb.name;
  }
  EXPECT_THAT(script, HasSubstr("completion hello ping status config"));
}

TEST(Restart, AWrongConfigurationEndsTheDaemonWithFileLineAndKey) {
  const TestSite site;
  const auto refused = [&](const std::string& from, const std::string& to) {
    std::string text = contents(site.config_file());
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, from.size(), to);
    // Beside the right one, so that what it names is found.
    const fs::path wrong = site.folder() / "wrong.toml";
    std::ofstream(wrong) << text;
    Program alhazend("alhazend", {wrong}, site.folder() / "log");
    EXPECT_EQ(alhazend.wait(), 64) << from;
    const std::size_t line = 1 + static_cast<std::size_t>(std::count(
                                     text.begin(), text.begin() + static_cast<long>(at), '\n'));
    return std::pair(contents(site.folder() / "log"), wrong.string() + ":" + std::to_string(line));
  };
  const auto [clock, clock_at] = refused("clock = \"virtual\"", "clock = \"fast\"");
  EXPECT_THAT(clock, HasSubstr(clock_at + ": key 'daemon.clock' is \"fast\"; it must be"));
  const auto [world, world_at] = refused("[driver.lab]\nuse = \"sim\"\nworld = \"world.toml\"",
                                         "[driver.lab]\nuse = \"sim\"\nworld = \"no.toml\"");
  EXPECT_THAT(world, HasSubstr("key 'world' names"));
  EXPECT_THAT(world, HasSubstr("(" + world_at + " / driver lab)"));
  const auto [id, id_at] = refused("[camera.c1]\ndriver = \"lab\"\nid = \"c1\"",
                                   "[camera.c1]\ndriver = \"lab\"\nid = \"c7\"");
  EXPECT_THAT(id, HasSubstr("it has c0, c1, c2"));
  EXPECT_THAT(id, HasSubstr(id_at + " / camera c1"));
}

}  // namespace
}  // namespace alhazen::testing
