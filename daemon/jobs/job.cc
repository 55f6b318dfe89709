#include "daemon/jobs/job.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>
#include <utility>

#include "alhazen/caught.h"

namespace alhazen {
namespace {

using nlohmann::json;

constexpr std::array<std::string_view, 4> kKinds = {"scan", "reconstruct", "check", "preview"};
constexpr std::array<std::string_view, 8> kStates = {
    "queued", "running", "paused", "interrupted", "done", "done_with_gaps", "failed", "cancelled"};

template <class Enum, std::size_t n>
std::optional<Enum> named(const std::array<std::string_view, n>& names, std::string_view name) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end()) return std::nullopt;
  return static_cast<Enum>(found - names.begin());
}

constexpr JobState kAfterQueued[] = {JobState::running, JobState::cancelled, JobState::interrupted};
constexpr JobState kAfterRunning[] = {JobState::paused, JobState::interrupted,
                                      JobState::done,   JobState::done_with_gaps,
                                      JobState::failed, JobState::cancelled};
constexpr JobState kAfterPaused[] = {JobState::running, JobState::interrupted, JobState::failed,
                                     JobState::cancelled};
constexpr JobState kAfterInterrupted[] = {JobState::queued, JobState::cancelled};

}  // namespace

std::string_view name_of(JobKind kind) noexcept { return kKinds[static_cast<std::size_t>(kind)]; }
std::string_view name_of(JobState state) noexcept {
  return kStates[static_cast<std::size_t>(state)];
}
std::optional<JobKind> job_kind(std::string_view name) noexcept {
  return named<JobKind>(kKinds, name);
}
std::optional<JobState> job_state(std::string_view name) noexcept {
  return named<JobState>(kStates, name);
}

std::span<const JobState> successors(JobState from) noexcept {
  switch (from) {
    case JobState::queued:
      return kAfterQueued;
    case JobState::running:
      return kAfterRunning;
    case JobState::paused:
      return kAfterPaused;
    case JobState::interrupted:
      return kAfterInterrupted;
    case JobState::done:
    case JobState::done_with_gaps:
    case JobState::failed:
    case JobState::cancelled:
      break;
  }
  return {};
}

bool may_become(JobState from, JobState to) noexcept {
  const auto next = successors(from);
  return std::find(next.begin(), next.end(), to) != next.end();
}

bool is_final(JobState state) noexcept { return successors(state).empty(); }

bool is_at_rest(JobState state) noexcept {
  return is_final(state) || state == JobState::interrupted;
}

JobState end_state(const Error& error) noexcept {
  switch (error.code) {
    case Code::timeout:
    case Code::corrupt:
    case Code::unavailable:
    case Code::exhausted:
    case Code::cancelled:
      return JobState::interrupted;
    case Code::invalid:
    case Code::conflict:
    case Code::unsupported:
    case Code::internal:
      return JobState::failed;
  }
  return JobState::failed;
}

void Job::warn(std::string line) {
  ++warning_count;
  if (warnings.size() == kMostWarnings) warnings.erase(warnings.begin());
  warnings.push_back(std::move(line));
}

StageProgress& Job::stage(std::string_view name) {
  for (StageProgress& known : stages)
    if (known.stage == name) return known;
  stages.push_back({std::string(name), 0, 0, 0});
  return stages.back();
}

json to_json(const Job& job) {
  json stages = json::array();
  for (const StageProgress& stage : job.stages) {
    json row = {{"stage", stage.stage}, {"share", stage.share}};
    if (stage.total > 0) row.update({{"done", stage.done}, {"total", stage.total}});
    stages.push_back(std::move(row));
  }
  json made = {{"id", job.id},
               {"kind", std::string(name_of(job.kind))},
               {"state", std::string(name_of(job.state))},
               {"scan", job.scan},
               {"created_at", job.created_at},
               {"started_at", job.started_at},
               {"ended_at", job.ended_at},
               {"stages", std::move(stages)},
               {"pausing", job.pausing},
               {"pause_reason", job.pause_reason},
               {"warnings", job.warnings},
               {"warning_count", job.warning_count},
               {"retakes", job.retakes},
               {"elapsed_s", job.elapsed_s},
               {"remaining_s", job.remaining_s},
               {"request", job.request ? *job.request : json::object()}};
  if (job.error)
    made["error"] = {{"code", std::string(name_of(job.error->code))},
                     {"what", job.error->what},
                     {"where", job.error->where}};
  if (job.result) made["result"] = *job.result;
  return made;
}

Result<Job> parse_job(std::string_view text) {
  return caught(Code::corrupt, "job record", [&]() -> Result<Job> {
    const json record = json::parse(text);
    Job job;
    job.id = record.at("id").get<std::string>();
    const auto kind = job_kind(record.at("kind").get<std::string>());
    const auto state = job_state(record.at("state").get<std::string>());
    if (!kind) return Error{Code::corrupt, "job record: key 'kind' names no kind of job"};
    if (!state) return Error{Code::corrupt, "job record: key 'state' names no state of a job"};
    job.kind = *kind, job.state = *state;
    job.scan = record.at("scan").get<std::string>();
    job.created_at = record.at("created_at").get<std::string>();
    job.started_at = record.at("started_at").get<std::string>();
    job.ended_at = record.at("ended_at").get<std::string>();
    for (const json& row : record.at("stages"))
      job.stages.push_back({row.at("stage").get<std::string>(), row.at("share").get<double>(),
                            row.value("done", std::uint64_t{0}),
                            row.value("total", std::uint64_t{0})});
    job.pausing = record.at("pausing").get<bool>();
    job.pause_reason = record.at("pause_reason").get<std::string>();
    job.warnings = record.at("warnings").get<std::vector<std::string>>();
    job.warning_count = record.at("warning_count").get<std::uint64_t>();
    job.retakes = record.at("retakes").get<std::uint64_t>();
    job.elapsed_s = record.at("elapsed_s").get<double>();
    job.remaining_s = record.at("remaining_s").get<double>();
    job.request = std::make_shared<const json>(record.at("request"));
    if (!job.request->is_object())
      return Error{Code::corrupt, "job record: key 'request' is no object"};
    if (record.contains("error")) {
      Error error;
      const std::string code = record.at("error").at("code").get<std::string>();
      for (int i = 0; i <= static_cast<int>(Code::internal); ++i)
        if (code == name_of(static_cast<Code>(i))) error.code = static_cast<Code>(i);
      error.what = record.at("error").at("what").get<std::string>();
      error.where = record.at("error").at("where").get<std::string>();
      job.error = std::move(error);
    }
    if (record.contains("result")) job.result = std::make_shared<const json>(record.at("result"));
    return job;
  });
}

std::string utc_now() {
  const auto now = std::chrono::system_clock::now();
  const auto millis =
      std::chrono::duration_cast<std::chrono::milliseconds>(now.time_since_epoch()).count();
  const std::time_t seconds = static_cast<std::time_t>(millis / 1000);
  std::tm parts{};
  gmtime_r(&seconds, &parts);
  char text[32];
  const std::size_t length = std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &parts);
  char fraction[8];
  std::snprintf(fraction, sizeof fraction, ".%03dZ", static_cast<int>(millis % 1000));
  return std::string(text, length) + fraction;
}

}  // namespace alhazen
