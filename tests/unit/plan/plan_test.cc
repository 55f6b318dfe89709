#include "daemon/plan/plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "daemon/plan/estimate.h"
#include "daemon/virtual_clock.h"
#include "tests/support/fake_devices.h"

namespace alhazen {
namespace {

using testing::Each;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr double kRadPerDeg = std::numbers::pi / 180;
const PlanStamp kStamp{"scan-1", "2026-11-22T01:02:03Z", "0.1"};

/// Two cameras of 400×300 px with 2° of view on a volume of 10 mm, two displays.
class PlanTest : public testing::Test {
 protected:
  PlanTest() : fake_(clock_, options()), rig_(fake_.rig()), facts_(fake_.facts()) {
    request_.object_id = "vase_3.b";
    request_.choices.edge_mm = 10;
    request_.choices.centre_mm = Eigen::Vector3d(0, 0, 50);
  }
  static FakeOptions options() {
    FakeOptions options;
    options.width_px = 400;
    options.height_px = 300;
    return options;
  }
  [[nodiscard]] Result<Manifest> plan() const {
    return make_plan(request_, presets_, rig_, facts_, kStamp);
  }

  VirtualClock clock_;
  FakeRig fake_;
  Rig rig_;
  DeviceFacts facts_;
  std::vector<Preset> presets_;
  ScanRequest request_;
};

TEST_F(PlanTest, WhatIsLeftOpenIsTheDefault) {
  request_.choices = {};
  facts_.cameras[1].preferred.exposure = Micros{7'000};
  facts_.cameras[1].preferred.gain_db = 3;
  const auto plan = this->plan();
  ASSERT_TRUE(plan) << plan.error().text();
  EXPECT_EQ(plan->scan_id, "scan-1");
  EXPECT_EQ(plan->created_at, kStamp.created_at);
  EXPECT_EQ(plan->rig_hash, rig_.hash());
  EXPECT_EQ(plan->level, 8);
  EXPECT_EQ(plan->keep_frames, KeepFrames::none);
  EXPECT_EQ(plan->volume.edge_mm, 102.4);
  EXPECT_EQ(plan->volume.centre_mm, Eigen::Vector3d(0, 0, 51.2));
  ASSERT_THAT(plan->stops, SizeIs(12));
  for (std::size_t i = 0; i < 12; ++i) {
    EXPECT_EQ(plan->stops[i].index, static_cast<int>(i));
    EXPECT_NEAR(plan->stops[i].wanted_rad, 30.0 * static_cast<double>(i) * kRadPerDeg, 1e-12);
  }
  EXPECT_THAT(plan->displays,
              ElementsAre(Field(&PlannedDisplay::name, "d0"), Field(&PlannedDisplay::name, "d1")));
  EXPECT_THAT(plan->displays[0].patterns, SizeIs(2 + 2 * (9 + 9)));
  ASSERT_THAT(plan->cameras, SizeIs(2));
  EXPECT_EQ(plan->cameras[0].settings.exposure, Micros{10'000});
  EXPECT_EQ(plan->cameras[1].settings.exposure, Micros{7'000});
  EXPECT_EQ(plan->cameras[1].settings.gain_db, 3);
}

TEST_F(PlanTest, EqualArgumentsGiveEqualPlansThatTheManifestKeeps) {
  request_.note = "with \"quotes\" and ü";
  request_.operator_name = "ada";
  const auto plan = this->plan();
  ASSERT_TRUE(plan) << plan.error().text();
  EXPECT_EQ(plan->to_json(), this->plan()->to_json());
  const auto read = Manifest::parse(plan->to_json());
  ASSERT_TRUE(read) << read.error().text();
  EXPECT_EQ(read->to_json(), plan->to_json());
}

TEST_F(PlanTest, ARequestWinsOverItsPreset) {
  Preset preset{"quick", "", {}};
  preset.choices.stops = 6;
  preset.choices.level = 7;
  preset.choices.displays = {"d1"};
  presets_ = {{"other", "", {}}, preset};
  request_.preset = "quick";
  EXPECT_THAT(plan()->stops, SizeIs(6));
  EXPECT_EQ(plan()->level, 7);
  EXPECT_THAT(plan()->displays, SizeIs(1));
  request_.choices.level = 5;
  request_.choices.displays = {"d1", "d0"};
  EXPECT_EQ(plan()->level, 5);
  EXPECT_THAT(plan()->displays,
              ElementsAre(Field(&PlannedDisplay::name, "d1"), Field(&PlannedDisplay::name, "d0")));
  // Stops and angles are one choice.
  request_.choices.angles_deg = {-30, 45.5};
  ASSERT_THAT(plan()->stops, SizeIs(2));
  EXPECT_NEAR(plan()->stops[1].wanted_rad, 45.5 * kRadPerDeg, 1e-12);
}

TEST_F(PlanTest, TheDefaultVolumeStandsOnThePlateWhereTheAxisMeetsIt) {
  rig_.turntable.point_mm = {3, -4, 100};
  rig_.turntable.direction = Eigen::Vector3d(0.01, 0, 1).normalized();
  request_.choices = {};
  request_.choices.edge_mm = 20;
  request_.choices.crop = false;
  const auto plan = this->plan();
  ASSERT_TRUE(plan) << plan.error().text();
  EXPECT_NEAR((plan->volume.centre_mm - Eigen::Vector3d(2, -4, 10)).norm(), 0, 1e-9);
}

TEST_F(PlanTest, RegionsHoldTheVolumeAtEveryStopAndLittleMore) {
  rig_.cameras[0].distortion = {-0.1, 0.02, 0.001, -0.002, 0, 0, 0, 0};
  request_.choices.angles_deg = {0, 20, 110};
  const auto plan = this->plan();
  ASSERT_TRUE(plan) << plan.error().text();
  std::mt19937 random(7);
  std::uniform_real_distribution<double> within(-5, 5);
  for (const PlannedCamera& camera : plan->cameras) {
    const Region& region = camera.settings.region;
    EXPECT_EQ(region.x % kRegionAlignPx, 0);
    EXPECT_EQ(region.y % kRegionAlignPx, 0);
    EXPECT_TRUE(region.width % kRegionAlignPx == 0 || region.x + region.width == 400);
    EXPECT_TRUE(region.height % kRegionAlignPx == 0 || region.y + region.height == 300);
    EXPECT_LT(region.width, 100);  // 10 mm at 400 mm with 800 px: 20 to 35 px, and room
    EXPECT_LT(region.height, 100);
    const CameraModel& model = *rig_.camera(camera.name);
    for (int i = 0; i < 3000; ++i) {
      const Stop& stop = plan->stops[static_cast<std::size_t>(i % 3)];
      const Eigen::Vector3d point(within(random), within(random), 50 + within(random));
      const auto pixel = model.project(model.camera_from_rig *
                                       (rig_.turntable.rig_from_object(stop.wanted_rad) * point));
      ASSERT_TRUE(pixel);
      EXPECT_GE(pixel->x(), region.x);
      EXPECT_GE(pixel->y(), region.y);
      EXPECT_LE(pixel->x(), region.x + region.width - 1);
      EXPECT_LE(pixel->y(), region.y + region.height - 1);
    }
  }
}

TEST_F(PlanTest, AVolumeAroundACameraNeedsTheWholeSensor) {
  request_.choices.edge_mm = 1000;
  const auto plan = this->plan();
  ASSERT_TRUE(plan) << plan.error().text();
  for (const PlannedCamera& camera : plan->cameras)
    EXPECT_EQ(camera.settings.region, (Region{0, 0, 400, 300}));
}

TEST_F(PlanTest, StepsGoByStopThenDisplayThenPattern) {
  request_.choices.stops = 3;
  const auto plan = this->plan();
  const std::vector<Step> steps = make_steps(*plan);
  const std::size_t patterns = plan->displays[0].patterns.size();
  ASSERT_THAT(steps, SizeIs(3 * 2 * patterns));
  for (std::size_t i = 0; i < steps.size(); ++i) {
    EXPECT_EQ(steps[i].index, i);
    EXPECT_EQ(steps[i].stop, static_cast<int>(i / (2 * patterns)));
    EXPECT_EQ(steps[i].display, static_cast<int>(i / patterns % 2));
    EXPECT_EQ(steps[i].pattern, static_cast<int>(i % patterns));
    EXPECT_EQ(steps[i].first_of_display, i % patterns == 0);
    EXPECT_EQ(steps[i].last_of_display, i % patterns == patterns - 1);
  }
}

/// A wrong request and what is said about it.
struct Wrong {
  const char* name;
  std::function<void(ScanRequest&)> spoil;
  const char* said;
};
class WrongRequest : public PlanTest, public testing::WithParamInterface<Wrong> {};

TEST_P(WrongRequest, IsInvalidAndNamesKeyAndRange) {
  GetParam().spoil(request_);
  const auto plan = this->plan();
  ASSERT_FALSE(plan);
  EXPECT_EQ(plan.error().code, Code::invalid);
  EXPECT_THAT(plan.error().what, HasSubstr(GetParam().said));
}

const double kNan = std::numeric_limits<double>::quiet_NaN();

INSTANTIATE_TEST_SUITE_P(
    All, WrongRequest,
    testing::Values(
        Wrong{"no_object", [](ScanRequest& r) { r.object_id = ""; },
              "'object.id' is ''; it must be 1 to 64 characters"},
        Wrong{"odd_object", [](ScanRequest& r) { r.object_id = "a/b"; }, "'object.id' is 'a/b'"},
        Wrong{"long_object", [](ScanRequest& r) { r.object_id.assign(65, 'a'); }, "'object.id'"},
        Wrong{"long_note", [](ScanRequest& r) { r.note.assign(4097, 'a'); },
              "'object.note' is 4097 bytes long; it must be at most 4096"},
        Wrong{"long_operator", [](ScanRequest& r) { r.operator_name.assign(65, 'a'); },
              "'object.operator' is 65 bytes long"},
        Wrong{"unknown_preset", [](ScanRequest& r) { r.preset = "nonsense"; },
              "'plan.preset' is 'nonsense'; it must be one of: none"},
        Wrong{"no_stop", [](ScanRequest& r) { r.choices.stops = 0; },
              "'plan.stops' is 0; it must be within [1, 360]"},
        Wrong{"many_stops", [](ScanRequest& r) { r.choices.stops = 361; }, "'plan.stops' is 361"},
        Wrong{"stops_and_angles",
              [](ScanRequest& r) {
                r.choices.stops = 2;
                r.choices.angles_deg = {0};
              },
              "'plan.angles_deg' is given beside 'plan.stops'"},
        Wrong{"no_angles", [](ScanRequest& r) { r.choices.angles_deg.emplace(); },
              "'plan.angles_deg' is a list of 0"},
        Wrong{"falling_angles",
              [](ScanRequest& r) {
                r.choices.angles_deg = {10, 5};
              },
              "'plan.angles_deg' is 5 after 10; it must be a rising list"},
        Wrong{"equal_angles",
              [](ScanRequest& r) {
                r.choices.angles_deg = {10, 10};
              },
              "a rising list"},
        Wrong{"wide_angles",
              [](ScanRequest& r) {
                r.choices.angles_deg = {-180, 180};
              },
              "spread over 360"},
        Wrong{"far_angle", [](ScanRequest& r) { r.choices.angles_deg = {361}; },
              "within [-360, 360]"},
        Wrong{"nan_angle", [](ScanRequest& r) { r.choices.angles_deg = {kNan}; },
              "within [-360, 360]"},
        Wrong{"no_displays", [](ScanRequest& r) { r.choices.displays.emplace(); },
              "'plan.displays' is empty; it must be some of: d0, d1"},
        Wrong{"unknown_display", [](ScanRequest& r) { r.choices.displays = {"d7"}; },
              "'plan.displays' is 'd7'; it must be one of: d0, d1"},
        Wrong{"display_twice",
              [](ScanRequest& r) {
                r.choices.displays = {"d0", "d0"};
              },
              "naming 'd0' twice"},
        Wrong{"unknown_camera",
              [](ScanRequest& r) {
                r.choices.cameras = {"c0", "d0"};
              },
              "'plan.cameras' is 'd0'; it must be one of: c0, c1"},
        Wrong{"long_exposure", [](ScanRequest& r) { r.choices.exposure = Micros{1'000'001}; },
              "'plan.exposure_us' is 1000001 us; it must be within [10 us, 1000000 us] for camera"},
        Wrong{"short_exposure", [](ScanRequest& r) { r.choices.exposure = Micros{-5}; },
              "'plan.exposure_us' is -5 us"},
        Wrong{"gain", [](ScanRequest& r) { r.choices.gain_db = 24.5; },
              "'plan.gain_db' is 24.5; it must be within [0, 24] for camera c0"},
        Wrong{"nan_gain", [](ScanRequest& r) { r.choices.gain_db = kNan; }, "'plan.gain_db'"},
        Wrong{"small_edge", [](ScanRequest& r) { r.choices.edge_mm = 0.5; },
              "'volume.edge_mm' is 0.5; it must be within [1, 2000]"},
        Wrong{"nan_edge", [](ScanRequest& r) { r.choices.edge_mm = kNan; }, "'volume.edge_mm'"},
        Wrong{"far_centre",
              [](ScanRequest& r) { r.choices.centre_mm = Eigen::Vector3d(0, 3000, 0); },
              "'volume.centre_mm' is 3000; it must be within [-2000, 2000]"},
        Wrong{"nan_centre",
              [](ScanRequest& r) { r.choices.centre_mm = Eigen::Vector3d(0, kNan, 0); },
              "'volume.centre_mm'"},
        Wrong{"unseen_volume",
              [](ScanRequest& r) { r.choices.centre_mm = Eigen::Vector3d(0, 0, 1900); },
              "camera c0 does not see the volume (10 mm about 0, 0, 1900)"},
        Wrong{"low_level", [](ScanRequest& r) { r.choices.level = 3; },
              "'level' is 3; it must be within [4, 11]"},
        Wrong{"high_level", [](ScanRequest& r) { r.choices.level = 12; }, "'level' is 12"}),
    [](const auto& wrong) { return std::string(wrong.param.name); });

TEST_F(PlanTest, DevicesThatDoNotFitTheRigAreNamed) {
  const DeviceFacts good = facts_;
  facts_.cameras.erase(facts_.cameras.begin());
  EXPECT_EQ(plan().error().what, "camera c0 is in the rig but not open");
  request_.choices.cameras = {"c1"};
  EXPECT_TRUE(plan());
  facts_ = good;
  facts_.cameras[1].info.height_px = 299;
  EXPECT_EQ(plan().error().what,
            "camera c1 is calibrated with 400x300 px, the device has 400x299 px");
  facts_ = good;
  facts_.displays.pop_back();
  EXPECT_EQ(plan().error().what, "display d1 is in the rig but not open");
  facts_ = good;
  facts_.displays[0].info.width_px = 500;
  EXPECT_EQ(plan().error().what,
            "display d0 is calibrated with 400x300 px, the device has 500x300 px");
  facts_ = good;
  facts_.turntable.reset();
  EXPECT_EQ(plan().error().what, "no turntable is open: a scan needs one");
}

TEST_F(PlanTest, ATableWithLimitsNeedsRoomToRunUp) {
  facts_.turntable->min_rad = -10 * kRadPerDeg;
  facts_.turntable->max_rad = 200 * kRadPerDeg;
  request_.choices.angles_deg = {-5, 200};
  EXPECT_TRUE(plan());
  request_.choices.angles_deg = {-5.5};
  EXPECT_THAT(plan().error().what, HasSubstr("run-up of 5 deg: [-5, 200]"));
  request_.choices.angles_deg = {201};
  EXPECT_THAT(plan().error().what, HasSubstr("'plan.angles_deg' is 201"));
}

TEST_F(PlanTest, PhasesFollowTheCoarseBits) {
  request_.choices.coding = Coding::gray_phase;
  const auto made = plan();
  ASSERT_TRUE(made);
  for (const PlannedDisplay& display : made->displays) {
    EXPECT_EQ(display.patterns,
              *make_sequence(Coding::gray_phase, display.width_px, display.height_px));
    EXPECT_EQ(display.patterns.back().kind, PatternKind::phase);
  }
}

TEST_F(PlanTest, ASmallPlanIsEstimatedAsCountedByHand) {
  facts_.turntable->speed_rad_s = 0.5;
  facts_.turntable->acceleration_rad_s2 = 1.0;
  facts_.displays[0].info.refresh_hz = facts_.displays[1].info.refresh_hz = 50;
  facts_.cameras[0].info.readout_max = Micros{60'000};
  request_.choices.angles_deg = {0, 90};
  request_.choices.exposure = Micros{30'000};
  request_.choices.crop = false;
  request_.choices.keep_frames = KeepFrames::all;
  const Estimate total = estimate(*plan(), facts_);
  const std::uint64_t steps = 2 * 2 * 38, px = 400 * 300;
  EXPECT_EQ(total.steps, steps);
  EXPECT_EQ(total.frames, 2 * steps);
  EXPECT_EQ(total.stacks, 8U);
  EXPECT_EQ(total.bytes_disk, 8 * px * 32 + 2 * steps * px);
  // A step: 30 ms of exposure, then 60 ms until the slower frame is there (settling: 40 ms); a
  // display goes dark in 40 ms; turns by 5° (below the ramp of 0.25 rad) and 90°.
  const double turns = 2 * std::sqrt(5 * kRadPerDeg / 1.0) + 90 * kRadPerDeg / 0.5 + 0.5 / 1.0;
  EXPECT_NEAR(total.seconds, static_cast<double>(steps) * 0.09 + 4 * 0.04 + turns, 1e-9);
  EXPECT_THAT(total.links, SizeIs(2));
  EXPECT_NEAR(total.links[0].megabytes_per_s, static_cast<double>(px) / 0.09 / 1e6, 1e-9);
  EXPECT_THAT(total.notes, IsEmpty());
  EXPECT_GT(total.bytes_memory, 2 * px * 24);

  request_.choices.exposure = Micros{19'000};
  EXPECT_THAT(estimate(*plan(), facts_).notes,
              ElementsAre("exposure of 19000 us is shorter than a refresh of display d0 (20000 "
                          "us): brightness may differ from frame to frame",
                          HasSubstr("display d1")));
}

}  // namespace
}  // namespace alhazen
