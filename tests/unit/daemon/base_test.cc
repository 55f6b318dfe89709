#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <numeric>
#include <thread>
#include <vector>

#include "daemon/base/bounded_queue.h"
#include "daemon/log.h"
#include "daemon/system_clock.h"
#include "daemon/virtual_clock.h"

namespace alhazen {
namespace {

TEST(BoundedQueue, EverythingArrivesInOrderThroughANarrowQueue) {
  BoundedQueue<std::unique_ptr<int>> queue(2);
  std::vector<int> arrived;
  std::jthread reader([&](const std::stop_token& stop) {
    while (auto item = queue.pop(stop)) arrived.push_back(**item);
  });
  for (int i = 0; i < 1000; ++i) ASSERT_TRUE(queue.push(std::make_unique<int>(i), {}));
  queue.close();
  reader.join();
  std::vector<int> all(1000);
  std::iota(all.begin(), all.end(), 0);
  EXPECT_EQ(arrived, all);
}

TEST(BoundedQueue, AFullQueueWaitsUntilStopped) {
  BoundedQueue<int> queue(1);
  ASSERT_TRUE(queue.push(1, {}));
  std::stop_source stop;
  std::thread other([&] { stop.request_stop(); });
  EXPECT_FALSE(queue.push(2, stop.get_token()));
  other.join();
  EXPECT_EQ(queue.size(), 1U);
}

TEST(BoundedQueue, AnEmptyQueueWaitsUntilStoppedOrClosed) {
  BoundedQueue<int> queue(1);
  std::stop_source stop;
  std::thread stopper([&] { stop.request_stop(); });
  EXPECT_FALSE(queue.pop(stop.get_token()));
  stopper.join();
  std::thread closer([&] { queue.close(); });
  EXPECT_FALSE(queue.pop({}));
  closer.join();
}

TEST(BoundedQueue, AClosedQueueHandsOutWhatIsLeftAndTakesNothing) {
  BoundedQueue<int> queue(2);
  ASSERT_TRUE(queue.push(1, {}));
  queue.close();
  EXPECT_FALSE(queue.push(2, {}));
  EXPECT_EQ(queue.pop({}), 1);
  EXPECT_EQ(queue.pop({}), std::nullopt);
}

TEST(VirtualClock, JumpsForwardOnly) {
  VirtualClock clock;
  const Time begin = clock.now();
  EXPECT_TRUE(clock.sleep_until(begin + Micros{5'000'000}, {}));
  EXPECT_EQ(clock.now() - begin, Micros{5'000'000});
  EXPECT_TRUE(clock.sleep_until(begin, {}));
  EXPECT_EQ(clock.now() - begin, Micros{5'000'000});
}

TEST(VirtualClock, DoesNotMoveForWhoIsStopped) {
  VirtualClock clock;
  const Time begin = clock.now();
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(clock.sleep_until(begin + Micros{1}, stop.get_token()));
  EXPECT_EQ(clock.now(), begin);
}

TEST(VirtualClock, SleepersOfManyThreadsLeaveItAtTheLatest) {
  VirtualClock clock;
  const Time begin = clock.now();
  std::vector<std::jthread> sleepers;
  sleepers.reserve(4);
  for (int t = 0; t < 4; ++t)
    sleepers.emplace_back([&, t] {
      for (int i = 0; i < 1000; ++i) {
        const Time when = begin + Micros{4 * i + t};
        EXPECT_TRUE(clock.sleep_until(when, {}));
        EXPECT_GE(clock.now(), when);
      }
    });
  sleepers.clear();
  EXPECT_EQ(clock.now() - begin, Micros{3999});
}

TEST(SystemClock, SleepsAtLeastUntilThenOrUntilStopped) {
  SystemClock clock;
  const Time when = clock.now() + Micros{2'000};
  EXPECT_TRUE(clock.sleep_until(when, {}));
  EXPECT_GE(clock.now(), when);
  EXPECT_TRUE(clock.sleep_until(clock.now() - Micros{1}, {}));

  std::stop_source stop;
  std::thread other([&] { stop.request_stop(); });
  EXPECT_FALSE(clock.sleep_until(clock.now() + std::chrono::hours(1), stop.get_token()));
  other.join();
}

TEST(StderrLog, WritesOneLineAnEventFromItsLevelOn) {
  testing::internal::CaptureStderr();
  {
    StderrLog log(Severity::info);
    log.write(Severity::debug, "hidden");
    log.write(Severity::warning, "first\nsecond {}");
    log.set_level(Severity::debug);
    log.write(Severity::debug, "shown");
  }
  const std::string written = testing::internal::GetCapturedStderr();
  EXPECT_THAT(written, testing::HasSubstr("first second {}\n"));
  EXPECT_THAT(written, testing::HasSubstr("shown\n"));
  EXPECT_THAT(written, testing::Not(testing::HasSubstr("hidden")));
  EXPECT_EQ(std::count(written.begin(), written.end(), '\n'), 2);
}

TEST(StderrLog, LevelsHaveNames) {
  EXPECT_EQ(*severity_of("warning"), Severity::warning);
  EXPECT_EQ(severity_of("loud").error().what,
            "level 'loud' is not one of debug, info, warning, error");
}

}  // namespace
}  // namespace alhazen
