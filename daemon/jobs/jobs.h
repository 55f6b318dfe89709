#pragma once

#include <chrono>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/driver.h"
#include "alhazen/result.h"
#include "daemon/jobs/event_queue.h"
#include "daemon/jobs/job.h"
#include "daemon/jobs/lane.h"
#include "daemon/jobs/requests.h"
#include "daemon/jobs/rig_room.h"
#include "daemon/jobs/scan_job.h"
#include "daemon/jobs/store.h"
#include "daemon/plan/estimate.h"
#include "daemon/plan/plan.h"

namespace alhazen {

/// Where the daemon works: constant once it runs.
struct Site {
  std::filesystem::path data_directory;     ///< holds scans/
  std::filesystem::path preview_directory;  ///< pictures of preview.take
  std::filesystem::path rig_file;
  Rig rig;
  std::vector<Preset> presets;
  std::string software_version;
  int arena_threads = 1;  ///< for reconstruction

  [[nodiscard]] std::filesystem::path scans() const { return data_directory / "scans"; }
};

/// What a submit answers.
struct Submitted {
  std::string job, scan;
};

/// Revision counters: one a collection, so a client fetches only what changed.
struct Revisions {
  std::uint64_t jobs = 0, devices = 0, config = 1, lock = 0;
};

/// Every job of the daemon and the two lanes that work on them. The rig lane runs one job at a
/// time; the compute lane reconstructs what the rig lane takes.
///
/// Thread: thread-bound (control thread): it alone changes the table, so there is no lock.
class Jobs {
 public:
  /// Hears of everything clients are to hear of.
  using Publish = std::function<void(std::string_view topic, const nlohmann::json& body)>;

  /// Reads the index, mends it by the scan directories, and finds what a daemon that ended too soon
  /// left behind: jobs that ran become `interrupted`.
  /// Fails: as Store; unavailable (the scan directories cannot be read).
  [[nodiscard]] static Result<std::unique_ptr<Jobs>> open(Site site, std::unique_ptr<RigRoom> room,
                                                          Log& log, Publish publish);
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;
  /// REQUIRES: closed(), or open_devices() was never called.
  ~Jobs();

  /// Opens the devices on the rig lane; DevicesChanged tells how it went.
  void open_devices();

  // What clients ask for, by the checked arguments of the verb. Submitting fails with conflict once
  // close() was called.
  using Args = std::shared_ptr<const nlohmann::json>;

  /// Queues scans, all or none. Fails: invalid, conflict (devices not open yet), exhausted (disk).
  [[nodiscard]] Result<std::vector<Submitted>> submit_scans(const std::vector<Args>& scans);
  /// What such a scan would take. Fails: as submit_scans().
  [[nodiscard]] Result<Estimate> estimate_scan(const nlohmann::json& args) const;
  /// Fails: invalid (unknown scan), conflict (it is still being taken).
  [[nodiscard]] Result<Submitted> submit_reconstruction(std::string_view scan, Args args);
  [[nodiscard]] Result<Submitted> submit_check(Args args);
  /// Fails: conflict (a scan runs or waits; devices not open yet).
  [[nodiscard]] Result<Submitted> submit_preview(Args args);

  // Fail: invalid (unknown job), conflict (wrong state; names it), unsupported (cannot pause).
  Status pause(std::string_view id, HoldAt at);
  Status resume(std::string_view id);
  Status stop(std::string_view id);
  Status abort(std::string_view id);

  /// Lets a queue go on that an error has stopped. True: it had been stopped.
  bool start_queue();

  // From memory.
  [[nodiscard]] const Job* find(std::string_view id) const;
  /// In the order of their creation.
  [[nodiscard]] std::vector<const Job*> list() const;
  [[nodiscard]] const std::vector<ScanEntry>& scans() const noexcept { return scans_; }
  [[nodiscard]] const ScanEntry* find_scan(std::string_view id) const;
  /// Why the queue does not go on; empty: it does.
  [[nodiscard]] const std::string& queue_held() const noexcept { return queue_held_; }
  [[nodiscard]] const Revisions& revisions() const noexcept { return revisions_; }
  /// Null until the devices are open, and again while they are being closed.
  [[nodiscard]] DeviceSet* devices() const noexcept { return devices_; }
  /// Why the devices could not be opened at all: the daemon cannot work.
  [[nodiscard]] const std::optional<Error>& fault() const noexcept { return fault_; }
  [[nodiscard]] const Site& site() const noexcept { return site_; }
  [[nodiscard]] Store& store() noexcept { return store_; }

  // The control thread's loop.

  /// Readable when events() has something to do.
  [[nodiscard]] int event_fd() const noexcept { return events_.fd(); }
  /// Takes in what the lanes told.
  void take_events();
  /// What has to be done now and then: publishes progress, looks at the devices. Returns how long
  /// the loop may sleep at most.
  std::chrono::milliseconds tick();
  /// A lane that gave no sign of life for longer than it may; empty: all is well.
  [[nodiscard]] std::string silent_lane() const;

  /// No new work; stops what runs (it can be resumed), then closes the devices.
  void close();
  [[nodiscard]] bool closing() const noexcept { return closing_; }
  [[nodiscard]] bool closed() const noexcept { return closed_; }
  /// What close() still waits for, for the log: "rig lane: camera c0 wait_frame".
  [[nodiscard]] std::string waiting_for() const;

 private:
  enum class Ending : std::uint8_t { none, stop, abort, shutdown };
  struct Entry {
    Job job;
    std::int64_t place = 0;  ///< in the queue; lower first
    std::string plan;        ///< compiled manifest, until the scan directory holds it
    std::shared_ptr<ScanWork> work;
    std::stop_source stop;
    Ending ending = Ending::none;
    bool on_rig = false, on_compute = false;  ///< a lane works on it
    bool wants_compute = false;               ///< light maps wait for the compute lane
    bool gaps = false, untold = false;
    std::optional<Error> rig_error, compute_error;
    std::uint64_t first_step = 0;  ///< steps that were done when this run began
  };

  Jobs(Site site, Store store, std::unique_ptr<RigRoom> room, Log& log, Publish publish);
  Status recover();
  Status take_in_directories(const std::vector<std::string>& directories);
  Status take_in_job(const std::filesystem::path& record);
  Entry& add(Job job);
  [[nodiscard]] Entry* entry(std::string_view id) const;
  [[nodiscard]] Result<Entry*> known(std::string_view id) const;
  [[nodiscard]] Job new_job(JobKind kind, std::string scan, Args args);
  [[nodiscard]] Status can_submit() const;
  [[nodiscard]] Status devices_open() const;

  void dispatch();
  void dispatch_rig();
  void dispatch_compute();
  Status start_scan(Entry& entry);
  void start_rig(Entry& entry, std::function<Ended()> work);
  void start_compute(Entry& entry, std::function<Ended()> work);
  void fail(Entry& entry, Error error);
  /// Keeps why the rig failed, and holds the queue where the job asks for that.
  void take_rig_error(Entry& entry, Error error);
  [[nodiscard]] Result<ReconstructionChoices> choices_of(const Job& job) const;
  [[nodiscard]] std::filesystem::path output_of(const Job& job) const;
  [[nodiscard]] Result<Submitted> submit(JobKind kind, std::string scan, Args args);

  void change(Entry& entry, JobState to);
  void save(Entry& entry);
  void write_record(const Entry& entry);
  void publish_state(const Entry& entry);
  void publish_progress(Entry& entry);
  void end_work(Entry& entry);
  void finish_if_over(Entry& entry);
  void look_at_devices();

  void on(Entry& entry, const Told& told);
  void on(Entry& entry, const Noted& noted);
  void on(Entry& entry, const Warned& warned);
  void on(Entry& entry, const Retaken& retaken);
  void on(Entry& entry, const Held& held);
  void on(Entry& entry, const ScanOpened& opened);
  void on(Entry& entry, const Ended& ended);
  void on_lane(const Ended& ended);
  void on_devices(const DevicesChanged& changed);

  const Site site_;
  Store store_;
  Log& log_;
  Publish publish_;
  std::deque<std::unique_ptr<Entry>> entries_;  // in order of creation
  std::map<std::string, Entry*, std::less<>> by_id_;
  std::vector<ScanEntry> scans_;
  std::uint64_t next_job_ = 1, next_scan_ = 1;
  std::int64_t first_place_ = 0, last_place_ = 0;
  std::string queue_held_;
  std::string held_by_;  ///< the job that stopped the queue
  Revisions revisions_;
  DeviceSet* devices_ = nullptr;
  std::vector<DeviceState> device_states_;
  std::optional<Error> fault_;
  bool rig_busy_ = false, compute_busy_ = false;
  bool closing_ = false, closed_ = false, opened_ = false, devices_closing_ = false;
  std::chrono::steady_clock::time_point progress_due_, readings_due_;
  EventQueue events_;
  std::unique_ptr<RigRoom> room_;
  // Last: their threads use all of the above.
  Lane rig_lane_{"rig"};
  Lane compute_lane_{"compute"};
};

}  // namespace alhazen
