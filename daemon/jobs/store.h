#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"
#include "daemon/jobs/job.h"

namespace alhazen {

/// A scan directory in short, as lists show it.
struct ScanEntry {
  std::string id, object_id, note, operator_name, created_at;
  std::string job;           ///< the job that took it; empty: the directory came from elsewhere
  std::uint64_t stacks = 0;  ///< planned light maps
  int level = 0;
  double edge_mm = 0;
};

/// An index of jobs and scans that survives restarts: SQLite in WAL mode, one small commit a
/// change. The truth is in the scan directories, from which it can be rebuilt; what only it holds
/// are jobs that have not started and answers stored under idempotency keys.
///
/// Thread: thread-bound (control thread).
class Store {
 public:
  /// Opens or makes the index. One that is damaged or of another version is put aside as
  /// FILE.damaged, and an empty one made; `was_rebuilt()` says so.
  /// Fails: unavailable (folder cannot be written), exhausted (disk), conflict (locked by another).
  [[nodiscard]] static Result<Store> open(const std::filesystem::path& file);
  Store(Store&&) noexcept;
  Store& operator=(Store&&) noexcept;
  ~Store();

  [[nodiscard]] bool is_new() const noexcept;
  [[nodiscard]] bool was_damaged() const noexcept;

  /// Writes a job as it stands; `order` is its place in the queue, `plan` the compiled manifest
  /// until the scan directory holds it.
  Status put(const Job& job, std::int64_t order, std::string_view plan);
  struct StoredJob {
    Job job;
    std::int64_t order = 0;
    std::string plan;
  };
  /// All jobs, oldest first. Records that cannot be read are left out and counted in `damaged`.
  [[nodiscard]] Result<std::vector<StoredJob>> jobs(std::uint64_t& damaged) const;
  Status drop_job(std::string_view id);

  Status put(const ScanEntry& scan);
  [[nodiscard]] Result<std::vector<ScanEntry>> scans() const;
  Status drop_scan(std::string_view id);

  struct StoredAnswer {
    std::string request;  ///< verb and arguments it answered
    std::string reply;    ///< the `ok` of the reply, as JSON
  };
  /// An answer stored under `key` less than `lifetime` before `now`.
  [[nodiscard]] Result<std::optional<StoredAnswer>> answer(
      std::string_view key, std::chrono::system_clock::time_point now) const;
  /// Keeps an answer; drops those older than a day and, beyond kMostAnswers, the oldest.
  Status put_answer(std::string_view key, const StoredAnswer& answer,
                    std::chrono::system_clock::time_point now);

  static constexpr std::chrono::hours kAnswerLifetime{24};
  static constexpr int kMostAnswers = 10'000;

  /// Groups several writes into one commit: all of them or none.
  Status begin();
  Status commit();
  void rollback() noexcept;

 private:
  struct State;
  explicit Store(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

}  // namespace alhazen
