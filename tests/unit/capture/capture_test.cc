#include "daemon/capture/capture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <set>
#include <thread>

#include "daemon/capture/preview.h"
#include "daemon/virtual_clock.h"
#include "reconstruct/scan/image_file.h"
#include "tests/support/fake_devices.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class Silent final : public Log {
 public:
  void write(Severity, std::string_view) noexcept override {}
};

/// A whole capture on fake devices in virtual time: 2 cameras × 2 displays of 8×8 px × 2 stops.
class CaptureTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        fs::temp_directory_path() / ("alhazen_capture_" + std::to_string(getpid()) + "_" +
                                     testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    make_rig({});
    hooks_.on_step = [this](const CaptureProgress& progress) { progress_.push_back(progress); };
    hooks_.on_retake = [this](const Retake& retake) { retakes_.push_back(retake); };
    hooks_.on_light_map = [this](std::shared_ptr<const LightMap> map) {
      const std::scoped_lock lock(mutex_);
      maps_[map->key] = std::move(map);
    };
    hooks_.on_warning = [this](const std::string& sentence) { warnings_.push_back(sentence); };
    hooks_.on_hold = [this](bool held) {
      held_.push_back(held);
      if (on_held_) on_held_(held);
    };
    hooks_.on_stop_done = [this](int stop, double) { stops_done_.push_back(stop); };
  }
  void TearDown() override {
    devices_.reset();
    fs::remove_all(folder_);
  }

  void make_rig(const FakeOptions& options) {
    devices_.reset();
    fake_ = std::make_unique<FakeRig>(clock_, options);
    loader_ = std::make_unique<Loader>("");
    ASSERT_TRUE(loader_->adopt(FakeRig::entry()));
    auto devices = DeviceSet::open(fake_->specs(), *loader_, Host{clock_, log_});
    ASSERT_TRUE(devices) << devices.error().text();
    devices_ = std::move(*devices);
  }

  [[nodiscard]] Manifest plan(int stops = 2) const {
    ScanRequest request;
    request.object_id = "sphere";
    request.choices.stops = stops;
    request.choices.crop = false;
    request.choices.keep_frames = keep_;
    auto made = make_plan(request, {}, fake_->rig(), fake_->facts(),
                          {"scan-1", "2026-11-22T00:00:00Z", "test"});
    EXPECT_TRUE(made) << made.error().text();
    return *made;
  }

  Result<Captured> capture(const Manifest& manifest, std::stop_token stop = {}) {
    auto scan =
        fs::exists(folder_) ? Scan::open(folder_) : Scan::create(folder_, manifest, fake_->rig());
    EXPECT_TRUE(scan) << scan.error().text();
    return capture_scan(*scan, *devices_, clock_, options_, hold_, hooks_, std::move(stop));
  }

  /// What camera pixel (x, y) must decode to.
  void expect_right_maps(const std::map<StackKey, std::shared_ptr<const LightMap>>& maps) const {
    for (const auto& [key, map] : maps) expect_map(*map, true);
  }
  void expect_map(const LightMap& map, bool right) const {
    std::size_t wrong = 0;
    const int display = map.key.display.back() - '0';
    for (int y = 0; y < map.region.height; ++y)
      for (int x = 0; x < map.region.width; ++x) {
        const auto pixel = static_cast<std::size_t>(y * map.region.width + x);
        const int u = fake_->seen_column(x, display, map.angle_rad);
        if (map.label[pixel] != Label::mirror || std::lround(map.u_px[pixel]) != u ||
            std::lround(map.v_px[pixel]) != y)
          ++wrong;
      }
    if (right)
      EXPECT_EQ(wrong, 0U) << map.key.stop << map.key.display << map.key.camera;
    else
      EXPECT_GT(wrong, 0U) << map.key.stop << map.key.display << map.key.camera;
  }

  /// Steps of the default plan: 2 stops × 2 displays × (2 + 2 · (3 + 3)) patterns.
  static constexpr std::size_t kPatterns = 14, kSteps = 2 * 2 * kPatterns;

  fs::path folder_;
  VirtualClock clock_;
  Silent log_;
  std::unique_ptr<FakeRig> fake_;
  std::unique_ptr<Loader> loader_;
  std::unique_ptr<DeviceSet> devices_;
  CaptureOptions options_;
  KeepFrames keep_ = KeepFrames::none;
  Hold hold_;
  CaptureHooks hooks_;
  std::vector<CaptureProgress> progress_;
  std::vector<Retake> retakes_;
  std::vector<std::string> warnings_;
  std::vector<bool> held_;
  std::function<void(bool)> on_held_;
  std::vector<int> stops_done_;
  std::mutex mutex_;
  std::map<StackKey, std::shared_ptr<const LightMap>> maps_;
};

TEST_F(CaptureTest, EveryStackBecomesItsLightMap) {
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_EQ(captured->steps, kSteps);
  EXPECT_EQ(captured->frames, 2 * kSteps);
  EXPECT_EQ(captured->light_maps, 8U);
  EXPECT_EQ(captured->retakes, 0U);
  EXPECT_THAT(maps_, SizeIs(8));
  expect_right_maps(maps_);
  EXPECT_THAT(stops_done_, ElementsAre(0, 1));
  ASSERT_THAT(progress_, SizeIs(kSteps));
  EXPECT_EQ(progress_.back().done, kSteps);
  EXPECT_EQ(progress_.back().total, kSteps);
  EXPECT_THAT(warnings_, IsEmpty());
  EXPECT_TRUE(fake_->is_dark());

  const auto scan = Scan::open(folder_);
  ASSERT_TRUE(scan);
  EXPECT_THAT(*scan->light_maps(), SizeIs(8));
  const auto log = scan->frame_log();
  ASSERT_TRUE(log);
  EXPECT_EQ(log->records.size(), 2 * kSteps);
}

TEST_F(CaptureTest, NothingIsTriggeredBeforeLightAndTableAreSteady) {
  ASSERT_TRUE(capture(plan()));
  const auto triggers = fake_->calls({}, "trigger");
  EXPECT_EQ(triggers.size(), 2 * kSteps);
  for (const FakeCall& trigger : triggers) EXPECT_TRUE(trigger.steady) << trigger.device;
}

TEST_F(CaptureTest, TheNextPictureComesWhenTheExposureEndsNotWhenTheFramesAreThere) {
  ASSERT_TRUE(capture(plan(1)));
  // From trigger to the next picture: the exposure; to the frame: exposure and readout.
  Time last_trigger{};
  int pictures = 0;
  for (const FakeCall& call : fake_->calls()) {
    if (call.call == "trigger") last_trigger = call.at;
    if (call.call == "show" && last_trigger > Time{} && call.device == "d0" && pictures < 13) {
      EXPECT_EQ(call.at - last_trigger, Micros(10'000));
      ++pictures;
    }
    if (call.call == "wait_frame") {
      EXPECT_GE(call.at - last_trigger, Micros(10'000));
    }
  }
  EXPECT_EQ(pictures, 13);
}

TEST_F(CaptureTest, EveryStopIsApproachedTurningForward) {
  ASSERT_TRUE(capture(plan(3)));
  std::vector<std::string> moves;
  for (const FakeCall& call : fake_->calls("table", "move_to")) moves.push_back(call.detail);
  EXPECT_THAT(moves, ElementsAre("-5", "0", "120", "240"));
}

}  // namespace
}  // namespace alhazen
