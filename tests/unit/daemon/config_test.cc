#include "daemon/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "drivers/sim/calibrated_rig.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

const fs::path kFolder = ALHAZEN_SOURCE_DIR "/config";

const std::string kDaemon = R"([daemon]
data = "data"
rig = "/etc/rig.json"
plans = "plans"
)";

const std::string kWhole = kDaemon + R"(
[driver.lab]
use = "sim"
world = "w.toml"
[camera.c10]
driver = "lab"
id = "x"
exposure_us = 2500
gain_db = 3
gamma = 1.5
[camera.c2]
driver = "lab"
[display.side]
driver = "lab"
[turntable.plate]
driver = "lab"
)";

Result<Config> parse(const std::string& text) { return Config::parse(text, "/etc/a/rig.toml"); }

/// `text` with the line after [daemon]'s first replaced by `line` put in.
std::string daemon_with(const std::string& line) { return kDaemon + line + "\n"; }

TEST(Config, EverythingIsReadInTheOrderOfTheFile) {
  const auto config = parse(kWhole);
  ASSERT_TRUE(config) << config.error().text();
  EXPECT_EQ(config->data_directory, "/etc/a/data");
  EXPECT_EQ(config->rig_file, "/etc/rig.json");
  EXPECT_EQ(config->plan_folder, "/etc/a/plans");
  EXPECT_EQ(config->driver_folder, "");
  EXPECT_EQ(config->control_endpoint, "ipc:///run/alhazen/control");
  EXPECT_EQ(config->event_endpoint, "ipc:///run/alhazen/events");
  EXPECT_EQ(config->clock, ClockKind::system);
  EXPECT_EQ(config->log_level, Severity::info);
  ASSERT_THAT(config->devices.drivers, SizeIs(1));
  EXPECT_EQ(config->devices.drivers[0].use, "sim");
  EXPECT_EQ(*config->devices.drivers[0].settings.path("world"), "/etc/a/w.toml");
  EXPECT_TRUE(config->devices.drivers[0].settings.all_known());
  ASSERT_THAT(config->devices.cameras, SizeIs(2));
  const DeviceSpec& camera = config->devices.cameras[0];
  EXPECT_EQ(camera.name, "c10");
  EXPECT_EQ(camera.driver, "lab");
  EXPECT_EQ(camera.preferred.exposure, Micros{2500});
  EXPECT_EQ(camera.preferred.gain_db, 3);
  EXPECT_EQ(*camera.settings.text("id"), "x");
  EXPECT_FALSE(camera.settings.has("driver"));
  EXPECT_FALSE(camera.settings.has("exposure_us"));
  EXPECT_EQ(camera.settings.all_known().error().what,
            "/etc/a/rig.toml:14: unknown key 'camera.c10.gamma'");
  EXPECT_EQ(config->devices.cameras[1].name, "c2");
}

/// Whatever a driver or a device finds wrong later is said with the place it was configured at.
TEST(Config, DriversAndDevicesKnowWhereTheyStand) {
  const auto config = parse(kWhole);
  ASSERT_TRUE(config) << config.error().text();
  EXPECT_EQ(config->devices.drivers[0].place, "/etc/a/rig.toml:6");
  EXPECT_EQ(config->devices.cameras[0].place, "/etc/a/rig.toml:9");
  EXPECT_EQ(config->devices.drivers[0].blame({Code::invalid, "no world"}).text(),
            "invalid: no world (/etc/a/rig.toml:6 / driver lab)");
}

TEST(Config, EndpointsStayOnThisMachine) {
  EXPECT_EQ(parse(daemon_with("control = \"ipc://run/c\""))->control_endpoint,
            "ipc:///etc/a/run/c");
  EXPECT_EQ(parse(daemon_with("control = \"tcp://127.0.0.1:5555\""))->control_endpoint,
            "tcp://127.0.0.1:5555");
}

TEST(Config, WordsAreChosenFromTheirList) {
  EXPECT_EQ(parse(daemon_with("clock = \"virtual\""))->clock, ClockKind::virtual_time);
  EXPECT_EQ(parse(daemon_with("log_level = \"debug\""))->log_level, Severity::debug);
}

/// A wrong file and what is said about it.
struct Wrong {
  std::string text;
  const char* said;
};
class WrongConfig : public testing::TestWithParam<Wrong> {};

TEST_P(WrongConfig, IsRefusedWithFileLineKeyAndRange) {
  const auto config = parse(GetParam().text);
  ASSERT_FALSE(config);
  EXPECT_EQ(config.error().code, Code::invalid);
  EXPECT_THAT(config.error().what, HasSubstr(GetParam().said));
  EXPECT_THAT(config.error().what, HasSubstr("/etc/a/rig.toml"));
}

INSTANTIATE_TEST_SUITE_P(
    All, WrongConfig,
    testing::Values(
        Wrong{"", "table [daemon] is missing"},
        Wrong{"daemon = 3\n", "/etc/a/rig.toml:1: table [daemon] is missing"},
        Wrong{"[daemon]\ndata = \n", "/etc/a/rig.toml:2: "},
        Wrong{"[daemon]\nrig = \"r\"\nplans = \"p\"\n",
              "/etc/a/rig.toml:1: key 'daemon.data' is missing"},
        Wrong{daemon_with("colour = 1"), ":5: unknown key 'daemon.colour'"},
        Wrong{"[daemon]\ndata = 5\n", ":2: key 'daemon.data' is 5; it must be text in quotes"},
        Wrong{"[daemon]\ndata = \"\"\n", "it must be a path that is not empty"},
        Wrong{daemon_with("clock = \"fast\""),
              ":5: key 'daemon.clock' is \"fast\"; it must be \"system\" or \"virtual\""},
        Wrong{daemon_with("log_level = \"all\""),
              ":5: key 'daemon.log_level' is \"all\"; it must be debug, info, warning or error"},
        Wrong{daemon_with("control = \"tcp://0.0.0.0:5555\""), ":5: key 'daemon.control'"},
        Wrong{daemon_with("control = \"tcp://127.0.0.1:0\""), "port 1 to 65535"},
        Wrong{daemon_with("control = \"tcp://127.0.0.1:65536\""), "port 1 to 65535"},
        Wrong{daemon_with("control = \"ipc://\""), "ipc://PATH"},
        Wrong{daemon_with("control = \"ipc:///" + std::string(120, 'x') + "\""),
              "a socket's may have at most 107"},
        Wrong{daemon_with("events = \"ipc:///run/alhazen/control\""),
              ":5: 'daemon.events' and 'daemon.control' must be two endpoints"},
        Wrong{kDaemon + "[cameras.left]\n", "unknown key 'cameras'"},
        Wrong{kDaemon + "[camera]\nleft = 3\n", ":6: 'camera.left' must be a table [camera.NAME]"},
        Wrong{"camera = 3\n" + kDaemon, ":1: 'camera' must be tables called [camera.NAME]"},
        Wrong{kDaemon + "[driver.Lab]\nuse = \"sim\"\n",
              ":5: name 'Lab' must be 1 to 32 characters of a-z 0-9 _ -"},
        Wrong{kDaemon + "[driver.lab]\n", ":5: key 'driver.lab.use' is missing"},
        Wrong{kDaemon + "[driver.lab]\nuse = \"../x\"\n", ":6: key 'driver.lab.use' is \"../x\""},
        Wrong{kDaemon + "[camera.c]\nid = \"1\"\n", ":5: key 'camera.c.driver' is missing"},
        Wrong{kDaemon + "[camera.c]\ndriver = \"lab\"\n",
              ":6: key 'camera.c.driver' is \"lab\", but there is no table [driver.lab]"},
        Wrong{kWhole + "[display.c2]\ndriver = \"lab\"\n", "two devices are called 'c2'"},
        Wrong{kWhole + "[turntable.other]\ndriver = \"lab\"\n",
              "a rig has one turntable, here are 2"},
        Wrong{kWhole + "[camera.d]\ndriver = \"lab\"\nexposure_us = 0\n",
              "key 'camera.d.exposure_us' is 0; it must be a whole number in [1, 60000000]"},
        Wrong{kWhole + "[camera.d]\ndriver = \"lab\"\nexposure_us = 1.5\n", "exposure_us"},
        Wrong{kWhole + "[camera.d]\ndriver = \"lab\"\ngain_db = nan\n", "gain_db"},
        Wrong{kWhole + "[camera.d]\ndriver = \"lab\"\nwhen = 2026-11-22\n",
              "key 'camera.d.when' must be true or false, a number, text"},
        Wrong{kWhole + "[camera.d]\ndriver = \"lab\"\nlist = [1, \"a\"]\n",
              "key 'camera.d.list' holds something else than numbers"},
        Wrong{kWhole + "[camera.d.sub]\nx = 1\n", "key 'camera.d.sub' must be true or false"}));

TEST(Config, AFileThatIsTooLargeIsRefused) {
  EXPECT_THAT(parse(kDaemon + std::string(1 << 20, '#')).error().what, HasSubstr("larger than"));
}

/// A folder of its own with a configuration in it.
class LoadConfig : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("alhazen_config_" + std::to_string(getpid()));
    fs::create_directories(folder_ / "plans");
    std::ofstream(folder_ / "rig.json") << "{}";
    write("[daemon]\ndata = \"data\"\nrig = \"rig.json\"\nplans = \"plans\"\n");
  }
  void TearDown() override { fs::remove_all(folder_); }
  void write(const std::string& text) { std::ofstream(folder_ / "a.toml") << text; }
  fs::path folder_;
};

TEST_F(LoadConfig, WhatItNamesMustExist) {
  EXPECT_TRUE(Config::load(folder_ / "a.toml"));
  fs::remove(folder_ / "rig.json");
  EXPECT_EQ(Config::load(folder_ / "a.toml").error().what,
            (folder_ / "a.toml").string() + ":3: key 'daemon.rig' names " +
                (folder_ / "rig.json").string() +
                ", which does not exist; it must be a calibrated rig.json");
  fs::create_directories(folder_ / "rig.json");
  EXPECT_THAT(Config::load(folder_ / "a.toml").error().what,
              HasSubstr("which is something else; it must be a calibrated rig.json"));
  EXPECT_EQ(Config::load(folder_ / "b.toml").error().code, Code::unavailable);
}

TEST_F(LoadConfig, PlansAndDriversMustBeFolders) {
  fs::remove(folder_ / "plans");
  EXPECT_THAT(Config::load(folder_ / "a.toml").error().what, HasSubstr(":4: key 'daemon.plans'"));
  fs::create_directories(folder_ / "plans");
  write("[daemon]\ndata = \"data\"\nrig = \"rig.json\"\nplans = \"plans\"\ndrivers = \"none\"\n");
  EXPECT_THAT(Config::load(folder_ / "a.toml").error().what, HasSubstr(":5: key 'daemon.drivers'"));
}

TEST(Presets, EveryKeyIsRead) {
  const auto preset = parse_preset(R"(summary = "all of it"
angles_deg = [0, 1.5, 90]
displays = ["side"]
cameras = ["c0", "c1"]
coding = "gray"
exposure_us = 5000
gain_db = 1
crop = false
edge_mm = 50
centre_mm = [1, 2, 3.5]
level = 9
keep_frames = "sample"
)",
                                   "/plans/every-key.toml");
  ASSERT_TRUE(preset) << preset.error().text();
  EXPECT_EQ(preset->name, "every-key");
  EXPECT_EQ(preset->summary, "all of it");
  const PlanChoices& choices = preset->choices;
  EXPECT_EQ(choices.stops, std::nullopt);
  EXPECT_THAT(*choices.angles_deg, ElementsAre(0, 1.5, 90));
  EXPECT_THAT(*choices.displays, ElementsAre("side"));
  EXPECT_THAT(*choices.cameras, ElementsAre("c0", "c1"));
  EXPECT_EQ(choices.coding, Coding::gray);
  EXPECT_EQ(choices.exposure, Micros{5000});
  EXPECT_EQ(choices.gain_db, 1);
  EXPECT_EQ(choices.crop, false);
  EXPECT_EQ(choices.edge_mm, 50);
  EXPECT_EQ(*choices.centre_mm, Eigen::Vector3d(1, 2, 3.5));
  EXPECT_EQ(choices.level, 9);
  EXPECT_EQ(choices.keep_frames, KeepFrames::sample);
}

TEST(Presets, WrongOnesAreRefusedWithLineAndRange) {
  const auto said = [](const std::string& line) {
    const auto preset = parse_preset("summary = \"x\"\n" + line + "\n", "/plans/p.toml");
    EXPECT_FALSE(preset) << line;
    return preset.error().what;
  };
  EXPECT_EQ(said("stops = 361"),
            "/plans/p.toml:2: key 'stops' is 361; it must be a whole number in [1, 360]");
  EXPECT_EQ(said("level = 12"),
            "/plans/p.toml:2: key 'level' is 12; it must be a whole number in [4, 11]");
  EXPECT_EQ(said("stop = 3"), "/plans/p.toml:2: unknown key 'stop'");
  EXPECT_EQ(said("keep_frames = \"some\""),
            "/plans/p.toml:2: key 'keep_frames' is \"some\"; it must be one of: none, failed, "
            "sample, all");
  EXPECT_THAT(said("displays = \"side\""), HasSubstr(":2: key 'displays' must be an array"));
  EXPECT_THAT(said("displays = []"), HasSubstr("must be an array of names"));
  EXPECT_THAT(said("cameras = [\"Left\"]"), HasSubstr("must be an array of names"));
  EXPECT_THAT(said("angles_deg = 3"), HasSubstr("'angles_deg' is 3"));
  EXPECT_THAT(said("centre_mm = [1, 2]"), HasSubstr("an array of 3 numbers"));
  EXPECT_THAT(said("stops = [1"), HasSubstr("/plans/p.toml:"));
  EXPECT_THAT(parse_preset("", "/plans/p.toml").error().what, HasSubstr("'summary' is missing"));
  EXPECT_THAT(parse_preset("summary = \"x\"", "/plans/My Plan.toml").error().what,
              HasSubstr("the file's name is the plan's"));
}

/// What is delivered works: configurations and plans of the project's own folder.
TEST(Delivered, PlansAreRead) {
  const auto presets = load_presets(kFolder / "plans");
  ASSERT_TRUE(presets) << presets.error().text();
  std::vector<std::string> names;
  for (const Preset& preset : *presets) names.push_back(preset.name);
  EXPECT_THAT(names, ElementsAre("demo", "fine", "paper", "quick"));
  EXPECT_EQ(load_presets(kFolder / "nowhere").error().code, Code::unavailable);
}

TEST(Delivered, TheExampleOfARealRigIsRead) {
  std::ifstream in(kFolder / "rig.toml");
  const std::string text(std::istreambuf_iterator<char>(in), {});
  const auto config = Config::parse(text, kFolder / "rig.toml");
  ASSERT_TRUE(config) << config.error().text();
  EXPECT_THAT(config->devices.cameras, SizeIs(4));
}

TEST(Delivered, TheSimulatedRigIsCalibratedAsItsWorldStands) {
  const auto config = Config::load(kFolder / "sim.toml");
  ASSERT_TRUE(config) << config.error().text();
  const auto rig = Rig::load(config->rig_file);
  ASSERT_TRUE(rig) << rig.error().text();
  std::vector<std::string> cameras, displays, names;
  for (const CameraModel& camera : rig->cameras) cameras.push_back(camera.name);
  for (const DisplayModel& display : rig->displays) displays.push_back(display.name);
  for (const DeviceSpec& spec : config->devices.cameras) names.push_back(spec.name);
  EXPECT_EQ(names, cameras);
  names.clear();
  for (const DeviceSpec& spec : config->devices.displays) names.push_back(spec.name);
  EXPECT_EQ(names, displays);

  const auto world = config->devices.drivers[0].settings.path("world");
  const auto scene = sim::Scene::load(*world, {});
  ASSERT_TRUE(scene) << scene.error().text();
  std::ifstream in(config->rig_file);
  const std::string stored(std::istreambuf_iterator<char>(in), {});
  EXPECT_TRUE(stored == sim::calibrated_rig(*scene, {}))
      << "write it again: alhazen-world rig " << *world << " --out " << config->rig_file;
}

TEST(CheckClock, VirtualTimeNeedsDriversThatKeepToIt) {
  const auto entry_of = [](const char* name, bool virtual_time) {
    return AlhazenDriverEntry{
        kDriverAbi,
        ALHAZEN_DRIVER_BUILD,
        name,
        "",
        virtual_time,
        [](const Host&, const Settings&) noexcept -> Result<std::unique_ptr<Driver>> {
          return Error{Code::unsupported, "nothing"};
        }};
  };
  const AlhazenDriverEntry patient = entry_of("patient", true), real = entry_of("real", false);
  Loader loader("");
  ASSERT_TRUE(loader.adopt(patient));
  ASSERT_TRUE(loader.adopt(real));
  auto config = parse(daemon_with("clock = \"virtual\"") + "[driver.a]\nuse = \"patient\"\n");
  EXPECT_TRUE(check_clock(*config, loader));
  config = parse(daemon_with("clock = \"virtual\"") +
                 "[driver.a]\nuse = \"patient\"\n[driver.b]\nuse = \"real\"\n");
  const auto refused = check_clock(*config, loader);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::invalid);
  EXPECT_THAT(refused.error().what, HasSubstr("driver b (real) moves real devices"));
  config->clock = ClockKind::system;
  EXPECT_TRUE(check_clock(*config, loader));
}

}  // namespace
}  // namespace alhazen
