#include "daemon/jobs/jobs.h"

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>
#include <utility>

#include "alhazen/caught.h"
#include "daemon/jobs/requests.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
namespace fs = std::filesystem;

/// How often clients hear of progress, at most.
constexpr milliseconds kProgressEvery{100};
/// How often idle devices are asked for their readings.
constexpr milliseconds kReadingsEvery{5000};
/// Longest silence of work in progress before the watchdog is no longer fed. Rig: the longest
/// exposure of the protocol (60 s) and a reopen after it. Compute: one refinement on a slow
/// machine.
constexpr milliseconds kRigSilence{180'000}, kComputeSilence{600'000};
/// Largest job.json or manifest.json that is read.
constexpr std::uint64_t kMaxRecordBytes = std::uint64_t{64} << 20U;

/// The number in "j17" or "0017-bunny"; 0 where there is none.
std::uint64_t number_in(std::string_view id) {
  const std::size_t first = id.find_first_of("0123456789");
  std::uint64_t number = 0;
  if (first != std::string_view::npos)
    std::from_chars(id.data() + first, id.data() + id.size(), number);
  return number;
}

/// "0017-bunny-2" of 17 and "Bunny 2": what a Manifest takes as an id.
std::string scan_id(std::uint64_t number, std::string_view object) {
  std::string id = std::to_string(number);
  if (id.size() < 4) id.insert(0, 4 - id.size(), '0');
  id += '-';
  for (const char c : object) {
    const char lower = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    id += (lower >= 'a' && lower <= 'z') || (lower >= '0' && lower <= '9') ? lower : '-';
  }
  return id.substr(0, 64);
}

ScanEntry entry_of(const Manifest& plan, std::string job) {
  return {plan.scan_id,
          plan.object_id,
          plan.note,
          plan.operator_name,
          plan.created_at,
          std::move(job),
          plan.stops.size() * plan.displays.size() * plan.cameras.size(),
          plan.level,
          plan.volume.edge_mm};
}

Error job_unknown(std::string_view id) {
  return {Code::invalid, "args.job is \"" + std::string(id) + "\"; nobody knows this job"};
}

Error wrong_state(const Job& job, std::string_view wanted) {
  return {Code::conflict, "job " + job.id + " is " + std::string(name_of(job.state)) +
                              "; it must be " + std::string(wanted)};
}

/// job.json.
std::string record_of(const Job& job) {
  return to_json(job).dump(1, ' ', false, json::error_handler_t::replace) + "\n";
}

std::string on_error_of(const Job& job) { return job.request->value("on_error", "stop"); }

}  // namespace

Jobs::Jobs(Site site, Store store, std::unique_ptr<RigRoom> room, Log& log, Publish publish)
    : site_(std::move(site)),
      store_(std::move(store)),
      log_(log),
      publish_(std::move(publish)),
      room_(std::move(room)) {}

Jobs::~Jobs() { ALHAZEN_CHECK(closed_ || !opened_); }

Result<std::unique_ptr<Jobs>> Jobs::open(Site site, std::unique_ptr<RigRoom> room, Log& log,
                                         Publish publish) {
  std::error_code error;
  fs::create_directories(site.scans(), error);
  if (error)
    return Error{Code::unavailable,
                 "cannot make '" + site.scans().string() + "': " + error.message()};
  Store store = ALHAZEN_TRY(Store::open(site.data_directory / "index.sqlite"));
  if (store.was_damaged())
    log.write(Severity::warning,
              "the index was damaged; it is put aside and made again from the scan directories");
  std::unique_ptr<Jobs> jobs(
      new Jobs(std::move(site), std::move(store), std::move(room), log, std::move(publish)));
  ALHAZEN_TRY(jobs->recover());
  return jobs;
}

// Finding what was there -------------------------------------------------------------------------

Status Jobs::recover() {
  std::vector<std::string> directories;
  std::error_code error;
  for (fs::directory_iterator i(site_.scans(), error), end; !error && i != end; i.increment(error))
    if (i->is_directory(error)) directories.push_back(i->path().filename().string());
  if (error)
    return Error{Code::unavailable,
                 "cannot list '" + site_.scans().string() + "': " + error.message()};
  std::sort(directories.begin(), directories.end());
  const std::set<std::string, std::less<>> there(directories.begin(), directories.end());

  ALHAZEN_TRY(store_.begin());
  for (const ScanEntry& scan : ALHAZEN_TRY(store_.scans())) {
    if (there.contains(scan.id))
      scans_.push_back(scan);
    else
      ALHAZEN_TRY(store_.drop_scan(scan.id));
  }
  std::uint64_t damaged = 0;
  for (Store::StoredJob& stored : ALHAZEN_TRY(store_.jobs(damaged))) {
    // A scan directory that somebody removed takes its jobs with it.
    if (!stored.job.scan.empty() && stored.plan.empty() && !stored.job.started_at.empty() &&
        !there.contains(stored.job.scan)) {
      ALHAZEN_TRY(store_.drop_job(stored.job.id));
      continue;
    }
    Entry& entry = add(std::move(stored.job));
    entry.place = stored.order;
    entry.plan = std::move(stored.plan);
  }
  if (damaged > 0)
    log_.write(Severity::warning, std::to_string(damaged) + " jobs of the index cannot be read");
  ALHAZEN_TRY(take_in_directories(directories));

  std::sort(entries_.begin(), entries_.end(), [](const auto& a, const auto& b) {
    return number_in(a->job.id) < number_in(b->job.id);
  });
  bool queued = false;
  const Entry* first = nullptr;
  for (const auto& entry : entries_) {
    next_job_ = std::max(next_job_, number_in(entry->job.id) + 1);
    first_place_ = std::min(first_place_, entry->place);
    last_place_ = std::max(last_place_, entry->place);
    Job& job = entry->job;
    if (job.state == JobState::running || job.state == JobState::paused) {
      job.state = JobState::interrupted;
      job.pausing = false, job.pause_reason.clear();
      job.ended_at = utc_now();
      job.error = Error{Code::cancelled, "the daemon ended while the job ran"};
      save(*entry);
      log_.write(Severity::warning, "job " + job.id + " was interrupted; job.resume goes on");
    }
    queued = queued || job.state == JobState::queued;
    if (!is_final(job.state) && (first == nullptr || entry->place < first->place))
      first = entry.get();
  }
  for (const std::string& directory : directories)
    next_scan_ = std::max(next_scan_, number_in(directory) + 1);
  // Hardware does not start moving by itself before a person looked at what was interrupted.
  if (queued && first->job.state == JobState::interrupted) {
    held_by_ = first->job.id;
    queue_held_ = "job " + held_by_ + " is interrupted";
  }
  return store_.commit();
}

Status Jobs::take_in_directories(const std::vector<std::string>& directories) {
  std::set<std::string, std::less<>> known;
  for (const ScanEntry& scan : scans_) known.insert(scan.id);
  for (const std::string& name : directories) {
    if (known.contains(name)) continue;
    const fs::path directory = site_.scans() / name;
    const auto text = read_file(directory / "manifest.json", kMaxRecordBytes);
    if (!text) continue;  // something else, or a directory that was never finished
    const auto plan = Manifest::parse(*text);
    if (!plan || plan->scan_id != name) {
      log_.write(Severity::warning,
                 "'" + directory.string() + "' is left out: " +
                     (plan ? "its manifest is of scan " + plan->scan_id : plan.error().text()));
      continue;
    }
    ALHAZEN_TRY(take_in_job(directory / "job.json"));
    std::string taken_by;
    for (const auto& entry : entries_)
      if (entry->job.kind == JobKind::scan && entry->job.scan == name) taken_by = entry->job.id;
    scans_.push_back(entry_of(*plan, std::move(taken_by)));
    ALHAZEN_TRY(store_.put(scans_.back()));
    std::error_code error;
    for (fs::directory_iterator i(directory / "reconstructions", error), end; !error && i != end;
         i.increment(error))
      ALHAZEN_TRY(take_in_job(i->path() / "job.json"));
  }
  std::sort(scans_.begin(), scans_.end(),
            [](const ScanEntry& a, const ScanEntry& b) { return a.id < b.id; });
  return {};
}

Status Jobs::take_in_job(const fs::path& record) {
  const auto text = read_file(record, kMaxRecordBytes);
  if (!text) return {};
  Result<Job> job = parse_job(*text);
  if (!job) {
    log_.write(Severity::warning, "'" + record.string() + "' is left out: " + job.error().text());
    return {};
  }
  if (by_id_.contains(job->id)) return {};
  Entry& entry = add(*std::move(job));
  entry.place = ++last_place_;
  return store_.put(entry.job, entry.place, entry.plan);
}

Jobs::Entry& Jobs::add(Job job) {
  entries_.push_back(std::make_unique<Entry>());
  Entry& entry = *entries_.back();
  entry.job = std::move(job);
  by_id_[entry.job.id] = &entry;
  return entry;
}

// Asking -----------------------------------------------------------------------------------------

Jobs::Entry* Jobs::entry(std::string_view id) const {
  const auto found = by_id_.find(id);
  return found == by_id_.end() ? nullptr : found->second;
}

const Job* Jobs::find(std::string_view id) const {
  const Entry* found = entry(id);
  return found == nullptr ? nullptr : &found->job;
}

Result<Jobs::Entry*> Jobs::known(std::string_view id) const {
  Entry* found = entry(id);
  if (found == nullptr) return job_unknown(id);
  return found;
}

std::vector<const Job*> Jobs::list() const {
  std::vector<const Job*> all;
  all.reserve(entries_.size());
  for (const auto& entry : entries_) all.push_back(&entry->job);
  return all;
}

const ScanEntry* Jobs::find_scan(std::string_view id) const {
  const auto found = std::find_if(scans_.begin(), scans_.end(),
                                  [&](const ScanEntry& scan) { return scan.id == id; });
  return found == scans_.end() ? nullptr : &*found;
}

// Submitting -------------------------------------------------------------------------------------

Status Jobs::can_submit() const {
  if (closing_) return Error{Code::conflict, "the daemon is stopping"};
  return {};
}

Status Jobs::devices_open() const {
  if (devices_ == nullptr) return Error{Code::conflict, "the devices are not open yet"};
  return {};
}

Job Jobs::new_job(JobKind kind, std::string scan, Args args) {
  Job job;
  job.id = "j" + std::to_string(next_job_++);
  job.kind = kind;
  job.scan = std::move(scan);
  job.created_at = utc_now();
  job.request = std::move(args);
  return job;
}

Result<std::vector<Submitted>> Jobs::submit_scans(const std::vector<Args>& scans) {
  ALHAZEN_TRY(can_submit());
  ALHAZEN_TRY(devices_open());
  const DeviceFacts facts = facts_of(*devices_);
  std::vector<Manifest> plans;
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const std::string where = scans.size() == 1 ? "args" : "args.batch[" + std::to_string(i) + "]";
    const ScanRequest request = ALHAZEN_TRY(scan_request(*scans[i]).in(where));
    const ReconstructionChoices choices = ALHAZEN_TRY(reconstruction_choices(*scans[i]).in(where));
    static_cast<void>(choices);  // judged now, made again when the scan starts
    const PlanStamp stamp{scan_id(next_scan_ + i, request.object_id), utc_now(),
                          site_.software_version};
    plans.push_back(
        ALHAZEN_TRY(make_plan(request, site_.presets, site_.rig, facts, stamp).in(where)));
    bytes += estimate(plans.back(), facts).bytes_disk;
  }
  std::error_code error;
  if (const fs::space_info space = fs::space(site_.data_directory, error);
      !error && bytes > space.available)
    return Error{Code::exhausted, "it takes " + std::to_string(bytes / 1'000'000) +
                                      " MB, free are " +
                                      std::to_string(space.available / 1'000'000) + " MB in " +
                                      site_.data_directory.string()};

  // All or none: nothing is queued before the index holds everything.
  const std::uint64_t first_number = next_job_;
  std::vector<Job> jobs;
  const auto store_all = [&]() -> Status {
    ALHAZEN_TRY(store_.begin());
    for (std::size_t i = 0; i < scans.size(); ++i) {
      jobs.push_back(new_job(JobKind::scan, plans[i].scan_id, scans[i]));
      ALHAZEN_TRY(store_.put(jobs.back(), last_place_ + 1 + static_cast<std::int64_t>(i),
                             plans[i].to_json()));
    }
    return store_.commit();
  };
  if (const Status stored = store_all(); !stored) {
    store_.rollback();
    next_job_ = first_number;
    return stored.error();
  }
  next_scan_ += scans.size();
  std::vector<Submitted> submitted;
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    submitted.push_back({jobs[i].id, jobs[i].scan});
    Entry& made = add(std::move(jobs[i]));
    made.place = ++last_place_;
    made.plan = plans[i].to_json();
    ++revisions_.jobs;
    publish_state(made);
  }
  dispatch();
  return submitted;
}

Result<Estimate> Jobs::estimate_scan(const json& args) const {
  ALHAZEN_TRY(devices_open());
  const ScanRequest request = ALHAZEN_TRY(scan_request(args).in("args"));
  const DeviceFacts facts = facts_of(*devices_);
  const PlanStamp stamp{"estimate", utc_now(), site_.software_version};
  const Manifest plan =
      ALHAZEN_TRY(make_plan(request, site_.presets, site_.rig, facts, stamp).in("args"));
  return estimate(plan, facts);
}

Result<Submitted> Jobs::submit(JobKind kind, std::string scan, Args args) {
  ALHAZEN_TRY(can_submit());
  Job job = new_job(kind, std::move(scan), std::move(args));
  ALHAZEN_TRY(store_.put(job, last_place_ + 1, ""));
  Entry& made = add(std::move(job));
  made.place = ++last_place_;
  ++revisions_.jobs;
  publish_state(made);
  const Submitted answer{made.job.id, made.job.scan};
  dispatch();
  return answer;
}

Result<Submitted> Jobs::submit_reconstruction(std::string_view scan, Args args) {
  const ScanEntry* known_scan = find_scan(scan);
  if (known_scan == nullptr)
    return Error{Code::invalid,
                 "args.scan is \"" + std::string(scan) + "\"; nobody knows this scan"};
  if (const Job* job = find(known_scan->job); job != nullptr && !is_at_rest(job->state))
    return wrong_state(*job, "at its end before its scan is reconstructed again");
  const ReconstructionChoices choices = ALHAZEN_TRY(reconstruction_choices(*args).in("args"));
  static_cast<void>(choices);  // judged now, made again when it starts
  return submit(JobKind::reconstruct, known_scan->id, std::move(args));
}

Result<Submitted> Jobs::submit_check(Args args) {
  return submit(JobKind::check, {}, std::move(args));
}

Result<Submitted> Jobs::submit_preview(Args args) {
  ALHAZEN_TRY(devices_open());
  for (const auto& entry : entries_)
    if (entry->job.kind == JobKind::scan &&
        (entry->on_rig || (entry->job.state == JobState::queued && queue_held_.empty())))
      return Error{Code::conflict, "scan " + entry->job.scan + " is " +
                                       std::string(name_of(entry->job.state)) +
                                       "; previews are taken only while no scan runs"};
  const PreviewRequest request = ALHAZEN_TRY(preview_request(*args).in("args"));
  for (const std::string& camera : request.cameras)
    if (devices_->camera(camera) == nullptr)
      return Error{Code::invalid,
                   "args.cameras names \"" + camera + "\"; nobody knows this camera"};
  if (request.display && devices_->display(*request.display) == nullptr)
    return Error{Code::invalid,
                 "args.display is \"" + *request.display + "\"; nobody knows this display"};
  return submit(JobKind::preview, {}, std::move(args));
}

// Steering ---------------------------------------------------------------------------------------

Status Jobs::pause(std::string_view id, HoldAt at) {
  Entry& found = *ALHAZEN_TRY(known(id));
  if (found.job.kind != JobKind::scan)
    return Error{Code::unsupported, "job " + found.job.id + " is a " +
                                        std::string(name_of(found.job.kind)) +
                                        "; only scans can pause"};
  if (found.job.state != JobState::running) return wrong_state(found.job, "running");
  if (!found.on_rig)
    return Error{Code::conflict, "job " + found.job.id + " has taken its last frame"};
  found.work->hold.hold(at, "operator");
  found.job.pausing = true;
  found.job.pause_reason = "operator";
  save(found);
  publish_state(found);
  return {};
}

Status Jobs::resume(std::string_view id) {
  Entry& found = *ALHAZEN_TRY(known(id));
  ALHAZEN_TRY(can_submit());
  if (found.job.state == JobState::paused || found.job.pausing) {
    found.work->hold.release();
    if (found.job.pausing) {
      found.job.pausing = false;
      found.job.pause_reason.clear();
      save(found);
      publish_state(found);
    }
    return {};
  }
  if (found.job.state != JobState::interrupted)
    return wrong_state(found.job, "paused or interrupted");
  found.place = --first_place_;
  found.job.error.reset();
  found.job.ended_at.clear();
  change(found, JobState::queued);
  start_queue();
  dispatch();
  return {};
}

Status Jobs::stop(std::string_view id) {
  Entry& found = *ALHAZEN_TRY(known(id));
  if (is_at_rest(found.job.state)) return wrong_state(found.job, "queued, running or paused");
  if (found.job.state == JobState::queued) {
    change(found, JobState::interrupted);
    return {};
  }
  if (found.ending == Ending::none) found.ending = Ending::stop;
  end_work(found);
  return {};
}

Status Jobs::abort(std::string_view id) {
  Entry& found = *ALHAZEN_TRY(known(id));
  if (is_final(found.job.state))
    return wrong_state(found.job, "queued, running, paused or interrupted");
  if (found.job.state == JobState::queued || found.job.state == JobState::interrupted) {
    change(found, JobState::cancelled);
    if (held_by_ == found.job.id) start_queue();
    return {};
  }
  found.ending = Ending::abort;
  // Not in a while, when the lane has unwound: now.
  if (found.on_rig && devices_ != nullptr) devices_->halt_all();
  end_work(found);
  return {};
}

void Jobs::end_work(Entry& entry) {
  entry.stop.request_stop();
  if (!entry.wants_compute) return;
  // No lane works on it yet that could tell its end.
  entry.wants_compute = false;
  entry.compute_error = Error{Code::cancelled, "stopped before it was reconstructed"};
  finish_if_over(entry);
}

bool Jobs::start_queue() {
  const bool was_held = !queue_held_.empty();
  queue_held_.clear();
  held_by_.clear();
  dispatch();
  return was_held;
}

// Handing out work -------------------------------------------------------------------------------

fs::path Jobs::output_of(const Job& job) const {
  const fs::path scan = site_.scans() / job.scan;
  return job.kind == JobKind::scan ? scan : scan / "reconstructions" / job.id;
}

Result<ReconstructionChoices> Jobs::choices_of(const Job& job) const {
  ReconstructionChoices choices = ALHAZEN_TRY(reconstruction_choices(*job.request));
  choices.output = output_of(job);
  choices.threads = site_.arena_threads;
  return choices;
}

void Jobs::dispatch() {
  if (closing_) return;
  dispatch_rig();
  dispatch_compute();
}

void Jobs::dispatch_rig() {
  if (rig_busy_ || devices_ == nullptr) return;
  Entry* next = nullptr;
  for (const auto& entry : entries_) {
    const Job& job = entry->job;
    if (job.state != JobState::queued || job.kind == JobKind::reconstruct) continue;
    if (job.kind == JobKind::scan && !queue_held_.empty()) continue;
    if (next == nullptr || entry->place < next->place) next = entry.get();
  }
  if (next == nullptr) return;
  next->stop = std::stop_source();
  next->ending = Ending::none;
  next->rig_error.reset(), next->compute_error.reset();
  next->gaps = false;
  RigRoom& room = *room_;
  switch (next->job.kind) {
    case JobKind::scan:
      if (const Status started = start_scan(*next); !started) fail(*next, started.error());
      return;
    case JobKind::check:
      start_rig(*next, [this, &room, stop = next->stop.get_token()]() -> Ended {
        auto made = check_rig(room, site_.rig, site_.rig_file, site_.data_directory, stop);
        if (!made) return {LaneName::rig, std::move(made.error()), nullptr, false};
        return {LaneName::rig, {}, *std::move(made), false};
      });
      return;
    case JobKind::preview: {
      Result<PreviewRequest> request = preview_request(*next->job.request);
      if (!request) return fail(*next, std::move(request.error()));
      const auto say = [this, id = next->job.id](Noted noted) {
        events_.push({id, std::move(noted)});
      };
      start_rig(*next,
                [this, &room, say, wanted = *std::move(request),
                 stop = next->stop.get_token()]() -> Ended {
                  auto made = take_pictures(room, wanted, site_.preview_directory, say, stop);
                  if (!made) return {LaneName::rig, std::move(made.error()), nullptr, false};
                  return {LaneName::rig, {}, *std::move(made), false};
                });
      return;
    }
    case JobKind::reconstruct:
      return;  // never chosen above
  }
}

void Jobs::dispatch_compute() {
  if (compute_busy_) return;
  Entry* next = nullptr;
  // Light maps that wait come before scans that lie on disk.
  for (const auto& entry : entries_)
    if (entry->wants_compute && (next == nullptr || entry->place < next->place)) next = entry.get();
  if (next != nullptr) {
    next->wants_compute = false;
    start_compute(*next, [this, work = next->work] {
      return run_scan_reconstruction(*work, events_, compute_lane_);
    });
    return;
  }
  for (const auto& entry : entries_)
    if (entry->job.state == JobState::queued && entry->job.kind == JobKind::reconstruct &&
        (next == nullptr || entry->place < next->place))
      next = entry.get();
  if (next == nullptr) return;
  Result<ReconstructionChoices> choices = choices_of(next->job);
  if (!choices) return fail(*next, std::move(choices.error()));
  next->stop = std::stop_source();
  next->ending = Ending::none;
  next->compute_error.reset();
  start_compute(*next, [this, id = next->job.id, scan = site_.scans() / next->job.scan,
                        wanted = *std::move(choices), record = record_of(next->job),
                        stop = next->stop.get_token()] {
    return run_reconstruction(id, scan, wanted, record, events_, compute_lane_, stop);
  });
}

Status Jobs::start_scan(Entry& entry) {
  const fs::path directory = site_.scans() / entry.job.scan;
  std::size_t stacks = 0;
  std::optional<Manifest> plan;
  if (!entry.plan.empty()) {
    plan = ALHAZEN_TRY(Manifest::parse(entry.plan));
    stacks = plan->stops.size() * plan->displays.size() * plan->cameras.size();
  } else if (const ScanEntry* known_scan = find_scan(entry.job.scan)) {
    stacks = known_scan->stacks;
  } else {
    return Error{Code::corrupt, "'" + directory.string() + "' holds no scan"};
  }
  auto work = std::make_shared<ScanWork>(entry.job.id, directory, entry.stop, stacks);
  work->plan = std::move(plan);
  work->rig = site_.rig;
  const ScanRequest request = ALHAZEN_TRY(scan_request(*entry.job.request));
  work->capture.on_gap = request.on_gap;
  work->reconstruction = ALHAZEN_TRY(choices_of(entry.job));
  entry.work = work;
  entry.first_step = 0;
  // In the order in which they begin; a reconstruction tells of more.
  entry.job.stages.clear();
  for (const char* stage : {"steps", "decode", "vote", "surface"}) entry.job.stage(stage);
  entry.job.retakes = 0;
  entry.job.elapsed_s = entry.job.remaining_s = 0;
  Job running = entry.job;
  running.state = JobState::running;
  if (running.started_at.empty()) running.started_at = utc_now();
  work->job_record = record_of(running);
  start_rig(entry, [this, work] { return run_capture(*work, *room_, events_, rig_lane_); });
  return {};
}

void Jobs::start_rig(Entry& entry, std::function<Ended()> work) {
  rig_busy_ = true;
  entry.on_rig = true;
  change(entry, JobState::running);
  rig_lane_.start([this, id = entry.job.id, task = std::move(work)] {
    events_.push({id, task()});
  });
}

void Jobs::start_compute(Entry& entry, std::function<Ended()> work) {
  compute_busy_ = true;
  entry.on_compute = true;
  if (entry.job.state == JobState::queued) change(entry, JobState::running);
  compute_lane_.start([this, id = entry.job.id, task = std::move(work)] {
    events_.push({id, task()});
  });
}

void Jobs::fail(Entry& entry, Error error) {
  change(entry, JobState::running);
  take_rig_error(entry, std::move(error));
  finish_if_over(entry);
}

void Jobs::take_rig_error(Entry& entry, Error error) {
  // A rig that failed would fail the next scan, too; a mesh that could not be made says nothing of
  // the rig. Held now, not when the job is over: the rig is free while the votes are still counted.
  if (entry.job.kind == JobKind::scan && entry.ending == Ending::none &&
      on_error_of(entry.job) == "stop") {
    held_by_ = entry.job.id;
    queue_held_ = "job " + held_by_ + " is " + std::string(name_of(end_state(error)));
  }
  entry.rig_error = std::move(error);
}

// Changing ---------------------------------------------------------------------------------------

void Jobs::change(Entry& entry, JobState to) {
  ALHAZEN_CHECK(may_become(entry.job.state, to));
  if (entry.untold) publish_progress(entry);
  entry.job.state = to;
  if (to == JobState::running && entry.job.started_at.empty()) entry.job.started_at = utc_now();
  if (is_at_rest(to)) entry.job.ended_at = utc_now();
  if (to != JobState::paused) entry.job.pause_reason.clear();
  entry.job.pausing = false;
  save(entry);
  publish_state(entry);
  // What an operator reads in the morning; an error has had its own line, with more in it.
  if (entry.job.error) return;
  std::string line = "job " + entry.job.id + " (" + std::string(name_of(entry.job.kind));
  if (!entry.job.scan.empty()) line += " " + entry.job.scan;
  line += ") is " + std::string(name_of(to));
  if (!entry.job.pause_reason.empty()) line += ": " + entry.job.pause_reason;
  log_.write(Severity::info, line);
}

void Jobs::save(Entry& entry) {
  ++revisions_.jobs;
  // The index is only an index: where it fails the job goes on, and the scan directory tells.
  if (const Status stored = store_.put(entry.job, entry.place, entry.plan); !stored)
    log_.write(Severity::error, "job " + entry.job.id + ": " + stored.error().text());
  const bool has_directory = (entry.job.kind == JobKind::scan && entry.plan.empty()) ||
                             entry.job.kind == JobKind::reconstruct;
  if (!is_at_rest(entry.job.state) || !has_directory || entry.job.started_at.empty()) return;
  const fs::path file = output_of(entry.job) / "job.json";
  if (const Status written = write_file_safely(file, record_of(entry.job)); !written)
    log_.write(Severity::error, file.string() + ": " + written.error().text());
}

void Jobs::publish_state(const Entry& entry) {
  json body = to_json(entry.job);
  body.erase("request");
  publish_("job.state", body);
}

void Jobs::publish_progress(Entry& entry) {
  entry.untold = false;
  json body = to_json(entry.job);
  publish_("scan.progress", {{"job", body["id"]},
                             {"kind", body["kind"]},
                             {"scan", body["scan"]},
                             {"stages", std::move(body["stages"])},
                             {"elapsed_s", body["elapsed_s"]},
                             {"remaining_s", body["remaining_s"]},
                             {"retakes", body["retakes"]}});
}

void Jobs::finish_if_over(Entry& entry) {
  if (entry.on_rig || entry.on_compute || entry.wants_compute) return;
  // The capture's error is the cause where both failed: the compute lane only saw its feed end.
  std::optional<Error> error = entry.rig_error ? entry.rig_error : entry.compute_error;
  entry.work.reset();
  JobState to = entry.gaps ? JobState::done_with_gaps : JobState::done;
  if (error) {
    switch (entry.ending) {
      case Ending::abort:
        to = JobState::cancelled;
        break;
      case Ending::stop:
      case Ending::shutdown:
        to = JobState::interrupted;
        break;
      case Ending::none:
        to = end_state(*error);
        break;
    }
    if (entry.ending == Ending::none || error->code != Code::cancelled) entry.job.error = error;
  }
  const bool troubled = error && entry.ending == Ending::none;
  if (troubled)
    log_.write(Severity::error,
               "job " + entry.job.id + " is " + std::string(name_of(to)) + ": " + error->text());
  change(entry, to);
  if (to == JobState::cancelled && held_by_ == entry.job.id) start_queue();
}

// Hearing ----------------------------------------------------------------------------------------

void Jobs::take_events() {
  for (LaneEvent& event : events_.take()) {
    if (event.job.empty()) {
      if (const auto* changed = std::get_if<DevicesChanged>(&event.what)) on_devices(*changed);
      if (const auto* ended = std::get_if<Ended>(&event.what)) on_lane(*ended);
      continue;
    }
    Entry* found = entry(event.job);
    ALHAZEN_CHECK(found != nullptr);
    std::visit(
        [&](const auto& what) {
          if constexpr (!std::is_same_v<std::decay_t<decltype(what)>, DevicesChanged>)
            on(*found, what);
        },
        event.what);
  }
  dispatch();
}

void Jobs::on(Entry& entry, const Told& told) {
  StageProgress& stage = entry.job.stage(told.progress.stage);
  stage = told.progress;
  if (told.elapsed_s > 0) {
    if (entry.first_step == 0) entry.first_step = stage.done;
    entry.job.elapsed_s = told.elapsed_s;
    // Every stop takes the same steps and one move, so time goes as steps do.
    const auto taken = static_cast<double>(stage.done - entry.first_step + 1);
    entry.job.remaining_s = told.elapsed_s / taken * static_cast<double>(stage.total - stage.done);
  }
  if (!entry.untold) {
    entry.untold = true;
    ++revisions_.jobs;
  }
}

void Jobs::on(Entry& entry, const Noted& noted) {
  if (entry.untold) publish_progress(entry);
  publish_(noted.topic, *noted.body);
}

void Jobs::on(Entry& entry, const Warned& warned) {
  ++revisions_.jobs;
  entry.job.warn(warned.line);
  log_.write(Severity::warning, "job " + entry.job.id + ": " + warned.line);
  publish_("scan.warning",
           {{"job", entry.job.id}, {"scan", entry.job.scan}, {"warning", warned.line}});
}

void Jobs::on(Entry& entry, const Retaken& retaken) {
  ++revisions_.jobs;
  ++entry.job.retakes;
  publish_("scan.retake", *retaken.body);
  look_at_devices();
}

void Jobs::on(Entry& entry, const Held& held) {
  if (!held.reason.empty() && entry.job.state == JobState::running) {
    entry.job.pause_reason = held.reason;
    change(entry, JobState::paused);
  } else if (held.reason.empty() && entry.job.state == JobState::paused) {
    change(entry, JobState::running);
  }
}

void Jobs::on(Entry& entry, const ScanOpened&) {
  entry.wants_compute = true;
  const Manifest& plan = entry.work->scan->manifest();
  entry.plan.clear();  // the scan directory holds it from now on
  if (find_scan(plan.scan_id) == nullptr) {
    scans_.push_back(entry_of(plan, entry.job.id));
    if (const Status stored = store_.put(scans_.back()); !stored)
      log_.write(Severity::error, "scan " + plan.scan_id + ": " + stored.error().text());
  }
  save(entry);
}

void Jobs::on(Entry& entry, const Ended& ended) {
  if (ended.lane == LaneName::rig) {
    rig_busy_ = false;
    entry.on_rig = false;
    if (!ended.status) {
      take_rig_error(entry, ended.status.error());
      // The compute lane need not begin what cannot be finished.
      entry.wants_compute = false;
    }
    look_at_devices();
  } else {
    compute_busy_ = false;
    entry.on_compute = false;
    if (!ended.status) entry.compute_error = ended.status.error();
  }
  entry.gaps = entry.gaps || ended.gaps;
  if (ended.result) {
    json result = entry.job.result ? *entry.job.result : json::object();
    result.update(*ended.result);
    if (const auto warnings = ended.result->find("warnings"); warnings != ended.result->end())
      for (const json& line : *warnings) entry.job.warn(line.get<std::string>());
    entry.job.result = std::make_shared<const json>(std::move(result));
  }
  finish_if_over(entry);
}

void Jobs::on_lane(const Ended&) {
  rig_busy_ = false;
  if (devices_closing_) {
    closed_ = true;
    return;
  }
  look_at_devices();
}

void Jobs::on_devices(const DevicesChanged& changed) {
  rig_busy_ = false;
  ++revisions_.devices;
  if (!changed.opened) {
    fault_ = changed.opened.error();
    return;
  }
  devices_ = &room_->devices();
  readings_due_ = steady_clock::now() + kReadingsEvery;
  look_at_devices();
}

void Jobs::look_at_devices() {
  if (devices_ == nullptr) return;
  const std::vector<DeviceDescription> all = devices_->describe();
  const bool first = device_states_.size() != all.size();
  device_states_.resize(all.size(), DeviceState::absent);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!first && device_states_[i] == all[i].state) continue;
    device_states_[i] = all[i].state;
    ++revisions_.devices;
    publish_("device.state", {{"device", all[i].name},
                              {"kind", std::string(name_of(all[i].kind))},
                              {"state", std::string(name_of(all[i].state))},
                              {"trouble", all[i].trouble}});
  }
}

// Living -----------------------------------------------------------------------------------------

void Jobs::open_devices() {
  ALHAZEN_CHECK(!opened_);
  opened_ = true;
  rig_busy_ = true;
  rig_lane_.start([this] { events_.push({{}, DevicesChanged{room_->open()}}); });
}

milliseconds Jobs::tick() {
  const auto now = steady_clock::now();
  milliseconds sleep{1000};
  const bool due = now >= progress_due_;
  bool untold = false;
  for (const auto& entry : entries_) {
    if (!entry->untold) continue;
    if (due)
      publish_progress(*entry);
    else
      untold = true;
  }
  if (due) progress_due_ = now + kProgressEvery;
  if (untold)
    sleep =
        std::clamp(std::chrono::ceil<milliseconds>(progress_due_ - now), milliseconds(1), sleep);
  if (closing_) {
    close();
  } else if (devices_ != nullptr && !rig_busy_ && now >= readings_due_) {
    readings_due_ = now + kReadingsEvery;
    rig_busy_ = true;
    rig_lane_.start([this] {
      room_->devices().refresh_readings();
      events_.push({{}, Ended{LaneName::rig, {}, nullptr, false}});
    });
  }
  return sleep;
}

std::string Jobs::silent_lane() const {
  const auto paused = [this] {
    return std::any_of(entries_.begin(), entries_.end(),
                       [](const auto& entry) { return entry->job.state == JobState::paused; });
  };
  // A paused scan keeps the rig lane, rightly silent.
  if (rig_lane_.silence() > kRigSilence && !paused()) return "rig lane";
  if (compute_lane_.silence() > kComputeSilence) {
    // While the feed is empty it waits for the rig lane, which is watched itself.
    for (const auto& entry : entries_)
      if (entry->on_compute && (!entry->on_rig || entry->work->feed.size() > 0))
        return "compute lane";
  }
  return {};
}

void Jobs::close() {
  closing_ = true;
  if (!opened_) {
    closed_ = true;
    return;
  }
  bool idle = !rig_busy_ && !compute_busy_;
  for (const auto& entry : entries_) {
    if (is_at_rest(entry->job.state) || entry->job.state == JobState::queued) continue;
    if (entry->ending == Ending::none) entry->ending = Ending::shutdown;
    end_work(*entry);
    idle = idle && is_at_rest(entry->job.state);
  }
  if (!idle || devices_closing_ || closed_) return;
  devices_closing_ = true;
  devices_ = nullptr;
  rig_busy_ = true;
  rig_lane_.start([this] {
    room_->close();
    events_.push({{}, Ended{LaneName::rig, {}, nullptr, false}});
  });
}

std::string Jobs::waiting_for() const {
  if (rig_busy_) {
    if (devices_ != nullptr)
      if (const auto call = devices_->call_in_progress())
        return "rig lane: " + call->device + " " + call->call;
    return "rig lane";
  }
  return compute_busy_ ? "compute lane" : "";
}

}  // namespace alhazen
