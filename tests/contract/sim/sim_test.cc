// The contract suites on every device of the simulated rig, loaded as the daemon loads it, in
// virtual time; and what its scripted faults do.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "daemon/devices/loader.h"
#include "daemon/virtual_clock.h"
#include "tests/contract/camera_contract.h"
#include "tests/contract/display_contract.h"
#include "tests/contract/turntable_contract.h"

namespace alhazen::contract {
namespace {

class Silent final : public Log {
 public:
  void write(Severity /*severity*/, std::string_view /*line*/) noexcept override {}
};

/// A simulated rig of its own, with faults appended to the small world.
class Rig {
 public:
  explicit Rig(const std::string& faults = "") {
    std::ostringstream world;
    world << std::ifstream(ALHAZEN_SOURCE_DIR "/config/worlds/small.toml").rdbuf() << faults;
    static int count = 0;
    file_ = std::filesystem::path(testing::TempDir()) /
            ("contract-" + std::to_string(getpid()) + "-" + std::to_string(++count) + ".toml");
    std::ofstream(file_) << world.str();
    Settings settings("test", "driver.lab", "");
    settings.set("world", file_.string());
    const auto entry = loader_.load("sim");
    EXPECT_TRUE(entry) << entry.error().text();
    auto opened = (*entry)->open({clock_, log_}, settings);
    EXPECT_TRUE(opened) << opened.error().text();
    EXPECT_TRUE(settings.all_known());
    driver_ = *std::move(opened);
  }
  ~Rig() { std::filesystem::remove(file_); }
  Rig(const Rig&) = delete;
  Rig& operator=(const Rig&) = delete;

  [[nodiscard]] VirtualClock& clock() { return clock_; }
  [[nodiscard]] Driver& driver() { return *driver_; }
  [[nodiscard]] Result<std::unique_ptr<Camera>> camera(const std::string& id) {
    return driver_->open_camera(with_id(id));
  }
  [[nodiscard]] Result<std::unique_ptr<Display>> display(const std::string& id) {
    return driver_->open_display(with_id(id));
  }
  [[nodiscard]] Result<std::unique_ptr<Turntable>> turntable() {
    return driver_->open_turntable(Settings());
  }

 private:
  static Settings with_id(const std::string& id) {
    Settings settings("test", "device", "");
    settings.set("id", id);
    return settings;
  }

  Loader loader_{std::filesystem::path(ALHAZEN_BINARY_DIR) / "lib"};
  VirtualClock clock_;
  Silent log_;
  std::filesystem::path file_;
  std::unique_ptr<Driver> driver_;
};

/// One rig for all subjects: a device is closed before it is opened again.
Rig& shared() {
  static Rig rig;
  return rig;
}

Subject<Camera> camera(const std::string& id) {
  return {id, [id] { return shared().camera(id); }, &shared().clock()};
}
Subject<Display> display(const std::string& id) {
  return {id, [id] { return shared().display(id); }, &shared().clock()};
}

const auto name_of_subject = [](const auto& info) { return info.param.name; };
INSTANTIATE_TEST_SUITE_P(Sim, CameraContract, testing::Values(camera("c0"), camera("c2")),
                         name_of_subject);
INSTANTIATE_TEST_SUITE_P(Sim, DisplayContract, testing::Values(display("side"), display("above")),
                         name_of_subject);
INSTANTIATE_TEST_SUITE_P(Sim, TurntableContract,
                         testing::Values(Subject<Turntable>{
                             "turntable", [] { return shared().turntable(); }, &shared().clock()}),
                         name_of_subject);

TEST(SimDriver, FindsAndOpensItsDevicesOnceEach) {
  Rig rig;
  const auto found = rig.driver().find();
  ASSERT_TRUE(found);
  EXPECT_EQ(found->size(), 6U);
  auto first = rig.camera("c1");
  ASSERT_TRUE(first);
  EXPECT_EQ(text_of(code_of(rig.camera("c1"))), "unavailable");
  (*first).reset();
  EXPECT_TRUE(rig.camera("c1"));
  const auto unknown = rig.camera("c7");
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, Code::invalid);
  EXPECT_THAT(unknown.error().what, testing::HasSubstr("c0, c1, c2"));
}

TEST(SimDriver, RefusesAWrongWorld) {
  Loader loader{std::filesystem::path(ALHAZEN_BINARY_DIR) / "lib"};
  VirtualClock clock;
  Silent log;
  Settings settings("rig.toml", "driver.lab", "");
  const auto open = [&] { return code_of((*loader.load("sim"))->open({clock, log}, settings)); };
  EXPECT_EQ(text_of(open()), "invalid");
  settings.set("world", std::string("/nowhere.toml"));
  const auto nowhere = (*loader.load("sim"))->open({clock, log}, settings);
  ASSERT_FALSE(nowhere);
  EXPECT_EQ(nowhere.error().text(),
            "invalid: key 'world' names /nowhere.toml, which does not exist; it must be a file");
  settings.set("world", std::string(ALHAZEN_SOURCE_DIR "/config/worlds/small.toml"));
  EXPECT_EQ(text_of(open()), "success");
  settings.set("object_mesh", std::string("/nowhere.ply"));  // the small world has a sphere
  EXPECT_EQ(text_of(open()), "invalid");
}

std::string fault(const std::string& device, const std::string& on, int call,
                  const std::string& kind, bool once) {
  return "\n[[fault]]\ndevice = \"" + device + "\"\n" +
         (on.empty() ? "" : "on = \"" + on + "\"\n") + "call = " + std::to_string(call) +
         "\nkind = \"" + kind + "\"\nonce = " + (once ? "true" : "false") + "\n";
}

/// Codes of `count` frames taken one after the other.
std::vector<std::string> take(Rig& rig, Camera& camera, int count,
                              std::vector<Frame>* frames = nullptr) {
  std::vector<std::string> out;
  for (int i = 0; i < count; ++i) {
    const auto ends = camera.trigger();
    if (!ends) {
      out.push_back("trigger: " + text_of(code_of(ends)));
      continue;
    }
    const auto frame = camera.wait_frame(rig.clock().now() + std::chrono::milliseconds(300), {});
    out.push_back(text_of(code_of(frame)));
    if (frame && frames != nullptr) frames->push_back(*frame);
  }
  return out;
}

TEST(SimFaults, CameraMisbehavesAsScripted) {
  using Codes = std::vector<std::string>;
  const struct {
    const char *on, *kind;
    bool once;
    Codes expected;
  } rows[] = {
      {"wait_frame", "timeout", true, {"success", "timeout", "success"}},
      {"", "corrupt", true, {"success", "corrupt", "success"}},
      {"", "corrupt", false, {"success", "corrupt", "corrupt"}},
      {"", "stale", true, {"success", "success", "success"}},
      {"wait_frame",
       "slow",
       true,
       {"success", "timeout", "success"}},  // half a second, the deadline is 0.3 s
      {"wait_frame", "lost", true, {"success", "unavailable", "trigger: unavailable"}},
      {"trigger", "timeout", true, {"success", "trigger: timeout", "success"}},
      {"trigger",
       "lost_for_good",
       true,
       {"success", "trigger: unavailable", "trigger: unavailable"}},
  };
  for (const auto& row : rows) {
    SCOPED_TRACE(std::string(row.kind) + " on " + row.on);
    Rig rig(fault("c0", row.on, 2, row.kind, row.once));
    auto camera = rig.camera("c0");
    ASSERT_TRUE(camera);
    std::vector<Frame> frames;
    EXPECT_EQ(take(rig, **camera, 3, &frames), row.expected);
    if (std::string(row.kind) == "stale") {
      ASSERT_EQ(frames.size(), 3U);
      EXPECT_EQ(frames[1].device_counter, frames[0].device_counter);
      EXPECT_EQ(frames[1].exposure_begin, frames[0].exposure_begin);
      EXPECT_GT(frames[2].device_counter, frames[1].device_counter);
    }
    // Other devices do not notice.
    auto other = rig.camera("c1");
    ASSERT_TRUE(other);
    EXPECT_EQ(take(rig, **other, 2), Codes({"success", "success"}));
    const bool gone = std::string(row.kind) == "lost_for_good";
    (*camera).reset();
    EXPECT_EQ(text_of(code_of(rig.camera("c0"))), gone ? "unavailable" : "success");
  }
}

TEST(SimFaults, DisplayAndTurntableMisbehaveAsScripted) {
  Rig rig(fault("side", "", 2, "timeout", true) + fault("above", "", 1, "lost", true) +
          fault("turntable", "move_to", 1, "timeout", true) +
          fault("turntable", "move_to", 3, "slow", true));
  auto side = rig.display("side");
  auto above = rig.display("above");
  auto table = rig.turntable();
  ASSERT_TRUE(side && above && table);
  const Picture picture{
      Image::copy<std::uint8_t>(128, 96, 8, std::vector<std::uint8_t>(std::size_t{128} * 96, 9)),
      std::nullopt};
  EXPECT_TRUE((*side)->show(picture, {}));
  EXPECT_EQ(text_of(code_of((*side)->show(picture, {}))), "timeout");
  EXPECT_TRUE((*side)->show(picture, {}));
  EXPECT_EQ(text_of(code_of((*above)->show(picture, {}))), "unavailable");
  (*above).reset();
  EXPECT_TRUE(rig.display("above"));
  const auto later = [&] { return rig.clock().now() + std::chrono::minutes(1); };
  ASSERT_TRUE((*table)->home(later(), {}));
  EXPECT_EQ(text_of(code_of((*table)->move_to(1, later(), {}))), "timeout");
  EXPECT_TRUE((*table)->move_to(1, later(), {}));
  const Time before = rig.clock().now();
  EXPECT_TRUE((*table)->move_to(1, later(), {}));
  EXPECT_EQ(rig.clock().now() - before, Micros(500'000));
}

}  // namespace
}  // namespace alhazen::contract
