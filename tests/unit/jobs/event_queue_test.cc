#include "daemon/jobs/event_queue.h"

#include <gtest/gtest.h>
#include <poll.h>

#include <thread>

namespace alhazen {
namespace {

bool readable(const EventQueue& queue) {
  pollfd item{queue.fd(), POLLIN, 0};
  return poll(&item, 1, 0) == 1;
}

LaneEvent told(const std::string& job, const std::string& stage, std::uint64_t done) {
  return {job, Told{{stage, 0, done, 10}, 0}};
}

TEST(EventQueue, IsReadableWhileSomethingWaits) {
  EventQueue queue;
  EXPECT_FALSE(readable(queue));
  queue.push({"j1", Warned{"x"}});
  EXPECT_TRUE(readable(queue));
  EXPECT_EQ(queue.take().size(), 1U);
  EXPECT_FALSE(readable(queue));
  EXPECT_TRUE(queue.take().empty());
}

TEST(EventQueue, ProgressOverwritesProgressOfTheSameStage) {
  EventQueue queue;
  for (std::uint64_t i = 0; i < 1000; ++i) {
    queue.push(told("j1", "steps", i));
    queue.push(told("j1", "decode", i));
    queue.push(told("j2", "steps", i));
  }
  const auto events = queue.take();
  ASSERT_EQ(events.size(), 3U);
  for (const LaneEvent& event : events) EXPECT_EQ(std::get<Told>(event.what).progress.done, 999U);
}

TEST(EventQueue, ProgressNeverOvertakesAnythingElse) {
  EventQueue queue;
  queue.push(told("j1", "steps", 1));
  queue.push({"j1", Ended{}});
  queue.push(told("j1", "steps", 2));
  const auto events = queue.take();
  ASSERT_EQ(events.size(), 3U);
  EXPECT_EQ(std::get<Told>(events[0].what).progress.done, 1U);
  EXPECT_TRUE(std::holds_alternative<Ended>(events[1].what));
}

TEST(EventQueue, NothingIsLostBetweenThreads) {
  EventQueue queue;
  constexpr int kEach = 2000;
  std::vector<std::jthread> senders;
  senders.reserve(3);
  for (int sender = 0; sender < 3; ++sender)
    senders.emplace_back([&queue, sender] {
      for (int i = 0; i < kEach; ++i)
        queue.push({"j" + std::to_string(sender), Warned{std::to_string(i)}});
    });
  std::vector<int> next(3);
  for (int seen = 0; seen < 3 * kEach;) {
    pollfd item{queue.fd(), POLLIN, 0};
    ASSERT_EQ(poll(&item, 1, 20'000), 1);
    for (const LaneEvent& event : queue.take()) {
      int& expected = next[static_cast<std::size_t>(event.job[1] - '0')];
      ASSERT_EQ(std::get<Warned>(event.what).line, std::to_string(expected++));
      ++seen;
    }
  }
}

}  // namespace
}  // namespace alhazen
