#include "daemon/jobs/job.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace alhazen {
namespace {

using nlohmann::json;
using S = JobState;

constexpr S kAll[] = {S::queued, S::running,        S::paused, S::interrupted,
                      S::done,   S::done_with_gaps, S::failed, S::cancelled};

TEST(JobState, FinalStatesHaveNoSuccessorAndTheOthersReachOne) {
  for (const S state : kAll) {
    const bool is_end = state == S::done || state == S::done_with_gaps || state == S::failed ||
                        state == S::cancelled;
    EXPECT_EQ(is_final(state), is_end) << name_of(state);
    EXPECT_FALSE(may_become(state, state)) << name_of(state);
    EXPECT_EQ(may_become(state, S::cancelled), !is_end) << name_of(state);
  }
}

TEST(JobState, OnlyRunningWorkIsDone) {
  for (const S state : kAll) {
    EXPECT_EQ(may_become(state, S::done), state == S::running);
    EXPECT_EQ(may_become(state, S::done_with_gaps), state == S::running);
    EXPECT_EQ(may_become(state, S::paused), state == S::running);
    // A failed job is never resumable, an interrupted one always.
    EXPECT_EQ(may_become(state, S::queued), state == S::interrupted);
  }
}

TEST(JobState, NamesAreFoundAgain) {
  for (const S state : kAll) EXPECT_EQ(job_state(name_of(state)), state);
  for (const JobKind kind : {JobKind::scan, JobKind::reconstruct, JobKind::check, JobKind::preview})
    EXPECT_EQ(job_kind(name_of(kind)), kind);
  EXPECT_FALSE(job_state("finished"));
  EXPECT_FALSE(job_kind(""));
}

TEST(JobState, ErrorsEndAJobByWhoMustReact) {
  for (const Code code : {Code::timeout, Code::corrupt, Code::unavailable, Code::exhausted})
    EXPECT_EQ(end_state({code, ""}), S::interrupted) << name_of(code);
  for (const Code code : {Code::invalid, Code::conflict, Code::unsupported, Code::internal})
    EXPECT_EQ(end_state({code, ""}), S::failed) << name_of(code);
}

TEST(Job, SurvivesItsRecord) {
  Job job;
  job.id = "j17", job.kind = JobKind::reconstruct, job.state = S::interrupted;
  job.scan = "0004-bunny";
  job.created_at = "2026-11-22T01:02:03.456Z", job.started_at = job.created_at;
  job.stage("steps") = {"steps", 0.25, 10, 40};
  job.stage("vote").share = 0.5;
  job.error = Error{Code::timeout, "no frame", "camera c0"};
  for (int i = 0; i < 30; ++i) job.warn("warning " + std::to_string(i));
  job.retakes = 3, job.elapsed_s = 1.5, job.remaining_s = 2.5;
  job.request = std::make_shared<const json>(json{{"level", 8}});
  job.result = std::make_shared<const json>(json{{"files", {{"mesh", "mesh.ply"}}}});
  const std::string text = to_json(job).dump();
  const auto back = parse_job(text);
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(to_json(*back).dump(), text);
  EXPECT_EQ(back->warnings.size(), Job::kMostWarnings);
  EXPECT_EQ(back->warnings.back(), "warning 29");
  EXPECT_EQ(back->warning_count, 30U);
}

TEST(Job, DamagedRecordsAreErrors) {
  Job job;
  job.id = "j1", job.request = std::make_shared<const json>(json::object());
  const json good = to_json(job);
  for (const auto& [key, unused] : good.items()) {
    json without = good;
    without.erase(key);
    EXPECT_FALSE(parse_job(without.dump())) << key;
    json wrong = good;
    wrong[key] = json::array({1});
    EXPECT_FALSE(parse_job(wrong.dump())) << key;
  }
  const std::string text = good.dump();
  for (std::size_t length = 0; length < text.size(); ++length)
    EXPECT_FALSE(parse_job(std::string_view(text).substr(0, length)));
}

TEST(Job, TimeIsIsoInUtc) {
  EXPECT_THAT(utc_now(),
              testing::MatchesRegex("[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2}\\."
                                    "[0-9]{3}Z"));
}

}  // namespace
}  // namespace alhazen
