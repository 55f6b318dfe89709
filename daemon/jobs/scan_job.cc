#include "daemon/jobs/scan_job.h"

#include <tbb/task_arena.h>

#include <cmath>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "alhazen/caught.h"
#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/report/report.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

std::shared_ptr<const json> shared(json body) {
  return std::make_shared<const json>(std::move(body));
}

double seconds(Time::duration duration) { return std::chrono::duration<double>(duration).count(); }

std::string scan_name(const fs::path& directory) { return directory.filename().string(); }

/// What a stage tells, thinned out: the control thread hears of whole half percents.
class Teller {
 public:
  Teller(std::string job, EventQueue& events, Lane& lane)
      : job_(std::move(job)), events_(events), lane_(lane) {}

  /// Thread-safe: stages call it from their arena.
  void operator()(std::string_view stage, double share) {
    lane_.beat();
    {
      const std::scoped_lock lock(mutex_);
      const auto known = said_.find(stage);
      constexpr double kLeastChange = 0.005;
      if (known != said_.end() && std::abs(known->second - share) < kLeastChange && share < 1)
        return;
      if (known == said_.end())
        said_.emplace(std::string(stage), share);
      else
        known->second = share;
    }
    events_.push({job_, Told{{std::string(stage), share, 0, 0}, 0}});
  }

 private:
  const std::string job_;
  EventQueue& events_;
  Lane& lane_;
  std::mutex mutex_;
  std::map<std::string, double, std::less<>> said_;
};

/// Opens the scan's directory, or makes it: after a crash in between, it is found made.
Result<Scan> open_or_create(const ScanWork& work) {
  std::error_code error;
  if (fs::exists(work.directory / "manifest.json", error)) return Scan::open(work.directory);
  if (!work.plan)
    return Error{Code::unavailable, "'" + work.directory.string() + "' holds no scan"};
  return Scan::create(work.directory, *work.plan, work.rig);
}

json body_of(const ScanWork& work, const Step& step, const Manifest& plan) {
  return {{"job", work.job},
          {"scan", scan_name(work.directory)},
          {"stop", step.stop},
          {"display", plan.displays[static_cast<std::size_t>(step.display)].name},
          {"pattern", step.pattern}};
}

Result<Captured> capture(ScanWork& work, RigRoom& room, EventQueue& events, Lane& lane) {
  work.scan = ALHAZEN_TRY(open_or_create(work));
  Scan& scan = *work.scan;
  ALHAZEN_TRY(write_file_safely(work.directory / "job.json", work.job_record));
  const Manifest& plan = scan.manifest();
  const std::vector<StackKey> safe = ALHAZEN_TRY(scan.light_maps());
  events.push({work.job, ScanOpened{}});
  for (const StackKey& key : safe)
    if (!work.feed.push({key, nullptr}, work.stop)) return Error{Code::cancelled, "stop requested"};

  const std::uint64_t stacks = plan.stops.size() * plan.displays.size() * plan.cameras.size();
  std::atomic<std::uint64_t> decoded{safe.size()};
  const auto tell_decoded = [&] {
    const std::uint64_t done = decoded.load();
    events.push({work.job, Told{{"decode", static_cast<double>(done) / static_cast<double>(stacks),
                                 done, stacks},
                                0}});
  };
  tell_decoded();
  const Time begin = room.clock().now();
  CaptureHooks hooks;
  hooks.on_step = [&](const CaptureProgress& progress) {
    lane.beat();
    events.push(
        {work.job,
         Told{{"steps", static_cast<double>(progress.done) / static_cast<double>(progress.total),
               progress.done, progress.total},
              seconds(room.clock().now() - begin)}});
  };
  hooks.on_retake = [&](const Retake& retake) {
    lane.beat();
    json body = body_of(work, retake.step, plan);
    body.update({{"camera", retake.camera},
                 {"attempt", retake.attempt},
                 {"code", std::string(name_of(retake.cause.code))},
                 {"what", retake.cause.what}});
    events.push({work.job, Retaken{shared(std::move(body))}});
  };
  hooks.on_stop_done = [&](int stop, double measured_rad) {
    lane.beat();
    // The only moment of a scan at which asking the devices for figures disturbs nothing.
    room.devices().refresh_readings();
    constexpr double kDegPerRad = 57.29577951308232;
    events.push({work.job, Noted{"scan.stop", shared({{"job", work.job},
                                                      {"scan", scan_name(work.directory)},
                                                      {"stop", stop},
                                                      {"stops", plan.stops.size()},
                                                      {"angle_deg", measured_rad * kDegPerRad}})}});
  };
  hooks.on_light_map = [&](std::shared_ptr<const LightMap> map) {
    const StackKey key = map->key;
    if (work.feed.size() >= ScanWork::kMostCarried) map.reset();
    // Fails only when the job is being stopped: then nobody wants it.
    static_cast<void>(work.feed.push({key, std::move(map)}, work.stop));
    decoded.fetch_add(1);
    tell_decoded();
    events.push({work.job, Noted{"scan.light_map", shared({{"job", work.job},
                                                           {"scan", scan_name(work.directory)},
                                                           {"stop", key.stop},
                                                           {"display", key.display},
                                                           {"camera", key.camera}})}});
  };
  hooks.on_gap = [&](const Gap& gap) {
    events.push({work.job,
                 Warned{"no light map of stop " + std::to_string(gap.key.stop) + ", display " +
                        gap.key.display + ", camera " + gap.key.camera + ": " + gap.cause.text()}});
  };
  hooks.on_hold = [&](bool held) {
    lane.beat();
    events.push({work.job, Held{held ? work.hold.reason() : std::string()}});
  };
  hooks.on_warning = [&](const std::string& line) { events.push({work.job, Warned{line}}); };
  return capture_scan(scan, room.devices(), room.clock(), work.capture, work.hold, hooks,
                      work.stop);
}

/// mesh.ply and what else was asked for, report.json, report.html.
Result<std::shared_ptr<const json>> write_results(const Scan& scan, Reconstructed made,
                                                  std::vector<StageTime> capture_times,
                                                  const ReconstructionChoices& choices,
                                                  const Run& run) {
  std::error_code error;
  fs::create_directories(choices.output, error);
  if (error)
    return Error{Code::unavailable,
                 "cannot make '" + choices.output.string() + "': " + error.message()};
  const fs::path relative = choices.output.lexically_relative(scan.directory());
  const auto name = [&](const std::string& file) {
    return (relative == "." ? fs::path(file) : relative / file).string();
  };
  json files = json::object();
  ALHAZEN_TRY(write_mesh(made.mesh, choices.output / "mesh.ply"));
  files["mesh"] = name("mesh.ply");
  for (const std::string& format : choices.formats) {
    const std::string file = "mesh." + format;
    ALHAZEN_TRY(write_mesh(made.mesh, choices.output / file));
    files["mesh_" + format] = name(file);
  }
  run.tell("report", 0);
  CaptureFigures figures = ALHAZEN_TRY(capture_figures(scan));
  figures.times = std::move(capture_times);
  const Report report = ALHAZEN_TRY(make_report(scan, made, std::move(figures), nullptr, run));
  ALHAZEN_TRY(write_report(report, made.mesh, choices.output));
  run.tell("report", 1);
  files["report_json"] = name("report.json");
  files["report_html"] = name("report.html");
  return shared({{"files", std::move(files)},
                 {"vertices", report.mesh.vertices},
                 {"triangles", report.mesh.triangles},
                 {"observed_share", report.mesh.observed_share},
                 {"light_maps", made.light_maps},
                 {"warnings", report.reconstruction.warnings}});
}

Result<std::shared_ptr<const json>> reconstruct_while_scanning(ScanWork& work, EventQueue& events,
                                                               Lane& lane) {
  const Scan& scan = *work.scan;
  const Manifest& plan = scan.manifest();
  const std::stop_token stop = work.stop;
  Teller teller(work.job, events, lane);
  const Run quiet{stop, [&lane](std::string_view, double) { lane.beat(); }};
  const Run run{stop, [&teller](std::string_view stage, double share) { teller(stage, share); }};

  const StageClock clock;
  Reconstruction reconstruction = ALHAZEN_TRY(
      Reconstruction::make(scan.rig(), plan.volume, work.reconstruction.level.value_or(plan.level),
                           work.reconstruction.options));
  const std::size_t stacks_of_stop = plan.displays.size() * plan.cameras.size();
  std::map<int, std::size_t> maps_of_stop;
  std::uint64_t maps = 0;
  while (std::optional<FedMap> fed = work.feed.pop(stop)) {
    lane.beat();
    if (fed->map) {
      ALHAZEN_TRY(reconstruction.add(*fed->map));
    } else {
      const LightMap map = ALHAZEN_TRY(scan.load_light_map(fed->key));
      ALHAZEN_TRY(reconstruction.add(map));
    }
    fed->map.reset();
    ++maps;
    // A preview of the latest whole stop: those that more light maps are waiting behind would be
    // old before they are written.
    if (++maps_of_stop[fed->key.stop] < stacks_of_stop || work.feed.size() >= stacks_of_stop)
      continue;
    Result<Mesh> preview = reconstruction.preview(quiet);
    if (!preview) {
      if (preview.error().code == Code::conflict) continue;  // nothing agrees yet
      return std::move(preview.error()).in("preview");
    }
    const fs::path file = work.directory / "preview.ply";
    ALHAZEN_TRY(write_mesh(*preview, file));
    events.push(
        {work.job, Noted{"preview.mesh", shared({{"job", work.job},
                                                 {"scan", scan_name(work.directory)},
                                                 {"file", file.string()},
                                                 {"light_maps", maps},
                                                 {"stops", maps_of_stop.size()},
                                                 {"triangles", preview->triangles.size()}})}});
  }
  // Without every stack there is nothing to finish; why is the capture's to tell.
  if (run.stopped() || !work.complete.load())
    return Error{Code::cancelled, "the scan ended before its last light map"};
  // What ran beside adding and previews is counted there: the clock is the whole process's.
  StageTime captured = clock.read("capture, decode");
  Reconstructed made = ALHAZEN_TRY(reconstruction.finish(run));
  for (const StageTime& stage : made.times)
    if (stage.stage == "add" || stage.stage == "preview") captured.cpu_s -= stage.cpu_s;
  return write_results(scan, std::move(made), {std::move(captured)}, work.reconstruction, run);
}

Ended ended(LaneName lane, Result<std::shared_ptr<const json>> outcome) {
  if (!outcome) return {lane, std::move(outcome.error()), nullptr, false};
  return {lane, {}, *std::move(outcome), false};
}

}  // namespace

Ended run_capture(ScanWork& work, RigRoom& room, EventQueue& events, Lane& lane) {
  const auto outcome = capture(work, room, events, lane);
  work.complete.store(static_cast<bool>(outcome));
  work.feed.close();
  if (!outcome)
    return {LaneName::rig, outcome.error().in("scan " + scan_name(work.directory)), nullptr, false};
  json gaps = json::array();
  for (const Gap& gap : outcome->gaps)
    gaps.push_back({{"stop", gap.key.stop},
                    {"display", gap.key.display},
                    {"camera", gap.key.camera},
                    {"cause", gap.cause.text()}});
  json capture = {{"frames", outcome->frames},       {"retakes", outcome->retakes},
                  {"reopened", outcome->reopened},   {"light_maps", outcome->light_maps},
                  {"skipped", outcome->skipped},     {"seconds", outcome->seconds},
                  {"unchanged", outcome->unchanged}, {"gaps", std::move(gaps)}};
  return {LaneName::rig, {}, shared({{"capture", std::move(capture)}}), !outcome->gaps.empty()};
}

Ended run_scan_reconstruction(ScanWork& work, EventQueue& events, Lane& lane) {
  tbb::task_arena arena(work.reconstruction.threads);
  return ended(LaneName::compute,
               arena.execute([&] { return reconstruct_while_scanning(work, events, lane); }));
}

Ended run_reconstruction(const std::string& job, const fs::path& scan_directory,
                         const ReconstructionChoices& choices, const std::string& job_record,
                         EventQueue& events, Lane& lane, std::stop_token stop) {
  Teller teller(job, events, lane);
  const Run run{std::move(stop),
                [&teller](std::string_view stage, double share) { teller(stage, share); }};
  const auto reconstruct = [&]() -> Result<std::shared_ptr<const json>> {
    std::error_code error;
    fs::create_directories(choices.output, error);
    ALHAZEN_TRY(write_file_safely(choices.output / "job.json", job_record));
    const Scan scan = ALHAZEN_TRY(Scan::open(scan_directory));
    Reconstruction reconstruction = ALHAZEN_TRY(
        Reconstruction::make(scan.rig(), scan.manifest().volume,
                             choices.level.value_or(scan.manifest().level), choices.options));
    const std::vector<StackKey> keys = ALHAZEN_TRY(scan.light_maps());
    for (std::size_t i = 0; i < keys.size(); ++i) {
      if (run.stopped()) return Error{Code::cancelled, "stop requested"};
      const LightMap map = ALHAZEN_TRY(scan.load_light_map(keys[i]));
      ALHAZEN_TRY(reconstruction.add(map));
      run.tell("read", static_cast<double>(i + 1) / static_cast<double>(keys.size()));
    }
    Reconstructed made = ALHAZEN_TRY(reconstruction.finish(run));
    return write_results(scan, std::move(made), {}, choices, run);
  };
  tbb::task_arena arena(choices.threads);
  return ended(LaneName::compute,
               arena.execute(reconstruct).in("scan " + scan_name(scan_directory)));
}

}  // namespace alhazen
