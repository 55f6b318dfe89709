#include "daemon/capture/capture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>
#include <optional>
#include <thread>

#include "daemon/capture/preview.h"
#include "daemon/virtual_clock.h"
#include "tests/support/fake_devices.h"
#include "tests/support/file_size_limit.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class Noted final : public Log {
 public:
  void write(Severity severity, std::string_view line) noexcept override {
    if (severity >= Severity::warning) lines.emplace_back(line);
  }
  std::vector<std::string> lines;
};

/// Threads of this process.
std::ptrdiff_t thread_count() {
  const fs::directory_iterator tasks("/proc/self/task");
  return std::distance(begin(tasks), end(tasks));
}

/// Whether no more than `most` threads are left: the kernel lists one that has been joined for
/// another moment.
bool threads_come_down_to(std::ptrdiff_t most) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (thread_count() > most) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::yield();
  }
  return true;
}

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

  Result<Captured> capture(const Manifest& manifest, const std::stop_token& stop = {}) {
    auto scan =
        fs::exists(folder_) ? Scan::open(folder_) : Scan::create(folder_, manifest, fake_->rig());
    EXPECT_TRUE(scan) << scan.error().text();
    return capture_scan(*scan, *devices_, clock_, options_, hold_, hooks_, stop);
  }

  /// What camera pixel (x, y) must decode to.
  void expect_right_maps() const {
    for (const auto& [key, map] : maps_)
      EXPECT_EQ(wrong_pixels(*map), 0U) << key.stop << " " << key.display << " " << key.camera;
  }
  [[nodiscard]] std::size_t wrong_pixels(const LightMap& map) const {
    // Maps are cropped to what they say; what they do not is wrong, too.
    const CameraInfo sensor = fake_->facts().cameras.front().info;
    std::size_t right = 0, pixel = 0;
    const int display = map.key.display.back() - '0';
    for (int y = map.region.y; y < map.region.y + map.region.height; ++y)
      for (int x = map.region.x; x < map.region.x + map.region.width; ++x, ++pixel) {
        const int u = fake_->seen_column(x, display, map.angle_rad);
        if (map.label[pixel] == Label::mirror && std::lround(map.u_px[pixel]) == u &&
            std::lround(map.v_px[pixel]) == y)
          ++right;
      }
    return static_cast<std::size_t>(sensor.width_px) * static_cast<std::size_t>(sensor.height_px) -
           right;
  }
  [[nodiscard]] std::vector<std::string> causes() const {
    std::vector<std::string> texts;
    for (const Retake& retake : retakes_) texts.push_back(retake.camera + " " + retake.cause.what);
    return texts;
  }

  /// Steps of the default plan: 2 stops × 2 displays × (2 + 2 · (3 + 3)) patterns.
  static constexpr std::size_t kPatterns = 14, kSteps = 2 * 2 * kPatterns;

  fs::path folder_;
  VirtualClock clock_;
  Noted log_;
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
  expect_right_maps();
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

/// One way of a frame to be unusable, and what is said about it.
struct BadFrame {
  Fault fault;
  const char* said;
};
class BadFrameTest : public CaptureTest, public testing::WithParamInterface<BadFrame> {};

TEST_P(BadFrameTest, IsRetakenAndTheMapsAreRight) {
  fake_->script("c1", "wait_frame", 5, GetParam().fault);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_EQ(captured->retakes, 1U);
  EXPECT_EQ(captured->unchanged, 0U);
  EXPECT_EQ(captured->frames, 2 * kSteps);
  EXPECT_THAT(causes(), ElementsAre(HasSubstr(GetParam().said)));
  EXPECT_THAT(causes(), ElementsAre(testing::StartsWith("c1 ")));
  EXPECT_EQ(retakes_[0].step.index, 4U);
  EXPECT_EQ(retakes_[0].attempt, 1);
  EXPECT_THAT(maps_, SizeIs(8));
  expect_right_maps();
  // Only the camera that failed is triggered again, and only when the light is steady again.
  EXPECT_THAT(fake_->calls("c0", "trigger"), SizeIs(kSteps));
  EXPECT_THAT(fake_->calls("c1", "trigger"), SizeIs(kSteps + 1));
  for (const FakeCall& trigger : fake_->calls({}, "trigger")) EXPECT_TRUE(trigger.steady);

  const auto log = Scan::open(folder_)->frame_log();
  ASSERT_TRUE(log);
  for (const FrameRecord& record : log->records)
    EXPECT_EQ(record.attempt, record.camera == "c1" && record.step == 4 ? 2 : 1);
}

INSTANTIATE_TEST_SUITE_P(
    Faults, BadFrameTest,
    testing::Values(BadFrame{Fault::timeout, "no frame"}, BadFrame{Fault::corrupt, "packets lost"},
                    BadFrame{Fault::stale, "counter is"},
                    BadFrame{Fault::stale_by_counter, "counter is"},
                    BadFrame{Fault::stale_by_time, "10000 us before the trigger"},
                    BadFrame{Fault::stale_by_pixels, "pixels equal those of the frame before"}));

TEST_F(CaptureTest, AFrameIsRetakenThreeTimes) {
  fake_->script("c0", "wait_frame", 20, Fault::corrupt, 3);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_EQ(captured->retakes, 3U);
  expect_right_maps();
}

TEST_F(CaptureTest, AfterThreeRetakesTheStepFailsWithItsHistory) {
  fake_->script("c1", "wait_frame", 20, Fault::timeout);
  fake_->script("c1", "wait_frame", 21, Fault::corrupt);
  fake_->script("c1", "wait_frame", 22, Fault::stale_by_time);
  fake_->script("c1", "wait_frame", 23, Fault::timeout);
  const auto captured = capture(plan());
  ASSERT_FALSE(captured);
  EXPECT_EQ(captured.error().code, Code::timeout);
  EXPECT_EQ(captured.error().where, "stop 0 / display d1 / pattern 5 / camera c1");
  EXPECT_EQ(captured.error().what,
            "no usable frame in 4 attempts: 1: timeout, no frame; 2: corrupt, 2 packets lost; 3: "
            "corrupt, stale frame: its exposure began 10000 us before the trigger; 4: timeout, no "
            "frame");
  EXPECT_THAT(retakes_, SizeIs(3));
  // What was complete before stays; of the failed display nothing does, of no camera.
  EXPECT_THAT(maps_, SizeIs(2));
  EXPECT_THAT(*Scan::open(folder_)->light_maps(), SizeIs(2));
  EXPECT_TRUE(fake_->is_dark());
  EXPECT_GE(fake_->halts(), 1);
}

TEST_F(CaptureTest, CallsThatTimeOutAreAskedAgain) {
  fake_->script("c0", "trigger", 3, Fault::timeout);
  fake_->script("c1", "configure", 1, Fault::timeout);
  fake_->script("d1", "show", 4, Fault::timeout, 3);
  fake_->script("table", "home", 1, Fault::timeout);
  fake_->script("table", "move_to", 2, Fault::timeout, 2);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  expect_right_maps();
  EXPECT_EQ(captured->retakes, 2U);
  EXPECT_THAT(warnings_, SizeIs(3 + 1 + 2));
}

TEST_F(CaptureTest, ADisplayThatNeverAnswersFailsTheScan) {
  fake_->script("d1", "show", 4, Fault::timeout, 100);  // the picture that follows pattern 1
  const auto captured = capture(plan());
  ASSERT_FALSE(captured);
  EXPECT_EQ(captured.error().code, Code::timeout);
  EXPECT_EQ(captured.error().where, "stop 0 / display d1 / pattern 1 / display d1 / show");
}

TEST_F(CaptureTest, ALostCameraIsOpenedAgainAndTheStopRepeatedOnce) {
  fake_->script("c1", "wait_frame", 20, Fault::lost);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_EQ(captured->reopened, 1U);
  EXPECT_THAT(captured->gaps, IsEmpty());
  EXPECT_THAT(maps_, SizeIs(8));
  expect_right_maps();
  std::vector<std::string> moves;
  for (const FakeCall& call : fake_->calls("table", "move_to")) moves.push_back(call.detail);
  EXPECT_THAT(moves, ElementsAre("-5", "0", "-5", "0", "180"));
  // The display that was under way is shown from its first pattern, the one before is not.
  EXPECT_EQ(fake_->calls("c0", "trigger").size(), kSteps + 6);
  EXPECT_THAT(warnings_, ElementsAre(HasSubstr("stopped answering")));
}

TEST_F(CaptureTest, ALostDisplayAndALostTableComeBackToo) {
  fake_->script("d0", "show", 10, Fault::lost);
  fake_->script("table", "move_to", 5, Fault::lost);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_EQ(captured->reopened, 2U);
  expect_right_maps();
  EXPECT_THAT(maps_, SizeIs(8));
  // A table that was opened again does not know where it is.
  EXPECT_THAT(fake_->calls("table", "home"), SizeIs(2));
}

TEST_F(CaptureTest, LostTwiceAtOneStopFailsTheScan) {
  fake_->script("c1", "wait_frame", 5, Fault::lost);
  fake_->script("c1", "wait_frame", 10, Fault::lost);
  const auto captured = capture(plan());
  ASSERT_FALSE(captured);
  EXPECT_EQ(captured.error().code, Code::unavailable);
  EXPECT_THAT(captured.error().where, HasSubstr("camera c1 / wait_frame"));
  EXPECT_TRUE(fake_->is_dark());
}

TEST_F(CaptureTest, LostForGoodFailsTheScanAndTellsWhatWasTried) {
  fake_->script("c1", "trigger", 5, Fault::lost_for_good);
  const auto captured = capture(plan());
  ASSERT_FALSE(captured);
  EXPECT_EQ(captured.error().code, Code::unavailable);
  EXPECT_THAT(captured.error().what, HasSubstr("opened again 6 times: c1 is not there"));
  // No camera is left with a frame pending: the next scan could not trigger it.
  Camera& other = *devices_->camera("c0");
  EXPECT_TRUE(other.trigger());
}

TEST_F(CaptureTest, GapsAreListedWhereTheyAreAccepted) {
  options_.on_gap = OnGap::accept;
  fake_->script("c1", "wait_frame", 20, Fault::corrupt, 4);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  ASSERT_THAT(captured->gaps, SizeIs(1));
  EXPECT_EQ(captured->gaps[0].key, (StackKey{0, "d1", "c1"}));
  EXPECT_THAT(captured->gaps[0].cause.what, HasSubstr("no usable frame in 4 attempts"));
  EXPECT_THAT(maps_, SizeIs(7));
  expect_right_maps();
}

TEST_F(CaptureTest, ACameraLostForGoodIsAGapAtEveryStop) {
  options_.on_gap = OnGap::accept;
  fake_->script("c1", "wait_frame", 20, Fault::lost_for_good);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_THAT(captured->gaps, SizeIs(3));  // d1 at stop 0, both at stop 1
  EXPECT_THAT(maps_, SizeIs(5));
  expect_right_maps();
}

TEST_F(CaptureTest, ADisplayLostForGoodIsAGapAtEveryStop) {
  options_.on_gap = OnGap::accept;
  fake_->script("d0", "show", 10, Fault::lost_for_good);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_THAT(captured->gaps, SizeIs(4));
  EXPECT_THAT(maps_, SizeIs(4));
  for (const auto& [key, map] : maps_) EXPECT_EQ(key.display, "d1");
}

TEST_F(CaptureTest, NothingIsScannedWithoutTheTable) {
  options_.on_gap = OnGap::accept;
  fake_->script("table", "move_to", 3, Fault::lost_for_good);
  const auto captured = capture(plan());
  ASSERT_FALSE(captured);
  EXPECT_EQ(captured.error().code, Code::unavailable);
}

TEST_F(CaptureTest, ABlindCameraWithoutNoiseIsBelievedAfterOneRetake) {
  FakeOptions options;
  options.blind = true;
  make_rig(options);
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  // White as before it, black as white: then nothing more is asked in that stack.
  EXPECT_LE(captured->retakes, 2U * 8U);
  EXPECT_EQ(captured->retakes, captured->unchanged);
  for (const auto& [key, map] : maps_)
    for (const Label label : map->label) EXPECT_EQ(label, Label::none);
}

TEST_F(CaptureTest, AScanGoesOnWhereItsDirectoryEnds) {
  ASSERT_TRUE(capture(plan()));
  const std::size_t before = fake_->calls({}, "trigger").size();
  std::map<std::string, std::string> files;
  for (const auto& file : fs::directory_iterator(folder_ / "light_maps")) {
    std::ifstream in(file.path(), std::ios::binary);
    files[file.path().filename()] = std::string(std::istreambuf_iterator<char>(in), {});
  }
  fs::remove(folder_ / "light_maps" / "001_d0_c1.exr");
  maps_.clear();
  progress_.clear();
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_EQ(captured->skipped, 7U);
  EXPECT_EQ(captured->light_maps, 1U);
  EXPECT_EQ(fake_->calls({}, "trigger").size() - before, kPatterns);  // one camera, one display
  EXPECT_THAT(maps_, SizeIs(1));
  EXPECT_EQ(progress_.front().done, 2 * kPatterns + 1);
  // Equal bit by bit.
  for (const auto& [name, bytes] : files) {
    std::ifstream in(folder_ / "light_maps" / name, std::ios::binary);
    EXPECT_TRUE(bytes == std::string(std::istreambuf_iterator<char>(in), {})) << name;
  }
}

TEST_F(CaptureTest, HeldAtAStepAllIsDarkAndThenGoesOn) {
  hooks_.on_step = [this](const CaptureProgress& progress) {
    if (progress.done == 5) hold_.hold(HoldAt::step, "operator");
  };
  on_held_ = [this](bool held) {
    if (!held) return;
    EXPECT_TRUE(fake_->is_dark());
    EXPECT_EQ(hold_.reason(), "operator");
    EXPECT_EQ(fake_->calls("c0", "trigger").size(), 5U);
    hold_.release();
  };
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_THAT(held_, ElementsAre(true, false));
  expect_right_maps();
  EXPECT_EQ(captured->steps, kSteps);
}

TEST_F(CaptureTest, HeldAtAStopTheStopIsFinishedFirst) {
  hooks_.on_step = [this](const CaptureProgress& progress) {
    if (progress.done == 5) hold_.hold(HoldAt::stop, "operator");
  };
  on_held_ = [this](bool held) {
    if (!held) return;
    EXPECT_EQ(fake_->calls("c0", "trigger").size(), 2 * kPatterns);
    hold_.release();
  };
  ASSERT_TRUE(capture(plan()));
  EXPECT_THAT(held_, ElementsAre(true, false));
}

TEST_F(CaptureTest, StoppedWhileHeldItIsCancelled) {
  std::stop_source stop;
  hold_.hold(HoldAt::step, "operator");
  on_held_ = [&](bool) { stop.request_stop(); };
  const auto captured = capture(plan(), stop.get_token());
  ASSERT_FALSE(captured);
  EXPECT_EQ(captured.error().code, Code::cancelled);
}

TEST_F(CaptureTest, AFullDiskHoldsTheCaptureUntilThereIsRoom) {
  std::optional<FileSizeLimit> limit;
  std::atomic<bool> full{false};
  hooks_.on_step = [&](const CaptureProgress& progress) {
    if (progress.done == 5) limit.emplace(64);
  };
  hooks_.on_hold = [&](bool held) {
    if (!held || full.exchange(true)) return;
    EXPECT_THAT(hold_.reason(), testing::StartsWith("disk: "));
    limit.reset();
    hold_.release();
  };
  const auto captured = capture(plan());
  ASSERT_TRUE(captured) << captured.error().text();
  EXPECT_TRUE(full);
  EXPECT_THAT(maps_, SizeIs(8));
  EXPECT_THAT(*Scan::open(folder_)->light_maps(), SizeIs(8));
}

TEST_F(CaptureTest, FramesAreKeptAsAsked) {
  const auto count = [this] {
    const fs::directory_iterator frames(folder_ / "frames");
    return static_cast<std::size_t>(std::distance(begin(frames), end(frames)));
  };
  fake_->script("c1", "wait_frame", 5, Fault::stale_by_time);
  keep_ = KeepFrames::failed;
  ASSERT_TRUE(capture(plan()));
  EXPECT_EQ(count(), 2U);  // the stale one and the one taken for it
  fs::remove_all(folder_);
  keep_ = KeepFrames::all;
  ASSERT_TRUE(capture(plan()));
  EXPECT_EQ(count(), 2 * kSteps);
  fs::remove_all(folder_);
  keep_ = KeepFrames::sample;
  ASSERT_TRUE(capture(plan()));
  EXPECT_EQ(count(), 2 * 4U);  // steps 0, 16, 32, 48 of 56
  const auto log = Scan::open(folder_)->frame_log();
  for (const FrameRecord& record : log->records)
    EXPECT_EQ(record.file.has_value(), record.step % 16 == 0);
}

TEST_F(CaptureTest, RefusedFramesOfAFailedStepAreKept) {
  keep_ = KeepFrames::failed;
  fake_->script("c1", "wait_frame", 5, Fault::stale_by_time, 4);
  ASSERT_FALSE(capture(plan()));
  const fs::directory_iterator frames(folder_ / "frames");
  EXPECT_EQ(std::distance(begin(frames), end(frames)), 4);
}

TEST_F(CaptureTest, APlanForOtherDevicesIsRefused) {
  const auto refused = [&](const Manifest& manifest) {
    fs::remove_all(folder_);
    const auto captured = capture(manifest);
    EXPECT_FALSE(captured);
    EXPECT_EQ(captured.error().code, Code::invalid);
    return captured.error().what;
  };
  Manifest manifest = plan();
  manifest.cameras[0].name = "other";
  EXPECT_EQ(refused(manifest), "the plan needs camera other, which is not configured");
  manifest = plan();
  manifest.cameras[0].settings.region.width = 9;
  EXPECT_THAT(refused(manifest), HasSubstr("ends outside its sensor of 8x8 px"));
  manifest = plan();
  manifest.displays[1].name = "other";
  EXPECT_EQ(refused(manifest), "the plan needs display other, which is not configured");
  manifest = plan();
  manifest.displays[1].width_px = 7;
  EXPECT_THAT(refused(manifest), HasSubstr("wants 7x8 px of display d1, it has 8x8 px"));
}

TEST_F(CaptureTest, ADisplayOutsideThePlanIsKeptBlack) {
  Manifest manifest = plan();
  manifest.displays.pop_back();
  ASSERT_TRUE(capture(manifest));
  expect_right_maps();
  const auto shown = fake_->calls("d1", "show");
  ASSERT_THAT(shown, SizeIs(1));
  EXPECT_EQ(shown[0].detail, "black");
}

/// Stops at the n-th device call, whatever it is, then goes on in the same directory.
TEST_F(CaptureTest, CancelledAtAnyDeviceCallItStopsCleanlyAndResumes) {
  FakeOptions options;
  options.cameras = 1;
  options.displays = 1;
  options.width_px = options.height_px = 2;
  make_rig(options);
  const auto threads = thread_count();
  const auto undisturbed = capture(plan());
  ASSERT_TRUE(undisturbed);
  const int calls = fake_->call_count();
  for (int n = 1; n <= calls; ++n) {
    SCOPED_TRACE("stopped at call " + std::to_string(n));
    fs::remove_all(folder_);
    make_rig(options);
    maps_.clear();
    std::stop_source stop;
    fake_->at_call(n, [&stop] { stop.request_stop(); });
    const auto captured = capture(plan(), stop.get_token());
    // A stop during the last calls, when all is taken, is a stop all the same. The three calls that
    // open the devices come before the capture.
    if (n > 3) {
      ASSERT_FALSE(captured);
      EXPECT_EQ(captured.error().code, Code::cancelled);
      EXPECT_TRUE(fake_->is_dark());
    }
    EXPECT_TRUE(threads_come_down_to(threads));
    const auto resumed = capture(plan());
    ASSERT_TRUE(resumed) << resumed.error().text();
    EXPECT_THAT(*Scan::open(folder_)->light_maps(), SizeIs(2));
    expect_right_maps();
  }
}

/// A driver that says "steady" too early is not waited for: the maps must tell. This is what shows
/// that waiting matters, and that the fake rig would catch a sequencer that does not.
TEST_F(CaptureTest, ADisplayThatIsNotWaitedForGivesWrongMaps) {
  FakeOptions options;
  options.hasty_display = true;
  make_rig(options);
  ASSERT_TRUE(capture(plan()));
  EXPECT_THAT(maps_, SizeIs(8));
  for (const auto& [key, map] : maps_) EXPECT_GT(wrong_pixels(*map), 32U);
}

TEST_F(CaptureTest, ATableThatIsNotWaitedForGivesWrongMaps) {
  FakeOptions options;
  options.hasty_table = true;
  make_rig(options);
  ASSERT_TRUE(capture(plan()));
  // At stop 1 the table turns by 180° in 3.1 s, while a display is through in 0.5 s.
  for (const auto& [key, map] : maps_)
    if (key.stop == 1) {
      EXPECT_GT(wrong_pixels(*map), 32U);
    }
}

TEST_F(CaptureTest, AFrameThatComesAfterItsDeadlineIsLogged) {
  fake_->script("c1", "wait_frame", 5, Fault::slow);
  ASSERT_TRUE(capture(plan()));
  EXPECT_THAT(log_.lines, ElementsAre(HasSubstr("camera c1 / wait_frame came back")));
}

TEST_F(CaptureTest, APreviewShowsItsPatternAndLeavesDarkness) {
  PreviewRequest request;
  request.display = "d1";
  request.exposure = Micros{20'000};
  const auto frames = take_preview(*devices_, clock_, request, {});
  ASSERT_TRUE(frames) << frames.error().text();
  ASSERT_THAT(*frames, SizeIs(2));
  EXPECT_EQ((*frames)[1].camera, "c1");
  EXPECT_EQ((*frames)[1].frame.settings.exposure, Micros{20'000});
  for (const std::uint8_t value : (*frames)[0].frame.image.mono8()) EXPECT_EQ(value, 240);
  EXPECT_TRUE(fake_->is_dark());
  for (const FakeCall& trigger : fake_->calls({}, "trigger")) EXPECT_TRUE(trigger.steady);

  request.cameras = {"c7"};
  EXPECT_EQ(take_preview(*devices_, clock_, request, {}).error().text(),
            "invalid: there is no camera 'c7'");
  request.cameras = {"c0"};
  request.exposure = Micros{1};
  EXPECT_THAT(take_preview(*devices_, clock_, request, {}).error().text(),
              HasSubstr("exposure 1 us is outside [10 us, 1000000 us]"));
}

}  // namespace
}  // namespace alhazen
