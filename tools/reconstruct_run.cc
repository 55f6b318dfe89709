#include <algorithm>
#include <cstdio>

#include "reconstruct/exchange/vtu.h"
#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/report/report.h"
#include "reconstruct/scan/safe_file.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {
namespace {

/// What the scan directory says of its capture; times and warnings are those that the daemon left
/// in its own report, if it did.
Result<CaptureFigures> captured(const Scan& scan) {
  CaptureFigures figures = ALHAZEN_TRY(capture_figures(scan));
  if (auto report = read_report(scan.directory())) {
    figures.times = std::move(report->capture.times);
    figures.warnings = std::move(report->capture.warnings);
  }
  return figures;
}

/// A refinement takes thousands of points at which votes agree, not the finest of leaves.
constexpr int kRefineLevel = 8;

struct Loaded {
  Reconstruction reconstruction;
  StageTime time;
};

Result<Loaded> load(const Scan& scan, const Rig& rig, int level, const Run& run) {
  const StageClock loading;
  const std::vector<StackKey> keys = ALHAZEN_TRY(scan.light_maps());
  Reconstruction reconstruction =
      ALHAZEN_TRY(Reconstruction::make(rig, scan.manifest().volume, level, Options{}));
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (run.stopped()) return Error{Code::cancelled, "interrupted"};
    run.tell("load light maps", static_cast<double>(i) / static_cast<double>(keys.size()));
    const LightMap map = ALHAZEN_TRY(scan.load_light_map(keys[i]));
    ALHAZEN_TRY(reconstruction.add(map));
  }
  run.tell("load light maps", 1);
  return Loaded{std::move(reconstruction), loading.read("load light maps")};
}

/// The scan's calibration refined by a first, coarser reconstruction.
Result<RefinedRig> refine(const Scan& scan, int level, const Run& run) {
  Loaded first = ALHAZEN_TRY(load(scan, scan.rig(), std::min(level, kRefineLevel), run));
  const Reconstructed made = ALHAZEN_TRY(first.reconstruction.finish(run));
  return first.reconstruction.refine(made.mesh, run);
}

}  // namespace

Status run_reconstruction(const RunArgs& args, const Run& run) {
  const Scan scan = ALHAZEN_TRY(Scan::open(args.scan).in(args.scan.string()));
  std::optional<Mesh> reference;  // before the work: a wrong path is told at once
  if (!args.reference.empty()) reference = ALHAZEN_TRY(read_mesh(args.reference));
  const std::filesystem::path out = args.out.empty() ? args.scan : args.out;
  std::error_code error;
  std::filesystem::create_directories(out, error);
  if (error) return Error{Code::unavailable, out.string() + ": " + error.message()};

  const int level = args.level.value_or(scan.manifest().level);
  const StageClock refining;
  RefinedRig refined{scan.rig(), {}};
  if (args.is_refined) {
    refined = ALHAZEN_TRY(refine(scan, level, run));
    if (refined.how.is_accepted)
      ALHAZEN_TRY(write_file_safely(out / "rig_refined.json", refined.rig.to_json()));
  }
  const StageTime refine_time = refining.read("refine, with a first pass");

  Loaded loaded = ALHAZEN_TRY(load(scan, refined.rig, level, run));
  Reconstructed made = ALHAZEN_TRY(loaded.reconstruction.finish(run));
  made.times.insert(made.times.begin(), loaded.time);
  if (args.is_refined) {
    made.times.insert(made.times.begin(), refine_time);
    if (!refined.how.is_accepted)
      made.warnings.push_back("the calibration was not refined: " + refined.how.refusal);
  }

  ALHAZEN_TRY(write_mesh(made.mesh, out / "mesh.ply"));
  if (args.has_field) {
    ALHAZEN_TRY(
        write_vtu(made.octree, made.field, made.divergence, made.indicator, out / "field.vtu"));
  }
  Report report = ALHAZEN_TRY(
      make_report(scan, made, ALHAZEN_TRY(captured(scan)), reference ? &*reference : nullptr, run));
  if (args.is_refined) report.refinement = refined.how;
  report.reference = args.reference.filename().string();
  ALHAZEN_TRY(write_report(report, made.mesh, out));
  std::fputs(report.brief().c_str(), stdout);
  for (const StageTime& time : made.times)
    std::printf("  %-24s %8.2f s CPU %8.2f s\n", time.stage.c_str(), time.cpu_s, time.wall_s);
  std::printf("mesh        %s\nreport      %s\n", (out / "mesh.ply").c_str(),
              (out / "report.html").c_str());
  if (args.has_field) std::printf("field       %s\n", (out / "field.vtu").c_str());
  return {};
}

}  // namespace alhazen
