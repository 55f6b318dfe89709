#include <cstdio>

#include "reconstruct/exchange/vtu.h"
#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/report/report.h"
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

}  // namespace

Status run_reconstruction(const RunArgs& args, const Run& run) {
  const Scan scan = ALHAZEN_TRY(Scan::open(args.scan).in(args.scan.string()));
  std::optional<Mesh> reference;  // before the work: a wrong path is told at once
  if (!args.reference.empty()) reference = ALHAZEN_TRY(read_mesh(args.reference));
  const std::filesystem::path out = args.out.empty() ? args.scan : args.out;
  std::error_code error;
  std::filesystem::create_directories(out, error);
  if (error) return Error{Code::unavailable, out.string() + ": " + error.message()};

  const StageClock loading;
  const std::vector<StackKey> keys = ALHAZEN_TRY(scan.light_maps());
  Reconstruction reconstruction = ALHAZEN_TRY(Reconstruction::make(
      scan.rig(), scan.manifest().volume, args.level.value_or(scan.manifest().level), Options{}));
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (run.stopped()) return Error{Code::cancelled, "interrupted"};
    run.tell("load light maps", static_cast<double>(i) / static_cast<double>(keys.size()));
    const LightMap map = ALHAZEN_TRY(scan.load_light_map(keys[i]));
    ALHAZEN_TRY(reconstruction.add(map));
  }
  run.tell("load light maps", 1);
  const StageTime loaded = loading.read("load light maps");
  Reconstructed made = ALHAZEN_TRY(reconstruction.finish(run));
  made.times.insert(made.times.begin(), loaded);

  ALHAZEN_TRY(write_mesh(made.mesh, out / "mesh.ply"));
  if (args.has_field) {
    ALHAZEN_TRY(
        write_vtu(made.octree, made.field, made.divergence, made.indicator, out / "field.vtu"));
  }
  Report report = ALHAZEN_TRY(
      make_report(scan, made, ALHAZEN_TRY(captured(scan)), reference ? &*reference : nullptr, run));
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
