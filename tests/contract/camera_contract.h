#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "alhazen/camera.h"
#include "tests/contract/subject.h"

namespace alhazen::contract {

/// What every camera driver must do (drivers/api/alhazen/camera.h). Instantiate it with subjects:
///   INSTANTIATE_TEST_SUITE_P(Sim, CameraContract, testing::Values(…));
class CameraContract : public testing::TestWithParam<Subject<Camera>> {
 protected:
  void SetUp() override { reopen(); }

  void reopen() {
    camera_.reset();
    auto opened = GetParam().open();
    ASSERT_TRUE(opened) << opened.error().text();
    camera_ = *std::move(opened);
  }
  [[nodiscard]] Time now() const { return GetParam().clock->now(); }
  [[nodiscard]] Time soon() const {
    return now() + Micros(10'000'000) + camera_->info().readout_max;
  }
  [[nodiscard]] CameraSettings plain() const {
    CameraSettings out;
    out.exposure =
        std::clamp(Micros(5000), camera_->info().exposure_min, camera_->info().exposure_max);
    return out;
  }

  /// Makes one call by its name in the state table.
  std::optional<Code> call(const std::string& name) {
    if (name == "configure") return code_of(camera_->configure(plain()));
    if (name == "configure wrongly") {
      CameraSettings wrong = plain();
      wrong.exposure = camera_->info().exposure_max + Micros(1);
      return code_of(camera_->configure(wrong));
    }
    if (name == "trigger") return code_of(camera_->trigger());
    if (name == "wait_frame") return code_of(camera_->wait_frame(soon(), {}));
    if (name == "wait_frame too short") return code_of(camera_->wait_frame(now(), {}));
    if (name == "wait_frame and stop") return code_of(camera_->wait_frame(soon(), stopped()));
    ADD_FAILURE() << "no such call: " << name;
    return std::nullopt;
  }

  std::unique_ptr<Camera> camera_;
};

/// "idle": nothing is pending; "pending": a frame was triggered and not yet fetched.
inline constexpr Transition kCameraTable[] = {
    {"idle", "configure", std::nullopt, "idle"},
    {"idle", "configure wrongly", Code::invalid, "idle"},
    {"idle", "trigger", std::nullopt, "pending"},
    {"idle", "wait_frame", Code::conflict, "idle"},
    {"idle", "wait_frame too short", Code::conflict, "idle"},
    {"idle", "wait_frame and stop", Code::conflict, "idle"},
    {"pending", "configure", Code::conflict, "pending"},
    {"pending", "configure wrongly", Code::conflict, "pending"},
    {"pending", "trigger", Code::conflict, "pending"},
    {"pending", "wait_frame", std::nullopt, "idle"},
    {"pending", "wait_frame too short", Code::timeout, "idle"},
    {"pending", "wait_frame and stop", Code::cancelled, "idle"},
};

TEST_P(CameraContract, AnswersEveryCallInEveryState) {
  for (const Transition& row : kCameraTable) {
    SCOPED_TRACE(std::string(row.state) + " / " + row.call);
    reopen();
    ASSERT_EQ(text_of(call("configure")), "success");
    if (std::string(row.state) == "pending") {
      ASSERT_EQ(text_of(call("trigger")), "success");
    }
    EXPECT_EQ(text_of(call(row.call)), text_of(row.answer));
    // A frame is pending exactly where one can be fetched.
    EXPECT_EQ(text_of(call("wait_frame")),
              std::string(row.next) == "pending" ? "success" : "conflict");
  }
}

TEST_P(CameraContract, RefusesWhatItsInfoExcludesAndKeepsItsSettings) {
  const CameraInfo& info = camera_->info();
  const CameraSettings good = plain();
  const auto set = camera_->configure(good);
  ASSERT_TRUE(set) << set.error().text();
  std::vector<CameraSettings> wrong(8, good);
  wrong[0].exposure = info.exposure_min - Micros(1);
  wrong[1].exposure = info.exposure_max + Micros(1);
  wrong[2].gain_db = info.gain_max_db + 1;
  wrong[3].gain_db = info.gain_min_db - 1;
  wrong[4].gain_db = std::numeric_limits<double>::quiet_NaN();
  wrong[5].region = {1, 0, info.width_px, info.height_px};
  wrong[6].region = {0, 0, info.width_px, info.height_px + 1};
  wrong[7].region = {-1, 0, 8, 8};
  for (std::size_t i = 0; i < wrong.size(); ++i)
    EXPECT_EQ(text_of(code_of(camera_->configure(wrong[i]))), "invalid") << i;
  ASSERT_TRUE(camera_->trigger());
  const auto frame = camera_->wait_frame(soon(), {});
  ASSERT_TRUE(frame) << frame.error().text();
  EXPECT_TRUE(frame->settings == *set);
}

TEST_P(CameraContract, FramesAreTakenWithWhatConfigureAnswered) {
  const CameraInfo& info = camera_->info();
  CameraSettings wanted = plain();
  for (const double share : {0.0, 0.37, 1.0}) {
    wanted.gain_db = info.gain_min_db + share * (info.gain_max_db - info.gain_min_db);
    wanted.exposure = std::min(
        info.exposure_max, info.exposure_min + Micros(static_cast<std::int64_t>(share * 20'000)));
    wanted.region = {info.width_px / 4, info.height_px / 4, info.width_px / 2, info.height_px / 2};
    const auto set = camera_->configure(wanted);
    ASSERT_TRUE(set) << set.error().text();
    const Time before = now();
    const auto ends = camera_->trigger();
    ASSERT_TRUE(ends) << ends.error().text();
    const auto frame = camera_->wait_frame(soon(), {});
    ASSERT_TRUE(frame) << frame.error().text();
    EXPECT_TRUE(frame->settings == *set);
    EXPECT_EQ(frame->image.width(), set->region.width);
    EXPECT_EQ(frame->image.height(), set->region.height);
    EXPECT_EQ(frame->image.bits(), info.bits);
    EXPECT_GE(frame->exposure_begin, before);
    EXPECT_LE(frame->exposure_begin + set->exposure, frame->exposure_end + Micros(1));
    EXPECT_LE(frame->exposure_end, *ends);
  }
}

TEST_P(CameraContract, AnEmptyRegionMeansTheWholeSensor) {
  ASSERT_TRUE(camera_->configure(plain()));
  ASSERT_TRUE(camera_->trigger());
  const auto frame = camera_->wait_frame(soon(), {});
  ASSERT_TRUE(frame) << frame.error().text();
  EXPECT_EQ(frame->image.width(), camera_->info().width_px);
  EXPECT_EQ(frame->image.height(), camera_->info().height_px);
}

TEST_P(CameraContract, CountsItsFrames) {
  ASSERT_TRUE(camera_->configure(plain()));
  std::uint64_t last = 0;
  Time last_end{};
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(camera_->trigger());
    const auto frame = camera_->wait_frame(soon(), {});
    ASSERT_TRUE(frame) << frame.error().text();
    if (i > 0) {
      EXPECT_GT(frame->device_counter, last);
      EXPECT_GE(frame->exposure_begin, last_end);
    }
    last = frame->device_counter;
    last_end = frame->exposure_end;
  }
}

TEST_P(CameraContract, KeepsItsDeadline) {
  ASSERT_TRUE(camera_->configure(plain()));
  ASSERT_TRUE(camera_->trigger());
  const Time deadline = now() + Micros(100);
  ASSERT_EQ(text_of(code_of(camera_->wait_frame(deadline, {}))), "timeout");
  EXPECT_LE(now(), deadline + kDeadlineSlack);
  // It can be triggered again at once.
  ASSERT_TRUE(camera_->trigger());
  EXPECT_TRUE(camera_->wait_frame(soon(), {}));
}

TEST_P(CameraContract, DeliversWithinItsReadoutTime) {
  ASSERT_TRUE(camera_->configure(plain()));
  const auto ends = camera_->trigger();
  ASSERT_TRUE(ends);
  EXPECT_TRUE(camera_->wait_frame(*ends + camera_->info().readout_max, {}));
}

TEST_P(CameraContract, ReadsItsFiguresAtAnyTime) {
  for (const Reading& reading : camera_->readings()) {
    EXPECT_FALSE(reading.name.empty());
    EXPECT_TRUE(std::isfinite(reading.value));
  }
  ASSERT_TRUE(camera_->trigger());
  (void)camera_->readings();
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(CameraContract);

}  // namespace alhazen::contract
