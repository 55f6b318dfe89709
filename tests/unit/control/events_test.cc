#include "daemon/control/events.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "daemon/control/message.h"

namespace alhazen {
namespace {

using nlohmann::json;

TEST(EventLog, NumbersRiseByOneAndTheLastOnesAreKept) {
  EventLog log("e1", 3);
  for (int i = 1; i <= 5; ++i) {
    const auto& event = log.add("scan.progress", json{{"i", i}});
    EXPECT_EQ(event.seq, static_cast<std::uint64_t>(i));
    const json text = json::parse(event.text);
    EXPECT_EQ(text["topic"], "scan.progress");
    EXPECT_EQ(text["epoch"], "e1");
    EXPECT_EQ(text["seq"], i);
    EXPECT_EQ(text["body"]["i"], i);
  }
  const auto all = log.replay("e1", 0, 100);
  ASSERT_TRUE(all);
  EXPECT_EQ((*all)["lost"], 2);
  ASSERT_EQ((*all)["events"].size(), 3U);
  EXPECT_EQ((*all)["events"][0]["seq"], 3);
  EXPECT_EQ((*all)["next"], 5);
}

TEST(EventLog, ReplayGoesOnWhereTheAnswerBeforeEnded) {
  EventLog log("e1", 100);
  for (int i = 0; i < 10; ++i) log.add("a", json::object());
  std::uint64_t after = 0;
  int seen = 0;
  while (after < log.last()) {
    const auto part = log.replay("", after, 4);
    ASSERT_TRUE(part);
    for (const json& event : (*part)["events"]) EXPECT_EQ(event["seq"], ++seen);
    EXPECT_GT((*part)["next"].get<std::uint64_t>(), after);
    after = (*part)["next"].get<std::uint64_t>();
  }
  EXPECT_EQ(seen, 10);
  const auto none = log.replay("e1", 10, 4);
  ASSERT_TRUE(none);
  EXPECT_TRUE((*none)["events"].empty());
  EXPECT_EQ((*none)["next"], 10);
}

TEST(EventLog, AnAnswerStaysWithinTheLimitOfAMessage) {
  EventLog log("e1", 100);
  for (int i = 0; i < 20; ++i) log.add("a", json(std::string(100'000, 'x')));
  std::uint64_t after = 0;
  int parts = 0;
  for (; after < 20; ++parts) {
    const auto part = log.replay("e1", after, 1000);
    ASSERT_TRUE(part);
    EXPECT_LT(dump(*part).size(), kLargestMessage);
    after = (*part)["next"].get<std::uint64_t>();
  }
  EXPECT_GT(parts, 1);
}

TEST(EventLog, AnotherEpochAndTheFutureAreErrors) {
  EventLog log("e1", 3);
  log.add("a", json::object());
  EXPECT_EQ(log.replay("e0", 0, 1).error().code, Code::conflict);
  EXPECT_EQ(log.replay("e1", 2, 1).error().code, Code::invalid);
}

}  // namespace
}  // namespace alhazen
