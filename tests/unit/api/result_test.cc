#include "alhazen/result.h"

#include <gtest/gtest.h>

#include "alhazen/caught.h"
#include "alhazen/driver.h"
#include "alhazen/settings.h"

namespace alhazen {
namespace {

Result<int> half(int value) {
  if (value % 2 != 0) return Error{Code::invalid, std::to_string(value) + " is odd"};
  return value / 2;
}

Result<int> quarter(int value) { return ALHAZEN_TRY(half(ALHAZEN_TRY(half(value)))); }

TEST(Result, TryHandsOnTheFirstError) {
  EXPECT_EQ(*quarter(8), 2);
  const auto failed = quarter(6);
  ASSERT_FALSE(failed);
  EXPECT_EQ(failed.error().code, Code::invalid);
  EXPECT_EQ(failed.error().what, "3 is odd");
}

TEST(Result, ContextIsOutermostFirst) {
  const Error error = Error{Code::timeout, "no frame"}.in("camera left").in("scan 42");
  EXPECT_EQ(error.text(), "timeout: no frame (scan 42 / camera left)");
}

TEST(ResultDeathTest, ReadingAMissingValueAborts) {
  EXPECT_DEATH((void)*half(3), "broken invariant");
}

TEST(Caught, ExceptionsBecomeErrors) {
  const auto thrown =
      caught(Code::corrupt, "reading x", []() -> int { throw std::runtime_error("short"); });
  ASSERT_FALSE(thrown);
  EXPECT_EQ(thrown.error().text(), "corrupt: reading x: short");
  EXPECT_EQ(*caught(Code::corrupt, "", [] { return 4; }), 4);
  EXPECT_EQ(*caught(Code::corrupt, "", [] { return half(4); }), 2);
}

TEST(Settings, EveryComplaintNamesFileLineKeyAndRange) {
  Settings settings("rig.toml", "camera.left", "/etc/alhazen");
  settings.set("gain_db", 99.0, 12);
  settings.set("id", std::string("c0"), 13);
  EXPECT_EQ(settings.number("gain_db", 0, 24).error().what,
            "rig.toml:12: key 'camera.left.gain_db' is 99; it must be a number in [0, 24]");
  EXPECT_EQ(settings.text("serial").error().what,
            "rig.toml: key 'camera.left.serial' is missing; it must be text");
  EXPECT_EQ(settings.all_known().error().what, "rig.toml:13: unknown key 'camera.left.id'");
  EXPECT_EQ(*settings.path("id"), "/etc/alhazen/c0");
  EXPECT_TRUE(settings.all_known());
}

TEST(Settings, NotANumberIsOutOfEveryRange) {
  Settings settings("rig.toml", "", "");
  settings.set("x", std::nan(""), 1);
  EXPECT_FALSE(settings.number("x", -1e300, 1e300));
}

}  // namespace
}  // namespace alhazen
