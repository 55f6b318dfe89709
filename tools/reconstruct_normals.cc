#include <algorithm>
#include <cstdio>
#include <set>

#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/normals/normal_tables.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/report/report.h"
#include "reconstruct/scan/safe_file.h"
#include "reconstruct/single_view.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {
namespace {}  // namespace

Status reconstruct_normals(const NormalsArgs& args, const Run& run) {
  const Rig rig = ALHAZEN_TRY(Rig::load(args.rig));
  const std::string table = args.views.filename().string();
  const std::vector<ViewEntry> views =
      ALHAZEN_TRY(parse_views(ALHAZEN_TRY(read_file(args.views, kMaxTableBytes))).in(table));
  std::optional<Mesh> reference;  // before the work: a wrong path is told at once
  if (!args.reference.empty()) reference = ALHAZEN_TRY(read_mesh(args.reference));
  std::error_code error;
  std::filesystem::create_directories(args.out, error);
  if (error) return Error{Code::unavailable, args.out.string() + ": " + error.message()};

  Volume volume;
  if (args.centre_mm.size() == 3) volume.centre_mm = Eigen::Vector3d(args.centre_mm.data());
  volume.edge_mm = args.edge_mm.value_or(volume.edge_mm);
  const StageClock loading;
  const Options options = Options::for_normal_maps();
  Reconstruction reconstruction =
      ALHAZEN_TRY(Reconstruction::make(rig, volume, args.level, options));
  std::optional<NormalMap> only;  // one view has no parallax: it is integrated
  std::set<int> stops;
  std::set<std::string> cameras;
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (run.stopped()) return Error{Code::cancelled, "interrupted"};
    run.tell("load normal maps", static_cast<double>(i) / static_cast<double>(views.size()));
    const ViewEntry& view = views[i];
    const std::string where = table + ", line " + std::to_string(view.line);
    const CameraModel* camera = rig.camera(view.key.camera);
    if (camera == nullptr) {
      return Error{Code::invalid, "the rig has no camera '" + view.key.camera + "'", where};
    }
    NormalMapFormat format = view.format;
    const std::filesystem::path folder = args.views.parent_path();
    if (!format.mask.empty()) format.mask = folder / format.mask;
    NormalMap map = ALHAZEN_TRY(
        read_normal_map(folder / view.file, format, *camera, view.key, view.angle_rad).in(where));
    if (views.size() == 1) {
      only = std::move(map);
    } else {
      ALHAZEN_TRY(reconstruction.add(map).in(where));
    }
    stops.insert(view.key.stop);
    cameras.insert(view.key.camera);
  }
  run.tell("load normal maps", 1);
  const StageTime loaded = loading.read("load normal maps");
  Reconstructed made =
      ALHAZEN_TRY(only ? reconstruct_single_view(rig, *only, volume, args.level, options, run)
                       : reconstruction.finish(run));
  made.times.insert(made.times.begin(), loaded);

  ALHAZEN_TRY(write_mesh(made.mesh, args.out / "mesh.ply"));
  Provenance provenance;
  provenance.note = table;
  provenance.rig_hash = rig.hash();
  provenance.coding = "normal maps";
  provenance.cameras = cameras.size();
  provenance.stops = stops.size();
  Report report = ALHAZEN_TRY(
      make_report(provenance, made, CaptureFigures{}, reference ? &*reference : nullptr, run));
  report.reference = args.reference.filename().string();
  ALHAZEN_TRY(write_report(report, made.mesh, args.out));
  std::fputs(report.brief().c_str(), stdout);
  for (const StageTime& time : made.times)
    std::printf("  %-24s %8.2f s CPU %8.2f s\n", time.stage.c_str(), time.cpu_s, time.wall_s);
  std::printf("mesh        %s\nreport      %s\n", (args.out / "mesh.ply").c_str(),
              (args.out / "report.html").c_str());
  return {};
}

}  // namespace alhazen
