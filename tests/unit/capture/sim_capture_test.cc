#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <optional>

#include "daemon/capture/capture.h"
#include "daemon/virtual_clock.h"
#include "drivers/sim/calibrated_rig.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

const std::string kDrivers = ALHAZEN_BINARY_DIR "/lib";

class Silent final : public Log {
 public:
  void write(Severity, std::string_view) noexcept override {}
};

/// Claims that the picture is steady the moment it is handed over.
class HastyDisplay final : public Display {
 public:
  HastyDisplay(std::unique_ptr<Display> inner, Clock& clock)
      : inner_(std::move(inner)), clock_(clock) {}
  [[nodiscard]] const DisplayInfo& info() const noexcept override { return inner_->info(); }
  Result<Time> show(const Picture& picture, std::stop_token stop) noexcept override {
    ALHAZEN_TRY(inner_->show(picture, std::move(stop)));
    return clock_.now();
  }
  [[nodiscard]] Readings readings() const noexcept override { return inner_->readings(); }

 private:
  std::unique_ptr<Display> inner_;
  Clock& clock_;
};

/// Comes back at once, while the table turns on.
class HastyTurntable final : public Turntable {
 public:
  HastyTurntable(std::unique_ptr<Turntable> inner, Clock& clock)
      : inner_(std::move(inner)), clock_(clock) {}
  [[nodiscard]] const TurntableInfo& info() const noexcept override { return inner_->info(); }
  Status home(Time deadline, std::stop_token stop) noexcept override {
    return inner_->home(deadline, std::move(stop));
  }
  Result<double> move_to(double angle_rad, Time /*deadline*/,
                         std::stop_token stop) noexcept override {
    const auto measured = inner_->move_to(angle_rad, clock_.now(), std::move(stop));
    if (!measured && measured.error().code != Code::timeout) return measured.error();
    return angle_rad;
  }
  void halt() noexcept override { inner_->halt(); }
  [[nodiscard]] Readings readings() const noexcept override { return inner_->readings(); }

 private:
  std::unique_ptr<Turntable> inner_;
  Clock& clock_;
};

/// The simulated rig with devices that do not let the sequencer wait: keys hasty_display and
/// hasty_table, the others are the sim driver's.
class HastyDriver final : public Driver {
 public:
  HastyDriver(std::unique_ptr<Driver> inner, Clock& clock, bool display, bool table)
      : inner_(std::move(inner)), clock_(clock), display_(display), table_(table) {}
  Result<std::vector<Found>> find() noexcept override { return inner_->find(); }
  Result<std::unique_ptr<Camera>> open_camera(const Settings& settings) noexcept override {
    return inner_->open_camera(settings);
  }
  Result<std::unique_ptr<Display>> open_display(const Settings& settings) noexcept override {
    auto display = ALHAZEN_TRY(inner_->open_display(settings));
    if (!display_) return display;
    return std::unique_ptr<Display>(std::make_unique<HastyDisplay>(std::move(display), clock_));
  }
  Result<std::unique_ptr<Turntable>> open_turntable(const Settings& settings) noexcept override {
    auto table = ALHAZEN_TRY(inner_->open_turntable(settings));
    if (!table_) return table;
    return std::unique_ptr<Turntable>(std::make_unique<HastyTurntable>(std::move(table), clock_));
  }

 private:
  std::unique_ptr<Driver> inner_;
  Clock& clock_;
  const bool display_, table_;
};

const AlhazenDriverEntry kHasty{
    kDriverAbi,
    ALHAZEN_DRIVER_BUILD,
    "hasty",
    "the simulated rig, hastily",
    true,
    [](const Host& host, const Settings& settings) noexcept -> Result<std::unique_ptr<Driver>> {
      Loader loader(kDrivers);
      const AlhazenDriverEntry* sim = ALHAZEN_TRY(loader.load("sim"));
      const bool display = ALHAZEN_TRY(settings.flag_or("hasty_display", false));
      const bool table = ALHAZEN_TRY(settings.flag_or("hasty_table", false));
      return std::unique_ptr<Driver>(std::make_unique<HastyDriver>(
          ALHAZEN_TRY(sim->open(host, settings)), host.clock, display, table));
    }};

using Maps = std::map<StackKey, std::shared_ptr<const LightMap>>;

/// The small world, its sphere beside the axis: turned about its own centre it would look the same.
void write_world(const fs::path& file, double ambient) {
  std::ifstream in(ALHAZEN_SOURCE_DIR "/config/worlds/small.toml");
  std::string text(std::istreambuf_iterator<char>(in), {});
  const std::string table = "[turntable]\n";
  const auto at = text.find(table);
  ASSERT_NE(at, std::string::npos);
  text.insert(at + table.size(), "point_mm = [6.0, 0.0, 0.0]\n");
  text.insert(at, "[ambient]\nradiance = " + std::to_string(ambient) + "\n");
  std::ofstream(file) << text;
}

struct Taken {
  Maps maps;
  Status outcome;
  std::vector<std::string> warnings;
  std::uint64_t steps = 0;
};

/// A scan of that world by two cameras at two stops.
Taken take(bool hasty_display, bool hasty_table, double ambient) {
  const fs::path folder =
      fs::temp_directory_path() / ("alhazen_sim_capture_" + std::to_string(getpid()));
  fs::remove_all(folder);
  fs::create_directories(folder);
  const std::string world_file = folder / "world.toml";
  write_world(world_file, ambient);
  VirtualClock clock;
  Silent log;
  Loader loader(kDrivers);
  EXPECT_TRUE(loader.adopt(kHasty));
  const auto scene = sim::Scene::load(world_file, {});
  EXPECT_TRUE(scene) << scene.error().text();
  const auto rig = Rig::parse(sim::calibrated_rig(*scene, {}));
  EXPECT_TRUE(rig) << rig.error().text();

  DeviceSpecs specs;
  Settings world("test", "driver.lab", "");
  world.set("world", world_file);
  world.set("hasty_display", hasty_display);
  world.set("hasty_table", hasty_table);
  specs.drivers.push_back({"lab", "hasty", world});
  const auto spec = [](const std::string& name, bool with_id) {
    Settings settings("test", name, "");
    if (with_id) settings.set("id", name);
    return DeviceSpec{name, "lab", settings, {}};
  };
  for (const CameraModel& camera : rig->cameras) specs.cameras.push_back(spec(camera.name, true));
  for (const DisplayModel& display : rig->displays)
    specs.displays.push_back(spec(display.name, true));
  specs.turntables.push_back(spec("plate", false));
  auto devices = DeviceSet::open(specs, loader, Host{clock, log});
  EXPECT_TRUE(devices) << devices.error().text();

  ScanRequest request;
  request.object_id = "sphere";
  request.choices.angles_deg = {0, 20};
  request.choices.cameras = {"c0", "c1"};
  request.choices.edge_mm = 40;
  const auto plan =
      make_plan(request, {}, *rig, facts_of(**devices), {"s", "2026-11-22T00:00:00Z", "test"});
  EXPECT_TRUE(plan) << plan.error().text();
  auto directory = Scan::create(folder / "scan", *plan, *rig);
  EXPECT_TRUE(directory) << directory.error().text();
  Taken taken;
  CaptureHooks hooks;
  hooks.on_light_map = [&](std::shared_ptr<const LightMap> map) {
    taken.maps[map->key] = std::move(map);
  };
  hooks.on_warning = [&](const std::string& sentence) { taken.warnings.push_back(sentence); };
  hooks.on_step = [&](const CaptureProgress&) { ++taken.steps; };
  Hold hold;
  const auto captured = capture_scan(*directory, **devices, clock, {}, hold, hooks, {});
  if (!captured) taken.outcome = captured.error();
  fs::remove_all(folder);
  return taken;
}

constexpr double kDark = 0.002;

Maps scan(bool hasty_display, bool hasty_table) {
  Taken taken = take(hasty_display, hasty_table, kDark);
  EXPECT_TRUE(taken.outcome) << taken.outcome.error().text();
  return std::move(taken.maps);
}

/// Where a light map has a sensor's pixel; nothing beyond its region.
std::optional<std::size_t> index_in(const LightMap& map, int x, int y) {
  const Region& region = map.region;
  if (x < region.x || y < region.y || x >= region.x + region.width ||
      y >= region.y + region.height) {
    return std::nullopt;
  }
  return static_cast<std::size_t>(y - region.y) * static_cast<std::size_t>(region.width) +
         static_cast<std::size_t>(x - region.x);
}

/// Share of the pixels with a position in `right` that `other` does not see there to 2 px. Their
/// regions differ: each is cropped to what decoded.
double share_wrong(const LightMap& right, const LightMap& other) {
  std::size_t positions = 0, wrong = 0;
  for (int y = right.region.y; y < right.region.y + right.region.height; ++y) {
    for (int x = right.region.x; x < right.region.x + right.region.width; ++x) {
      const std::size_t i = *index_in(right, x, y);
      if (!right.is_position(i)) continue;
      ++positions;
      const auto k = index_in(other, x, y);
      if (!k || !other.is_position(*k) ||
          std::hypot(right.u_px[i] - other.u_px[*k], right.v_px[i] - other.v_px[*k]) > 2)
        ++wrong;
    }
  }
  EXPECT_GT(positions, 100U);
  return static_cast<double>(wrong) / static_cast<double>(positions);
}

class SimCaptureTest : public testing::Test {
 protected:
  static const Maps& right() {
    static const Maps maps = scan(false, false);
    return maps;
  }
};

TEST_F(SimCaptureTest, AllStacksAreDecodedAndRepeatExactly) {
  ASSERT_EQ(right().size(), 2U * 2U * 2U);
  const Maps again = scan(false, false);
  ASSERT_EQ(again.size(), right().size());
  for (const auto& [key, map] : right()) {
    EXPECT_EQ(share_wrong(*map, *again.at(key)), 0) << key.stop << key.display << key.camera;
    EXPECT_EQ(map->angle_rad, again.at(key)->angle_rad);
  }
}

/// The sequencer waits for nothing but what devices tell it. Where a display tells it wrongly, that
/// is a sequencer that does not wait; the light maps must show it.
TEST_F(SimCaptureTest, NotWaitingForTheDisplayMakesTheDataWrong) {
  const Maps hasty = scan(true, false);
  for (const auto& [key, map] : right()) {
    ASSERT_TRUE(hasty.count(key));
    EXPECT_GT(share_wrong(*map, *hasty.at(key)), 0.5) << key.stop << key.display << key.camera;
  }
}

TEST_F(SimCaptureTest, NotWaitingForTheTableMakesTheDataWrong) {
  const Maps hasty = scan(false, true);
  // The first display of the second stop is shown while the table turns there.
  for (const std::string camera : {"c0", "c1"}) {
    const StackKey key{1, "side", camera};
    ASSERT_TRUE(right().count(key) && hasty.count(key));
    EXPECT_GT(share_wrong(*right().at(key), *hasty.at(key)), 0.5) << camera;
  }
}

TEST_F(SimCaptureTest, ADarkRoomIsNotSpokenOf) {
  const Taken taken = take(false, false, kDark);
  EXPECT_TRUE(taken.outcome);
  EXPECT_THAT(taken.warnings, testing::IsEmpty());
}

TEST_F(SimCaptureTest, AmbientLightIsWarnedOfOnceACamera) {
  const Taken taken = take(false, false, 0.3);
  EXPECT_TRUE(taken.outcome) << taken.outcome.error().text();
  EXPECT_THAT(taken.warnings,
              testing::UnorderedElementsAre(
                  testing::AllOf(testing::HasSubstr("camera c0 sees"),
                                 testing::HasSubstr("with all displays black (at most 10 %)")),
                  testing::HasSubstr("camera c1 sees")));
}

TEST_F(SimCaptureTest, ABrightRoomEndsTheScanBeforeItBegan) {
  const Taken taken = take(false, false, 0.9);
  ASSERT_FALSE(taken.outcome);
  EXPECT_EQ(taken.outcome.error().code, Code::conflict);
  EXPECT_THAT(taken.outcome.error().text(), testing::HasSubstr("(at most 50 %)"));
  EXPECT_LE(taken.steps, 1U);
  EXPECT_THAT(taken.maps, testing::IsEmpty());
}

}  // namespace
}  // namespace alhazen
