#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "alhazen/turntable.h"
#include "tests/contract/subject.h"

namespace alhazen::contract {

/// What every turntable driver must do (drivers/api/alhazen/turntable.h).
class TurntableContract : public testing::TestWithParam<Subject<Turntable>> {
 protected:
  void SetUp() override { reopen(); }
  void TearDown() override {
    if (table_) table_->halt();
  }

  void reopen() {
    table_.reset();
    auto opened = GetParam().open();
    ASSERT_TRUE(opened) << opened.error().text();
    table_ = *std::move(opened);
  }
  [[nodiscard]] Time now() const { return GetParam().clock->now(); }
  [[nodiscard]] Time late() const { return now() + std::chrono::minutes(5); }
  [[nodiscard]] bool endless() const { return table_->info().min_rad == table_->info().max_rad; }
  /// An angle within the travel; `share` 0 … 1.
  [[nodiscard]] double angle(double share) const {
    const TurntableInfo& info = table_->info();
    return endless() ? share * 6 : info.min_rad + share * (info.max_rad - info.min_rad);
  }
  std::optional<Code> call(const std::string& name) {
    if (name == "home") return code_of(table_->home(late(), {}));
    if (name == "home and stop") return code_of(table_->home(late(), stopped()));
    if (name == "move_to") return code_of(table_->move_to(angle(0.4), late(), {}));
    if (name == "move_to nowhere")
      return code_of(table_->move_to(std::numeric_limits<double>::quiet_NaN(), late(), {}));
    if (name == "move_to too short") return code_of(table_->move_to(angle(0.9), now(), {}));
    if (name == "move_to and stop") return code_of(table_->move_to(angle(0.9), late(), stopped()));
    ADD_FAILURE() << "no such call: " << name;
    return std::nullopt;
  }

  std::unique_ptr<Turntable> table_;
};

/// "opened": the reference is not known; "homed": it is.
inline constexpr Transition kTurntableTable[] = {
    {"opened", "home", std::nullopt, "homed"},
    {"opened", "home and stop", Code::cancelled, "opened"},
    {"opened", "move_to", Code::conflict, "opened"},
    {"opened", "move_to nowhere", Code::invalid, "opened"},
    {"opened", "move_to too short", Code::conflict, "opened"},
    {"opened", "move_to and stop", Code::conflict, "opened"},
    {"homed", "home", std::nullopt, "homed"},
    {"homed", "move_to", std::nullopt, "homed"},
    {"homed", "move_to nowhere", Code::invalid, "homed"},
    {"homed", "move_to too short", Code::timeout, "homed"},
    {"homed", "move_to and stop", Code::cancelled, "homed"},
};

TEST_P(TurntableContract, AnswersEveryCallInEveryState) {
  for (const Transition& row : kTurntableTable) {
    SCOPED_TRACE(std::string(row.state) + " / " + row.call);
    reopen();
    if (std::string(row.state) == "homed") {
      ASSERT_EQ(text_of(call("home")), "success");
    }
    EXPECT_EQ(text_of(call(row.call)), text_of(row.answer));
    EXPECT_EQ(text_of(call("move_to")), std::string(row.next) == "homed" ? "success" : "conflict");
  }
}

TEST_P(TurntableContract, ArrivesWhereItWasSent) {
  ASSERT_TRUE(table_->home(late(), {}));
  for (const double share : {0.1, 0.5, 0.45, 0.9, 0.2}) {
    const auto measured = table_->move_to(angle(share), late(), {});
    ASSERT_TRUE(measured) << measured.error().text();
    // Coming back from above may cost its backlash: half a degree is a broken table.
    EXPECT_NEAR(*measured, angle(share), table_->info().repeatability_rad + 0.01);
  }
}

TEST_P(TurntableContract, ComesBackWithinItsRepeatability) {
  ASSERT_TRUE(table_->home(late(), {}));
  double first = 0;
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(table_->move_to(angle(0.2), late(), {}));
    const auto measured = table_->move_to(angle(0.5), late(), {});
    ASSERT_TRUE(measured);
    if (i == 0) first = *measured;
    EXPECT_NEAR(*measured, first, 2 * table_->info().repeatability_rad);
  }
}

TEST_P(TurntableContract, TakesTheTimeThatItsInfoSays) {
  const TurntableInfo& info = table_->info();
  ASSERT_TRUE(table_->home(late(), {}));
  ASSERT_TRUE(table_->move_to(angle(0.1), late(), {}));
  const Time begin = now();
  ASSERT_TRUE(table_->move_to(angle(0.8), late(), {}));
  const double taken_s = static_cast<double>((now() - begin).count()) * 1e-6;
  EXPECT_GE(taken_s, 0.9 * std::abs(angle(0.8) - angle(0.1)) / info.speed_rad_s);
}

TEST_P(TurntableContract, RefusesWhatIsOutOfItsTravel) {
  ASSERT_TRUE(table_->home(late(), {}));
  EXPECT_EQ(text_of(code_of(table_->move_to(std::numeric_limits<double>::infinity(), late(), {}))),
            "invalid");
  if (endless()) return;
  EXPECT_EQ(text_of(code_of(table_->move_to(table_->info().max_rad + 0.01, late(), {}))),
            "invalid");
  EXPECT_EQ(text_of(code_of(table_->move_to(table_->info().min_rad - 0.01, late(), {}))),
            "invalid");
}

TEST_P(TurntableContract, KeepsItsDeadline) {
  ASSERT_TRUE(table_->home(late(), {}));
  const Time deadline = now() + Micros(1000);
  ASSERT_EQ(text_of(code_of(table_->move_to(angle(0.9), deadline, {}))), "timeout");
  EXPECT_LE(now(), deadline + kDeadlineSlack);
}

TEST_P(TurntableContract, MayBeHaltedAtAnyTime) {
  table_->halt();
  ASSERT_TRUE(table_->home(late(), {}));
  table_->halt();
  (void)table_->readings();
  EXPECT_TRUE(table_->move_to(angle(0.3), late(), {}));
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(TurntableContract);

}  // namespace alhazen::contract
