#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "alhazen/display.h"
#include "tests/contract/subject.h"

namespace alhazen::contract {

/// What every display driver must do (drivers/api/alhazen/display.h).
class DisplayContract : public testing::TestWithParam<Subject<Display>> {
 protected:
  void SetUp() override { reopen(); }

  void reopen() {
    display_.reset();
    auto opened = GetParam().open();
    ASSERT_TRUE(opened) << opened.error().text();
    display_ = *std::move(opened);
  }
  [[nodiscard]] Time now() const { return GetParam().clock->now(); }
  [[nodiscard]] static Picture grey(int width, int height, int value) {
    const std::vector<std::uint8_t> pixels(
        static_cast<std::size_t>(width) * static_cast<std::size_t>(height),
        static_cast<std::uint8_t>(value));
    return {Image::copy<std::uint8_t>(width, height, 8, pixels), std::nullopt};
  }
  std::optional<Code> call(const std::string& name) {
    const int width = display_->info().width_px, height = display_->info().height_px;
    if (name == "show") return code_of(display_->show(grey(width, height, 128), {}));
    if (name == "show too wide") return code_of(display_->show(grey(width + 1, height, 128), {}));
    if (name == "show too low") return code_of(display_->show(grey(width, height - 1, 128), {}));
    if (name == "show nothing") return code_of(display_->show(Picture{}, {}));
    if (name == "show and stop")
      return code_of(display_->show(grey(width, height, 128), stopped()));
    ADD_FAILURE() << "no such call: " << name;
    return std::nullopt;
  }

  std::unique_ptr<Display> display_;
};

/// "fresh": nothing was shown yet; "showing": a picture was.
inline constexpr Transition kDisplayTable[] = {
    {"fresh", "show", std::nullopt, "showing"},
    {"fresh", "show too wide", Code::invalid, "fresh"},
    {"fresh", "show too low", Code::invalid, "fresh"},
    {"fresh", "show nothing", Code::invalid, "fresh"},
    {"fresh", "show and stop", Code::cancelled, "fresh"},
    {"showing", "show", std::nullopt, "showing"},
    {"showing", "show too wide", Code::invalid, "showing"},
    {"showing", "show too low", Code::invalid, "showing"},
    {"showing", "show nothing", Code::invalid, "showing"},
    {"showing", "show and stop", Code::cancelled, "showing"},
};

TEST_P(DisplayContract, AnswersEveryCallInEveryState) {
  for (const Transition& row : kDisplayTable) {
    SCOPED_TRACE(std::string(row.state) + " / " + row.call);
    reopen();
    if (std::string(row.state) == "showing") {
      ASSERT_EQ(text_of(call("show")), "success");
    }
    EXPECT_EQ(text_of(call(row.call)), text_of(row.answer));
    // Whatever happened, the next picture can be shown.
    EXPECT_EQ(text_of(call("show")), "success");
  }
}

TEST_P(DisplayContract, SaysWhenItsLightIsSteady) {
  const DisplayInfo& info = display_->info();
  ASSERT_GT(info.width_px, 0);
  ASSERT_GT(info.height_px, 0);
  EXPECT_GT(info.refresh_hz, 0);
  for (const int value : {0, 255, 255, 7}) {
    const Time before = now();
    const auto steady = display_->show(grey(info.width_px, info.height_px, value), {});
    ASSERT_TRUE(steady) << steady.error().text();
    EXPECT_GE(*steady, before);
    EXPECT_LE(*steady, now() + std::chrono::seconds(5));
    ASSERT_TRUE(GetParam().clock->sleep_until(*steady, {}));
  }
}

TEST_P(DisplayContract, ReadsItsFiguresAtAnyTime) {
  for (const Reading& reading : display_->readings()) {
    EXPECT_FALSE(reading.name.empty());
    EXPECT_TRUE(std::isfinite(reading.value));
  }
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(DisplayContract);

}  // namespace alhazen::contract
