#include "daemon/capture/freshness.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace alhazen {
namespace {

using testing::HasSubstr;

constexpr Pattern kWhite{.kind = PatternKind::white};
constexpr Pattern kBlack{.kind = PatternKind::black};
constexpr Pattern kBit{.kind = PatternKind::gray, .bit = 3};
constexpr Pattern kInverse{.kind = PatternKind::gray, .bit = 3, .inverted = true};

/// Frames of a camera that is triggered every 100 ms.
class FreshnessTest : public testing::Test {
 protected:
  std::optional<Error> next(const Pattern& pattern, std::uint64_t checksum) {
    triggered_ += Micros{100'000};
    Frame frame;
    frame.exposure_begin = triggered_;
    frame.device_counter = ++counter_;
    return freshness_.judge(frame, checksum, pattern, triggered_);
  }
  Freshness freshness_;
  Time triggered_{Micros{1'000'000}};
  std::uint64_t counter_ = 0;
};

TEST_F(FreshnessTest, RisingCountersAndDifferentPixelsAreFresh) {
  EXPECT_FALSE(next(kWhite, 1));
  EXPECT_FALSE(next(kBlack, 2));
  EXPECT_FALSE(next(kBit, 3));
  EXPECT_FALSE(next(kInverse, 4));
  EXPECT_EQ(freshness_.confirmed_unchanged(), 0U);
}

TEST_F(FreshnessTest, ACounterThatHasNotRisenIsStale) {
  EXPECT_FALSE(next(kWhite, 1));
  --counter_;
  const auto error = next(kBlack, 2);
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, Code::corrupt);
  EXPECT_EQ(error->what, "stale frame: the device's counter is 1 after 1");
  // A camera that was opened again counts anew.
  freshness_.forget();
  counter_ = 0;
  EXPECT_FALSE(next(kBlack, 2));
}

TEST_F(FreshnessTest, AnExposureBeforeTheTriggerIsStaleButForTheClocksTolerance) {
  Frame frame;
  frame.device_counter = 1;
  frame.exposure_begin = triggered_ - kClockTolerance;
  EXPECT_FALSE(freshness_.judge(frame, 1, kWhite, triggered_));
  frame.device_counter = 2;
  frame.exposure_begin -= Micros{1};
  const auto error = freshness_.judge(frame, 2, kBlack, triggered_);
  ASSERT_TRUE(error);
  EXPECT_EQ(error->what, "stale frame: its exposure began 501 us before the trigger");
}

TEST_F(FreshnessTest, EqualPixelsAreSuspectOnceAndARetakeDecides) {
  EXPECT_FALSE(next(kWhite, 1));
  EXPECT_FALSE(next(kBlack, 2));
  EXPECT_FALSE(next(kBit, 3));
  const auto error = next(kInverse, 3);
  ASSERT_TRUE(error);
  EXPECT_THAT(error->what, HasSubstr("pixels equal those of the frame before"));
  EXPECT_FALSE(next(kInverse, 4));  // it was an old frame
  EXPECT_EQ(freshness_.confirmed_unchanged(), 0U);

  EXPECT_TRUE(next(kBit, 4));
  EXPECT_FALSE(next(kBit, 4));  // it really looks the same
  EXPECT_EQ(freshness_.confirmed_unchanged(), 1U);
  EXPECT_TRUE(next(kInverse, 4));  // and is suspect again the next time
}

TEST_F(FreshnessTest, TheSamePatternMayLookTheSame) {
  EXPECT_FALSE(next(kBit, 3));
  EXPECT_FALSE(next(kBit, 3));
}

TEST_F(FreshnessTest, WhereWhiteEqualsBlackNothingIsSuspectUntilTheNextStack) {
  EXPECT_FALSE(next(kWhite, 7));
  EXPECT_TRUE(next(kBlack, 7));
  EXPECT_FALSE(next(kBlack, 7));
  for (int i = 0; i < 5; ++i) {
    EXPECT_FALSE(next(kBit, 7));
    EXPECT_FALSE(next(kInverse, 7));
  }
  freshness_.begin_stack();
  EXPECT_TRUE(next(kWhite, 7));
}

TEST_F(FreshnessTest, AFrameThatTimedOutAfterASuspicionKeepsIt) {
  EXPECT_FALSE(next(kWhite, 1));
  EXPECT_TRUE(next(kBlack, 1));
  // The retake never arrived; the one after it decides.
  EXPECT_FALSE(next(kBlack, 1));
}

}  // namespace
}  // namespace alhazen
