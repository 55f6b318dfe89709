#include "daemon/devices/device_set.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <thread>

#include "daemon/virtual_clock.h"
#include "reconstruct/pattern/draw.h"
#include "tests/support/fake_devices.h"

namespace alhazen {
namespace {

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

class DeviceSetTest : public testing::Test {
 protected:
  DeviceSetTest() : fake_(clock_), specs_(fake_.specs()), loader_("") {
    EXPECT_TRUE(loader_.adopt(FakeRig::entry()));
  }
  Result<std::unique_ptr<DeviceSet>> open() {
    return DeviceSet::open(specs_, loader_, Host{clock_, log_});
  }
  /// Opened, or the test fails.
  DeviceSet& devices() {
    if (!devices_) {
      auto opened = open();
      EXPECT_TRUE(opened) << opened.error().text();
      devices_ = std::move(*opened);
    }
    return *devices_;
  }
  [[nodiscard]] DeviceDescription description(const std::string& name) {
    for (DeviceDescription& one : devices().describe())
      if (one.name == name) return one;
    ADD_FAILURE() << "no description of " << name;
    return {};
  }
  Picture picture(int width = 8, int height = 8) {
    return *draw(Pattern{.kind = PatternKind::white}, width, height);
  }

  VirtualClock clock_;
  Noted log_;
  FakeRig fake_;
  DeviceSpecs specs_;
  Loader loader_;
  std::unique_ptr<DeviceSet> devices_;
};

TEST_F(DeviceSetTest, DevicesAreFoundByName) {
  EXPECT_THAT(devices().names(DeviceKind::camera), ElementsAre("c0", "c1"));
  EXPECT_THAT(devices().names(DeviceKind::display), ElementsAre("d0", "d1"));
  EXPECT_THAT(devices().names(DeviceKind::turntable), ElementsAre("table"));
  ASSERT_NE(devices().camera("c1"), nullptr);
  EXPECT_EQ(devices().camera("c1")->info().serial, "c1");
  EXPECT_EQ(devices().camera("d0"), nullptr);
  EXPECT_EQ(devices().display("d1")->info().width_px, 8);
  EXPECT_EQ(devices().turntable(), devices().turntable("table"));
  EXPECT_TRUE(devices().all_ready());
}

TEST_F(DeviceSetTest, ACameraTakesAFrame) {
  Camera& camera = *devices().camera("c0");
  const auto set = camera.configure({Micros{2'000}, 1.5, {2, 0, 4, 8}});
  ASSERT_TRUE(set);
  const auto end = camera.trigger();
  ASSERT_TRUE(end);
  EXPECT_EQ(*end - clock_.now(), Micros{2'000});
  const auto frame = camera.wait_frame(*end + Micros{10'000}, {});
  ASSERT_TRUE(frame) << frame.error().text();
  EXPECT_EQ(frame->image.width(), 4);
  EXPECT_EQ(description("c0").camera_settings.gain_db, 1.5);
  EXPECT_EQ(description("c0").calls, 4U);  // open, configure, trigger, wait_frame
  devices().refresh_readings();
  ASSERT_THAT(description("c0").readings, SizeIs(1));
  EXPECT_EQ(description("c0").readings[0].value, 1);
}

TEST_F(DeviceSetTest, ConfiguringWhatIsSetAsksNobody) {
  Camera& camera = *devices().camera("c0");
  const CameraSettings settings{Micros{2'000}, 0, {}};
  ASSERT_TRUE(camera.configure(settings));
  ASSERT_TRUE(camera.configure(settings));
  EXPECT_EQ(camera.configure(settings)->region, (Region{0, 0, 8, 8}));
  EXPECT_THAT(fake_.calls("c0", "configure"), SizeIs(1));
  ASSERT_TRUE(camera.configure({Micros{3'000}, 0, {}}));
  EXPECT_THAT(fake_.calls("c0", "configure"), SizeIs(2));
  // A camera that was opened again remembers nothing.
  ASSERT_TRUE(devices().reopen("c0"));
  ASSERT_TRUE(camera.configure({Micros{3'000}, 0, {}}));
  EXPECT_THAT(fake_.calls("c0", "configure"), SizeIs(3));
}

TEST_F(DeviceSetTest, AfterAFailedConfigureNothingIsTakenForSet) {
  Camera& camera = *devices().camera("c0");
  fake_.script("c0", "configure", 2, Fault::timeout);
  ASSERT_TRUE(camera.configure({Micros{2'000}, 0, {}}));
  ASSERT_FALSE(camera.configure({Micros{3'000}, 0, {}}));
  ASSERT_TRUE(camera.configure({Micros{2'000}, 0, {}}));
  EXPECT_THAT(fake_.calls("c0", "configure"), SizeIs(3));
}

/// Arguments out of range never reach a driver.
TEST_F(DeviceSetTest, ArgumentsOutOfRangeAreRefusedWithTheRange) {
  Camera& camera = *devices().camera("c0");
  const auto refused = [&](const CameraSettings& settings) {
    const auto set = camera.configure(settings);
    EXPECT_FALSE(set);
    EXPECT_EQ(set.error().code, Code::invalid);
    EXPECT_EQ(set.error().where, "camera c0 / configure");
    return set.error().what;
  };
  EXPECT_EQ(refused({Micros{9}, 0, {}}), "exposure 9 us is outside [10 us, 1000000 us]");
  EXPECT_EQ(refused({Micros{100}, 24.5, {}}), "gain 24.5 dB is outside [0, 24]");
  EXPECT_THAT(refused({Micros{100}, std::nan(""), {}}), HasSubstr("gain nan dB"));
  const std::vector<Region> regions{{0, 0, 9, 8},
                                    {1, 0, 8, 8},
                                    {-1, 0, 4, 4},
                                    {0, 0, 4, 0},
                                    {std::numeric_limits<int>::max(), 0, 4, 4}};
  for (const Region& region : regions)
    EXPECT_THAT(refused({Micros{100}, 0, region}), HasSubstr("is outside the sensor of 8x8"));
  EXPECT_THAT(fake_.calls("c0", "configure"), IsEmpty());

  Display& display = *devices().display("d0");
  EXPECT_EQ(display.show(picture(8, 7), {}).error().text(),
            "invalid: a picture of 8x7 px was given; it must be 8x8 px, mono8 (display d0 / show)");
  EXPECT_EQ(display.show(Picture{}, {}).error().code, Code::invalid);
  EXPECT_THAT(fake_.calls("d0", "show"), IsEmpty());

  Turntable& table = *devices().turntable();
  EXPECT_EQ(table.move_to(std::numeric_limits<double>::infinity(), clock_.now(), {}).error().code,
            Code::invalid);
  EXPECT_THAT(fake_.calls("table", "move_to"), IsEmpty());
}

TEST_F(DeviceSetTest, AnAngleThatIsNoneIsCorrupt) {
  fake_.script("table", "move_to", 1, Fault::corrupt);
  Turntable& table = *devices().turntable();
  const Time deadline = clock_.now() + Micros{10'000'000};
  ASSERT_TRUE(table.home(deadline, {}));
  const auto measured = table.move_to(1.0, deadline, {});
  ASSERT_FALSE(measured);
  EXPECT_EQ(measured.error().code, Code::corrupt);
}

TEST_F(DeviceSetTest, ErrorsTellDeviceAndCall) {
  const auto frame = devices().camera("c1")->wait_frame(clock_.now(), {});
  ASSERT_FALSE(frame);
  EXPECT_EQ(frame.error().text(), "conflict: nothing was triggered (camera c1 / wait_frame)");
  EXPECT_EQ(description("c1").failures, 1U);
  EXPECT_EQ(description("c1").state, DeviceState::ready);
}

TEST_F(DeviceSetTest, ALostDeviceSaysSoUntilItIsOpenedAgain) {
  fake_.script("c0", "trigger", 1, Fault::lost);
  Camera& camera = *devices().camera("c0");
  EXPECT_EQ(camera.trigger().error().code, Code::unavailable);
  EXPECT_EQ(description("c0").state, DeviceState::lost);
  EXPECT_EQ(description("c0").trouble, "c0 stopped answering");
  EXPECT_FALSE(devices().all_ready());
  EXPECT_EQ(camera.trigger().error().code, Code::unavailable);
  ASSERT_TRUE(devices().reopen("c0"));
  EXPECT_EQ(description("c0").state, DeviceState::ready);
  EXPECT_EQ(description("c0").trouble, "");
  EXPECT_EQ(description("c0").reopened, 1U);
  EXPECT_TRUE(camera.trigger());  // the same object
}

TEST_F(DeviceSetTest, WhatIsNotThereIsAbsentNotAnError) {
  fake_.script("c1", "open", 1, Fault::lost);
  Camera& camera = *devices().camera("c1");
  EXPECT_EQ(description("c1").state, DeviceState::absent);
  EXPECT_EQ(description("c1").trouble, "c1 is not there");
  EXPECT_THAT(log_.lines, ElementsAre(HasSubstr("c1 is not there (camera c1 / open)")));
  EXPECT_EQ(camera.trigger().error().text(),
            "unavailable: camera c1 is not open: c1 is not there (camera c1 / trigger)");
  EXPECT_EQ(camera.info().width_px, 0);
  ASSERT_TRUE(devices().reopen("c1"));
  EXPECT_TRUE(camera.trigger());
  EXPECT_EQ(camera.info().width_px, 8);
}

TEST_F(DeviceSetTest, ReopeningADeviceNobodyKnowsIsInvalid) {
  EXPECT_EQ(devices().reopen("c9").error().text(), "invalid: there is no device 'c9'");
}

TEST_F(DeviceSetTest, AKeyNobodyAskedForIsAnError) {
  specs_.cameras[1].settings.set("exposre", 1.0, 14);
  EXPECT_EQ(open().error().text(),
            "invalid: fake.toml:14: unknown key 'camera.c1.exposre' (camera c1 / open)");
  specs_ = fake_.specs();
  specs_.drivers[0].settings.set("colour", std::string("red"), 3);
  EXPECT_EQ(open().error().text(),
            "invalid: fake.toml:3: unknown key 'driver.fake.colour' (driver fake)");
  specs_.drivers[0].place = "fake.toml:2";
  EXPECT_EQ(open().error().where, "fake.toml:2 / driver fake");
  specs_ = fake_.specs();
  specs_.cameras[1].settings.set("exposre", 1.0, 14);
  specs_.cameras[1].place = "fake.toml:12";
  EXPECT_EQ(open().error().where, "fake.toml:12 / camera c1 / open");
}

TEST_F(DeviceSetTest, WrongConfigurationsAreRefused) {
  specs_.displays[0].driver = "nobody";
  EXPECT_EQ(open().error().what, "display d0: there is no [driver.nobody]");
  specs_ = fake_.specs();
  specs_.displays[0].name = "c0";
  EXPECT_EQ(open().error().what, "two devices are called 'c0'");
  specs_ = fake_.specs();
  specs_.turntables.push_back(specs_.turntables[0]);
  specs_.turntables[1].name = "second";
  EXPECT_THAT(open().error().what, HasSubstr("a rig has one turntable"));
  specs_ = fake_.specs();
  specs_.drivers[0].use = "absent";
  EXPECT_EQ(open().error().where, "driver fake");
}

TEST_F(DeviceSetTest, AnotherThreadIsRefusedButMayHalt) {
  Camera& camera = *devices().camera("c0");
  std::thread([&] {
    EXPECT_EQ(camera.trigger().error().code, Code::internal);
    EXPECT_EQ(devices_->reopen("c0").error().code, Code::internal);
    devices_->halt_all();
    EXPECT_THAT(devices_->describe(), SizeIs(5));
    EXPECT_FALSE(devices_->call_in_progress());
  }).join();
  EXPECT_EQ(fake_.halts(), 1);
  EXPECT_THAT(fake_.calls("c0", "trigger"), IsEmpty());
  std::thread([&] {
    devices_->bind_to_this_thread();
    EXPECT_TRUE(camera.trigger());
  }).join();
  devices_->bind_to_this_thread();
}

TEST_F(DeviceSetTest, ACallThatHasNotReturnedCanBeNamed) {
  std::optional<CallInProgress> seen;
  devices();
  fake_.at_call(fake_.call_count() + 1, [&] { seen = devices_->call_in_progress(); });
  ASSERT_TRUE(devices().display("d1")->show(picture(), {}));
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->device, "d1");
  EXPECT_EQ(seen->call, "show");
  EXPECT_FALSE(devices_->call_in_progress());
}

TEST_F(DeviceSetTest, ACallThatTakesTooLongIsLogged) {
  devices();
  fake_.at_call(fake_.call_count() + 1,
                [&] { (void)clock_.sleep_until(clock_.now() + Micros{3'000'000}, {}); });
  ASSERT_TRUE(devices().display("d1")->show(picture(), {}));
  EXPECT_THAT(log_.lines, ElementsAre("display d1 / show came back 1000000 us later than allowed"));
}

/// Halting while the rig lane opens the table again must never meet a table half gone.
TEST_F(DeviceSetTest, HaltingWhileReopeningIsSafe) {
  devices();
  std::jthread halter([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) devices_->halt_all();
  });
  for (int i = 0; i < 200; ++i) ASSERT_TRUE(devices().reopen("table"));
}

}  // namespace
}  // namespace alhazen
