#include "daemon/control/commands.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>
#include <variant>

#include "alhazen/caught.h"

namespace alhazen {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

constexpr double kDegPerRad = 57.29577951308232;

json submitted_json(const Submitted& submitted) {
  json made = {{"job", submitted.job}};
  if (!submitted.scan.empty()) made["scan"] = submitted.scan;
  return made;
}

std::int64_t free_bytes(const fs::path& directory) {
  std::error_code error;
  const fs::space_info space = fs::space(directory, error);
  return error ? 0 : static_cast<std::int64_t>(space.available);
}

/// The rows `offset` … of a list that is shown newest first.
template <class T, class Show>
json page(const std::vector<T>& oldest_first, const json& args, Show show) {
  const auto offset = args.at("offset").get<std::size_t>();
  const auto limit = args.at("limit").get<std::size_t>();
  json rows = json::array();
  for (std::size_t i = offset; i < oldest_first.size() && rows.size() < limit; ++i)
    rows.push_back(show(oldest_first[oldest_first.size() - 1 - i]));
  return rows;
}

}  // namespace

json to_json(const DeviceDescription& device) {
  json readings = json::array();
  for (const Reading& reading : device.readings)
    readings.push_back({{"name", reading.name},
                        {"value", reading.value},
                        {"unit", reading.unit},
                        {"warn", reading.warn}});
  json made = {{"name", device.name},
               {"kind", std::string(name_of(device.kind))},
               {"driver", device.driver},
               {"use", device.use},
               {"state", std::string(name_of(device.state))},
               {"trouble", device.trouble},
               {"calls", device.calls},
               {"failures", device.failures},
               {"reopened", device.reopened},
               {"readings", std::move(readings)}};
  if (const auto* camera = std::get_if<CameraInfo>(&device.info)) {
    const CameraSettings& set = device.camera_settings;
    made.update({{"model", camera->model},
                 {"serial", camera->serial},
                 {"width_px", camera->width_px},
                 {"height_px", camera->height_px},
                 {"bits", camera->bits}});
    made["settings"] = {{{"name", "exposure"},
                         {"value", set.exposure.count()},
                         {"min", camera->exposure_min.count()},
                         {"max", camera->exposure_max.count()},
                         {"unit", "us"}},
                        {{"name", "gain"},
                         {"value", set.gain_db},
                         {"min", camera->gain_min_db},
                         {"max", camera->gain_max_db},
                         {"unit", "dB"}}};
    made["region_px"] = {set.region.x, set.region.y, set.region.width, set.region.height};
  } else if (const auto* display = std::get_if<DisplayInfo>(&device.info)) {
    made.update({{"model", display->model},
                 {"serial", display->serial},
                 {"width_px", display->width_px},
                 {"height_px", display->height_px},
                 {"refresh_hz", display->refresh_hz}});
  } else if (const auto* table = std::get_if<TurntableInfo>(&device.info)) {
    made.update({{"model", table->model},
                 {"serial", table->serial},
                 {"endless", table->min_rad == table->max_rad},
                 {"min_deg", table->min_rad * kDegPerRad},
                 {"max_deg", table->max_rad * kDegPerRad},
                 {"repeatability_deg", table->repeatability_rad * kDegPerRad},
                 {"speed_deg_s", table->speed_rad_s * kDegPerRad}});
  }
  return made;
}

Commands::Commands(Jobs& jobs, EventLog& events, Counters& counters, Daemon daemon)
    : jobs_(jobs), events_(events), counters_(counters), daemon_(std::move(daemon)) {
  for (const Verb& verb : verbs()) ALHAZEN_CHECK(handlers().contains(verb.name));
  ALHAZEN_CHECK(handlers().size() == verbs().size());
}

const std::map<std::string_view, Commands::Handler>& Commands::handlers() {
  static const std::map<std::string_view, Handler> kHandlers = {
      {"hello", &Commands::hello},
      {"ping", &Commands::ping},
      {"status", &Commands::status},
      {"rig.describe", &Commands::rig_describe},
      {"rig.check", &Commands::rig_check},
      {"device.list", &Commands::device_list},
      {"device.describe", &Commands::device_describe},
      {"plan.list", &Commands::plan_list},
      {"plan.estimate", &Commands::plan_estimate},
      {"scan.submit", &Commands::scan_submit},
      {"scan.list", &Commands::scan_list},
      {"scan.get", &Commands::scan_get},
      {"reconstruct.submit", &Commands::reconstruct_submit},
      {"job.list", &Commands::job_list},
      {"job.get", &Commands::job_get},
      {"job.pause", &Commands::job_pause},
      {"job.resume", &Commands::job_resume},
      {"job.stop", &Commands::job_stop},
      {"job.abort", &Commands::job_abort},
      {"queue.start", &Commands::queue_start},
      {"preview.take", &Commands::preview_take},
      {"events.replay", &Commands::events_replay},
      {"config.show", &Commands::config_show},
      {"log.level", &Commands::log_level},
      {"service.shutdown", &Commands::service_shutdown},
  };
  return kHandlers;
}

// Answering --------------------------------------------------------------------------------------

std::string Commands::answer(std::string_view message) {
  ++counters_.requests;
  const auto parsed = parse_request(message);
  if (const auto* refusal = std::get_if<Refusal>(&parsed)) {
    ++counters_.refusals;
    return refusal_text(refusal->id, refusal->error, revisions());
  }
  const Request& request = std::get<Request>(parsed);
  const Result<json> done = perform(request);
  if (done) return reply_text(request.id, *done, revisions());
  ++counters_.refusals;
  return refusal_text(request.id, done.error(), revisions());
}

Result<json> Commands::perform(const Request& request) {
  const Verb* verb = find_verb(request.verb);
  if (verb == nullptr)
    return Error{Code::invalid, "unknown verb \"" + request.verb + "\"; hello lists those known"};
  const json args = ALHAZEN_TRY(check_arguments(verb->arguments, *request.args, "args"));
  const Handler handler = handlers().at(verb->name);
  // A read has nothing to repeat: its key is as good as none.
  if (!request.idem || !verb->changes) return (this->*handler)(args);

  const auto now = std::chrono::system_clock::now();
  const std::string asked = verb->name + " " + dump(args);
  const auto before = ALHAZEN_TRY(jobs_.store().answer(*request.idem, now));
  if (before) {
    if (before->request != asked)
      return Error{Code::conflict, "idem \"" + *request.idem +
                                       "\" was given with another request before; take a new key"};
    return caught(Code::corrupt, "stored answer", [&] { return json::parse(before->reply); });
  }
  json done = ALHAZEN_TRY((this->*handler)(args));
  // The thing is done; that its answer cannot be kept must not look like a failure of it.
  static_cast<void>(jobs_.store().put_answer(*request.idem, {asked, dump(done)}, now));
  return done;
}

json Commands::revisions() const {
  const Revisions& revisions = jobs_.revisions();
  return {{"jobs", revisions.jobs},
          {"devices", revisions.devices},
          {"config", revisions.config},
          {"lock", revisions.lock}};
}

json Commands::reply_of(const Job& job) const {
  json made = to_json(job);
  if (job.error) made["error"] = to_json(*job.error);
  if (!job.scan.empty()) made["directory"] = (jobs_.site().scans() / job.scan).string();
  if (job.state == JobState::queued && job.kind == JobKind::scan && !jobs_.queue_held().empty())
    made["waiting_for"] = "the queue is stopped: " + jobs_.queue_held() +
                          "; resume or abort that one, or queue.start";
  return made;
}

json Commands::reply_of(const ScanEntry& scan) const {
  json made = {{"id", scan.id},
               {"object", scan.object_id},
               {"note", scan.note},
               {"operator", scan.operator_name},
               {"created_at", scan.created_at},
               {"job", scan.job},
               {"stacks", scan.stacks},
               {"level", scan.level},
               {"edge_mm", scan.edge_mm},
               {"directory", (jobs_.site().scans() / scan.id).string()}};
  if (const Job* job = jobs_.find(scan.job)) {
    made["state"] = std::string(name_of(job->state));
    if (job->result) made["result"] = *job->result;
  }
  return made;
}

std::string Commands::state() const {
  if (jobs_.closing()) return "stopping";
  if (jobs_.fault()) return "fault";
  if (jobs_.devices() == nullptr) return "starting";
  std::string state = "idle";
  for (const Job* job : jobs_.list()) {
    if (job->state == JobState::paused) return "paused";
    if (job->state == JobState::running) state = job->pausing ? "pausing" : "running";
  }
  return state;
}

std::vector<std::string> Commands::obstacles() const {
  std::vector<std::string> reasons;
  if (jobs_.closing()) reasons.emplace_back("the daemon is stopping");
  if (jobs_.fault()) reasons.push_back(jobs_.fault()->text());
  if (jobs_.devices() == nullptr) {
    reasons.emplace_back("the devices are not open yet");
  } else {
    for (const DeviceDescription& device : jobs_.devices()->describe())
      if (device.state != DeviceState::ready)
        reasons.push_back(std::string(name_of(device.kind)) + " " + device.name + " is " +
                          std::string(name_of(device.state)) + ": " + device.trouble);
  }
  if (!jobs_.queue_held().empty())
    reasons.push_back("the queue is stopped: " + jobs_.queue_held() +
                      "; resume or abort it, or queue.start");
  // Less than a hundred megabytes hold no scan.
  if (free_bytes(jobs_.site().data_directory) < 100'000'000)
    reasons.push_back("the disk of " + jobs_.site().data_directory.string() + " is full");
  return reasons;
}

// The verbs --------------------------------------------------------------------------------------

Result<json> Commands::hello(const json&) {
  return json{{"protocol", kProtocol},
              {"software", daemon_.software_version},
              {"epoch", events_.epoch()},
              {"event_endpoint", daemon_.event_endpoint},
              // Who may open the socket may do everything; roles come with keys on TCP.
              {"role", std::string(name_of(Role::admin))},
              {"limits", {{"message_bytes", kLargestMessage}, {"nesting", kDeepestMessage}}},
              {"verbs", verbs_json()}};
}

Result<json> Commands::ping(const json&) { return json{{"at", utc_now()}}; }

Result<json> Commands::status(const json&) {
  json running = json::array();
  std::size_t queued = 0;
  for (const Job* job : jobs_.list()) {
    if (job->state == JobState::queued) ++queued;
    if (job->state != JobState::running && job->state != JobState::paused) continue;
    json row = to_json(*job);
    row.erase("request");
    running.push_back(std::move(row));
  }
  json devices = json::object();
  bool ready = jobs_.devices() != nullptr;
  if (ready)
    for (const DeviceDescription& device : jobs_.devices()->describe()) {
      devices[device.name] = std::string(name_of(device.state));
      ready = ready && device.state == DeviceState::ready;
    }
  const std::vector<std::string> reasons = obstacles();
  const auto up = std::chrono::steady_clock::now() - begin_;
  return json{{"state", state()},
              {"live", true},
              {"ready", ready},
              {"can_scan", reasons.empty()},
              {"reasons", reasons},
              {"uptime_s", std::chrono::duration<double>(up).count()},
              {"jobs", std::move(running)},
              {"queue", {{"waiting", queued}, {"held", jobs_.queue_held()}}},
              {"devices", std::move(devices)},
              {"disk",
               {{"directory", jobs_.site().data_directory.string()},
                {"free_bytes", free_bytes(jobs_.site().data_directory)}}},
              {"counters",
               {{"requests", counters_.requests},
                {"refusals", counters_.refusals},
                {"dropped", counters_.dropped},
                {"replies_lost", counters_.replies_lost},
                {"events", events_.last()}}},
              {"event", {{"epoch", events_.epoch()}, {"seq", events_.last()}}}};
}

Result<json> Commands::rig_describe(const json&) {
  const Rig& rig = jobs_.site().rig;
  return caught(Code::internal, "rig", [&] {
    return json{{"file", jobs_.site().rig_file.string()},
                {"hash", rig.hash()},
                {"rig", json::parse(rig.to_json())}};
  });
}

Result<json> Commands::rig_check(const json& args) {
  return submitted_json(ALHAZEN_TRY(jobs_.submit_check(std::make_shared<const json>(args))));
}

Result<json> Commands::device_list(const json&) {
  json rows = json::array();
  if (jobs_.devices() != nullptr)
    for (const DeviceDescription& device : jobs_.devices()->describe())
      rows.push_back({{"name", device.name},
                      {"kind", std::string(name_of(device.kind))},
                      {"driver", device.driver},
                      {"use", device.use},
                      {"state", std::string(name_of(device.state))},
                      {"trouble", device.trouble}});
  return json{{"devices", std::move(rows)}};
}

Result<json> Commands::device_describe(const json& args) {
  const std::string name = args.at("device").get<std::string>();
  if (jobs_.devices() != nullptr)
    for (const DeviceDescription& device : jobs_.devices()->describe())
      if (device.name == name) return json{{"device", to_json(device)}};
  return Error{Code::invalid, "args.device is \"" + name + "\"; nobody knows this device"};
}

Result<json> Commands::plan_list(const json&) {
  json rows = json::array();
  for (const Preset& preset : jobs_.site().presets)
    rows.push_back({{"name", preset.name}, {"summary", preset.summary}});
  return json{{"presets", std::move(rows)}};
}

Result<json> Commands::plan_estimate(const json& args) {
  const Estimate estimate = ALHAZEN_TRY(jobs_.estimate_scan(args));
  json links = json::array();
  for (const LinkLoad& link : estimate.links)
    links.push_back({{"camera", link.camera}, {"megabytes_per_s", link.megabytes_per_s}});
  const std::int64_t free = free_bytes(jobs_.site().data_directory);
  return json{{"steps", estimate.steps},
              {"frames", estimate.frames},
              {"stacks", estimate.stacks},
              {"seconds", estimate.seconds},
              {"bytes_disk", estimate.bytes_disk},
              {"bytes_memory", estimate.bytes_memory},
              {"links", std::move(links)},
              {"notes", estimate.notes},
              {"disk_free", free},
              {"fits", static_cast<std::int64_t>(estimate.bytes_disk) <= free}};
}

Result<json> Commands::scan_submit(const json& args) {
  const auto batch = args.find("batch");
  std::vector<Jobs::Args> scans;
  if (batch == args.end()) {
    if (!args.contains("object"))
      return Error{Code::invalid, "args.object is missing; a scan must name its object.id"};
    scans.push_back(std::make_shared<const json>(args));
  } else {
    for (const char* key : {"object", "level", "keep_frames"})
      if (args.contains(key))
        return Error{Code::invalid,
                     "args." + std::string(key) + " stands beside args.batch; it must stand in it"};
    for (const char* key : {"plan", "volume", "reconstruction"})
      if (!args.at(key).empty())
        return Error{Code::invalid,
                     "args." + std::string(key) + " stands beside args.batch; it must stand in it"};
    for (const json& scan : *batch) scans.push_back(std::make_shared<const json>(scan));
  }
  const std::vector<Submitted> submitted = ALHAZEN_TRY(jobs_.submit_scans(scans));
  if (batch == args.end()) return submitted_json(submitted.front());
  json rows = json::array();
  for (const Submitted& one : submitted) rows.push_back(submitted_json(one));
  return json{{"jobs", std::move(rows)}};
}

Result<json> Commands::scan_list(const json& args) {
  const auto& all = jobs_.scans();
  return json{{"scans", page(all, args, [this](const ScanEntry& scan) { return reply_of(scan); })},
              {"total", all.size()}};
}

Result<json> Commands::scan_get(const json& args) {
  const std::string id = args.at("scan").get<std::string>();
  const ScanEntry* scan = jobs_.find_scan(id);
  if (scan == nullptr)
    return Error{Code::invalid, "args.scan is \"" + id + "\"; nobody knows this scan"};
  return json{{"scan", reply_of(*scan)}};
}

Result<json> Commands::reconstruct_submit(const json& args) {
  return submitted_json(ALHAZEN_TRY(jobs_.submit_reconstruction(
      args.at("scan").get<std::string>(), std::make_shared<const json>(args))));
}

Result<json> Commands::job_list(const json& args) {
  std::vector<const Job*> wanted = jobs_.list();
  if (const auto state = args.find("state"); state != args.end()) {
    const JobState only = job_state(state->get<std::string>()).value_or(JobState::queued);
    std::erase_if(wanted, [only](const Job* job) { return job->state != only; });
  }
  return json{{"jobs", page(wanted, args, [this](const Job* job) { return reply_of(*job); })},
              {"total", wanted.size()}};
}

Result<json> Commands::job_get(const json& args) {
  const std::string id = args.at("job").get<std::string>();
  const Job* job = jobs_.find(id);
  if (job == nullptr)
    return Error{Code::invalid, "args.job is \"" + id + "\"; nobody knows this job"};
  return json{{"job", reply_of(*job)}};
}

Result<json> Commands::job_pause(const json& args) {
  const HoldAt at = args.at("at") == "stop" ? HoldAt::stop : HoldAt::step;
  ALHAZEN_TRY(jobs_.pause(args.at("job").get<std::string>(), at));
  return job_get(args);
}

Result<json> Commands::job_resume(const json& args) {
  ALHAZEN_TRY(jobs_.resume(args.at("job").get<std::string>()));
  return job_get(args);
}

Result<json> Commands::job_stop(const json& args) {
  ALHAZEN_TRY(jobs_.stop(args.at("job").get<std::string>()));
  return job_get(args);
}

Result<json> Commands::job_abort(const json& args) {
  ALHAZEN_TRY(jobs_.abort(args.at("job").get<std::string>()));
  return job_get(args);
}

Result<json> Commands::queue_start(const json&) { return json{{"started", jobs_.start_queue()}}; }

Result<json> Commands::preview_take(const json& args) {
  return submitted_json(ALHAZEN_TRY(jobs_.submit_preview(std::make_shared<const json>(args))));
}

Result<json> Commands::events_replay(const json& args) {
  return events_.replay(args.at("epoch").get<std::string>(), args.at("after").get<std::uint64_t>(),
                        args.at("limit").get<std::size_t>());
}

Result<json> Commands::config_show(const json&) { return json{{"config", *daemon_.config}}; }

Result<json> Commands::log_level(const json& args) {
  const std::string name = args.at("level").get<std::string>();
  const Severity level = name == "debug"     ? Severity::debug
                         : name == "info"    ? Severity::info
                         : name == "warning" ? Severity::warning
                                             : Severity::error;
  daemon_.set_log_level(level);
  return json{{"level", name}};
}

Result<json> Commands::service_shutdown(const json&) {
  daemon_.shut_down();
  return json{{"stopping", true}};
}

}  // namespace alhazen
