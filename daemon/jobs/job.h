#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"

namespace alhazen {

enum class JobKind : std::uint8_t { scan, reconstruct, check, preview };

/// Where a job stands. `interrupted` is the resumable end, `failed` never is.
enum class JobState : std::uint8_t {
  queued,
  running,
  paused,
  interrupted,
  done,
  done_with_gaps,
  failed,
  cancelled,
};

[[nodiscard]] std::string_view name_of(JobKind kind) noexcept;
[[nodiscard]] std::string_view name_of(JobState state) noexcept;
[[nodiscard]] std::optional<JobKind> job_kind(std::string_view name) noexcept;
[[nodiscard]] std::optional<JobState> job_state(std::string_view name) noexcept;

/// The legal changes, as data: which states may follow `from`.
[[nodiscard]] std::span<const JobState> successors(JobState from) noexcept;
[[nodiscard]] bool may_become(JobState from, JobState to) noexcept;
/// done, done_with_gaps, failed, cancelled: nothing follows.
[[nodiscard]] bool is_final(JobState state) noexcept;
/// Final, or interrupted: no thread works on it.
[[nodiscard]] bool is_at_rest(JobState state) noexcept;

/// The state in which work ends that was neither stopped nor aborted: what an error means for the
/// job (house §7).
[[nodiscard]] JobState end_state(const Error& error) noexcept;

/// How far one stage of a job is.
struct StageProgress {
  std::string stage;                  ///< steps, decode, vote, surface
  double share = 0;                   ///< 0 … 1
  std::uint64_t done = 0, total = 0;  ///< where it is counted; total 0: it is not
};

/// One piece of work of the daemon. Data; changed by the control thread alone.
struct Job {
  std::string id;  ///< "j17"
  JobKind kind = JobKind::scan;
  JobState state = JobState::queued;
  std::string scan;  ///< id of the scan it is about; empty for check and preview
  std::string created_at, started_at, ended_at;  ///< ISO 8601 UTC; empty: not yet
  std::vector<StageProgress> stages;
  std::string pause_reason;  ///< operator, disk; empty unless pausing or paused
  bool pausing = false;      ///< asked to pause, not yet arrived
  std::optional<Error> error;
  std::vector<std::string> warnings;  ///< the last kMostWarnings
  std::uint64_t warning_count = 0;
  std::uint64_t retakes = 0;
  double elapsed_s = 0, remaining_s = 0;          ///< on the rig's clock; remaining 0: not known
  std::shared_ptr<const nlohmann::json> request;  ///< checked arguments of the submit; never null
  std::shared_ptr<const nlohmann::json> result;   ///< files and numbers; null until there are some

  static constexpr std::size_t kMostWarnings = 20;
  void warn(std::string line);
  StageProgress& stage(std::string_view name);
};

/// The job as the protocol and job.json write it.
[[nodiscard]] nlohmann::json to_json(const Job& job);
/// Reads to_json()'s text. Fails: corrupt, naming the key.
[[nodiscard]] Result<Job> parse_job(std::string_view text);

/// ISO 8601 in UTC with milliseconds, of the wall clock.
[[nodiscard]] std::string utc_now();

}  // namespace alhazen
