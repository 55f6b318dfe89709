#include "daemon/control/verbs.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

namespace alhazen {
namespace {

using nlohmann::json;
using A = Argument;

A job_argument() { return A::id("job", "id of the job").compulsory().by_position(); }

/// Tunables of a reconstruction; ranges as in reconstruct/options.h.
A reconstruction_argument() {
  return A::table("reconstruction",
                  "tunables of the reconstruction; what is left out keeps its default",
                  {A::number("bandwidth_rad", "bandwidth of the kernel on normals at level 7", 1e-6,
                             0.5, "rad"),
                   A::number("bandwidth_ratio", "by which it shrinks at each finer level", 0.1, 1),
                   A::number("lambda", "weight of the flux term", 1e-6, 100),
                   A::number("beta", "how fast smoothness gives way to consistency", 1e-6, 20),
                   A::number("g_min", "least smoothness", 1e-6, 1)});
}

A formats_argument() {
  return A::list("mesh_formats", "files written beside mesh.ply", 0, 2,
                 A::choice("", "format", {"obj", "stl"}))
      .or_else("[]");
}

A object_argument() {
  return A::table("object", "what is scanned",
                  {A::id("id", "name of the object").compulsory().by_position(),
                   A::text("note", "anything worth keeping", 0, 4096),
                   A::text("operator", "who scans", 0, 64)});
}

/// Of a scan, but for its object.
std::vector<A> plan_arguments() {
  return {
      A::table("plan", "how; the preset's choices first, then these",
               {A::id("preset", "a plan of config/plans"),
                A::whole("stops", "stops of the turntable, evenly over a full turn", 1, 360),
                A::list("angles_deg", "instead of stops: rising angles", 1, 360,
                        A::number("", "angle", -360, 360, "deg")),
                A::list("displays", "displays that show patterns", 1, 64, A::id("", "display")),
                A::list("cameras", "cameras that take part", 1, 64, A::id("", "camera")),
                A::choice("coding", "how positions are coded", {"gray", "gray_phase"}),
                A::whole("exposure_us", "of all cameras", 1, 60'000'000, "us"),
                A::number("gain_db", "of all cameras", 0, 100, "dB"),
                A::flag("crop", "read out only what sees the volume")}),
      A::table("volume", "the cube that is reconstructed, in the object's frame",
               {A::list("centre_mm", "its centre; default on the axis, floor on the plate", 3, 3,
                        A::number("", "coordinate", -2000, 2000, "mm")),
                A::number("edge_mm", "its edge", 1, 2000, "mm")}),
      A::whole("level", "finest octree level: voxel = edge / 2^level", 4, 11),
      A::choice("keep_frames", "which pictures stay on disk", {"none", "failed", "sample", "all"}),
      A::choice("on_error", "what becomes of the queue when this scan fails", {"stop", "next"})
          .or_else("\"stop\""),
      A::choice("on_gap", "when a stack cannot be taken: fail, or list it and go on",
                {"fail", "accept"})
          .or_else("\"fail\""),
      reconstruction_argument(),
      formats_argument(),
  };
}

std::vector<A> submit_arguments() {
  std::vector<A> one = plan_arguments();
  one.insert(one.begin(), object_argument().compulsory());
  std::vector<A> arguments = plan_arguments();
  arguments.insert(arguments.begin(), object_argument());
  arguments.push_back(A::list("batch", "several scans, all or nothing, instead of the other keys",
                              1, 1000, A::table("", "scan", std::move(one))));
  return arguments;
}

std::vector<Verb> make_table() {
  std::vector<Verb> table;
  const auto add = [&](Verb verb) { table.push_back(std::move(verb)); };
  const std::string unknown_job = "invalid: nobody knows the job";

  add({"hello",
       Role::observer,
       "versions, role and this table",
       {},
       "{protocol, software, epoch, event_endpoint, role, limits, verbs}",
       "",
       false,
       false});
  add({"ping", Role::observer, "whether the daemon answers", {}, "{at}", "", false, false});
  add({"status",
       Role::observer,
       "state, readiness, running jobs, devices, counters",
       {},
       "{state, live, ready, can_scan, reasons, uptime_s, jobs, queue, devices, disk, counters, "
       "event}",
       "",
       false,
       false});

  add({"rig.describe",
       Role::observer,
       "the calibrated geometry",
       {},
       "{file, hash, rig}",
       "",
       false,
       false});
  add({"rig.check",
       Role::operator_,
       "opens what is missing, reads back settings, takes a frame of each camera, checks disk",
       {},
       "{job}",
       "conflict: the daemon is stopping",
       true,
       true});

  add({"device.list",
       Role::observer,
       "every device with its state",
       {},
       "{devices}",
       "",
       false,
       false});
  add({"device.describe",
       Role::observer,
       "one device: facts, settings with ranges, readings",
       {A::id("device", "name of the device").compulsory().by_position()},
       "{device}",
       "invalid: nobody knows the device",
       false,
       false});

  add({"plan.list", Role::observer, "the presets", {}, "{presets}", "", false, false});
  add({"plan.estimate", Role::observer, "steps, seconds, bytes and link load of a scan",
       plan_arguments(),
       "{steps, frames, stacks, seconds, bytes_disk, bytes_memory, links, notes, "
       "disk_free, fits}",
       "invalid: as scan.submit; conflict: the devices are not open yet", false, false});

  add({"scan.submit", Role::operator_, "queues one scan, or a batch, all or nothing",
       submit_arguments(), "{job, scan} or {jobs: [{job, scan}]}",
       "invalid: the rig cannot do it, naming key and range; conflict: the devices are not open "
       "yet, the daemon is stopping; exhausted: the disk is too small",
       true, true});
  add({"scan.list",
       Role::observer,
       "the scans, newest first",
       {A::whole("limit", "at most so many", 1, 1000).or_else("100"),
        A::whole("offset", "leave out so many", 0, 1e9).or_else("0")},
       "{scans, total}",
       "",
       false,
       false});
  add({"scan.get",
       Role::observer,
       "one scan: plan in short, files, state",
       {A::id("scan", "id of the scan").compulsory().by_position()},
       "{scan}",
       "invalid: nobody knows the scan",
       false,
       false});

  add({"reconstruct.submit",
       Role::operator_,
       "reconstructs a scan again with other options",
       {A::id("scan", "id of the scan").compulsory().by_position(),
        A::whole("level", "finest octree level; default the scan's own", 4, 11),
        reconstruction_argument(), formats_argument()},
       "{job, scan}",
       "invalid: nobody knows the scan; conflict: it is still being taken",
       true,
       true});

  add({"job.list",
       Role::observer,
       "jobs of every kind, newest first",
       {A::choice("state", "only those",
                  {"queued", "running", "paused", "interrupted", "done", "done_with_gaps", "failed",
                   "cancelled"}),
        A::whole("limit", "at most so many", 1, 1000).or_else("100"),
        A::whole("offset", "leave out so many", 0, 1e9).or_else("0")},
       "{jobs, total}",
       "",
       false,
       false});
  add({"job.get",
       Role::observer,
       "one job: state, stages, warnings, result",
       {job_argument()},
       "{job}",
       unknown_job,
       false,
       false});
  add({"job.pause",
       Role::operator_,
       "holds a running scan",
       {job_argument(),
        A::choice("at", "where: after this step, or this stop of the turntable", {"step", "stop"})
            .or_else("\"step\"")},
       "{job}",
       unknown_job + "; conflict: it is not running; unsupported: it cannot pause",
       false,
       true});
  add({"job.resume",
       Role::operator_,
       "goes on with a paused or interrupted job",
       {job_argument()},
       "{job}",
       unknown_job + "; conflict: neither paused nor interrupted",
       false,
       true});
  add({"job.stop",
       Role::operator_,
       "ends a job, keeps its data; it can be resumed",
       {job_argument()},
       "{job}",
       unknown_job + "; conflict: it has ended",
       false,
       true});
  add({"job.abort",
       Role::operator_,
       "ends a job for good; the rig goes to its safe state at once",
       {job_argument()},
       "{job}",
       unknown_job + "; conflict: it has ended",
       false,
       true});

  add({"queue.start",
       Role::operator_,
       "lets a queue go on that an error has stopped",
       {},
       "{started}",
       "",
       false,
       true});

  add({"preview.take",
       Role::operator_,
       "one picture of each camera, outside a scan",
       {A::list("cameras", "which; default all", 1, 64, A::id("", "camera")),
        A::id("display", "lights this display white; default all black"),
        A::whole("exposure_us", "default the camera's own", 1, 60'000'000, "us"),
        A::number("gain_db", "default the camera's own", 0, 100, "dB")},
       "{job}",
       "conflict: the devices are not open yet, a scan runs or waits",
       true,
       true});

  add({"events.replay",
       Role::observer,
       "events that a reader missed",
       {A::text("epoch", "of the events; empty: the present one", 0, 64).or_else("\"\""),
        A::whole("after", "the last number that was seen", 0, 9e15).or_else("0"),
        A::whole("limit", "at most so many", 1, 1000).or_else("1000")},
       "{epoch, events, next, last, lost}",
       "conflict: another epoch, the daemon was restarted",
       false,
       false});

  add({"config.show",
       Role::observer,
       "the configuration, resolved",
       {},
       "{config}",
       "",
       false,
       false});
  add({"log.level",
       Role::admin,
       "drops less severe lines from the log",
       {A::choice("level", "the least severity that is written",
                  {"debug", "info", "warning", "error"})
            .compulsory()
            .by_position()},
       "{level}",
       "",
       false,
       false});
  add({"service.shutdown",
       Role::admin,
       "ends the daemon in order: the running scan is kept and can be resumed",
       {},
       "{stopping}",
       "",
       false,
       false});
  return table;
}

}  // namespace

std::string_view name_of(Role role) noexcept {
  switch (role) {
    case Role::observer:
      return "observer";
    case Role::operator_:
      return "operator";
    case Role::admin:
      return "admin";
  }
  return "";
}

std::string_view Verb::group() const {
  const std::size_t dot = name.find('.');
  return dot == std::string::npos ? std::string_view("session")
                                  : std::string_view(name).substr(0, dot);
}
std::string_view Verb::word() const {
  const std::size_t dot = name.find('.');
  return dot == std::string::npos ? std::string_view(name) : std::string_view(name).substr(dot + 1);
}

const std::vector<Verb>& verbs() {
  static const std::vector<Verb> kTable = make_table();
  return kTable;
}

const Verb* find_verb(std::string_view name) {
  for (const Verb& verb : verbs())
    if (verb.name == name) return &verb;
  return nullptr;
}

json verbs_json() {
  json table = json::object();
  for (const Verb& verb : verbs()) {
    const A arguments = A::table("args", verb.help, verb.arguments);
    table[verb.name] = {{"role", std::string(name_of(verb.role))},
                        {"help", verb.help},
                        {"arguments", arguments.schema()},
                        {"reply", verb.reply},
                        {"errors", verb.errors},
                        {"job", verb.makes_job}};
  }
  return table;
}

namespace {
void list_arguments(const std::vector<A>& arguments, const std::string& prefix, std::string& page) {
  for (const A& argument : arguments) {
    page += "  - `" + prefix + argument.name + "`" + (argument.required ? " (compulsory)" : "") +
            ": " + argument.help;
    if (argument.type == A::Type::table) {
      page += "\n";
      list_arguments(argument.fields, prefix + argument.name + ".", page);
      continue;
    }
    page += "; " + argument.wanted();
    if (!argument.fallback.empty()) page += "; default " + argument.fallback;
    page += "\n";
  }
}
}  // namespace

std::string verbs_markdown() {
  std::string page;
  for (const Verb& verb : verbs()) {
    page += "- **" + verb.name + "** (" + std::string(name_of(verb.role)) + "): " + verb.help +
            ". Reply `" + verb.reply + "`";
    if (!verb.errors.empty()) page += ". Errors: " + verb.errors;
    page += ".\n";
    list_arguments(verb.arguments, "", page);
  }
  return page;
}

}  // namespace alhazen
