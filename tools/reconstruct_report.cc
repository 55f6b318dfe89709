#include <cstdio>

#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/report/report.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {

Status report_again(const ReportArgs& args, const Run& run) {
  Report report = ALHAZEN_TRY(read_report(args.scan));
  const Mesh mesh = ALHAZEN_TRY(read_mesh(args.scan / "mesh.ply"));
  report.mesh = mesh_figures(mesh);
  // A folder that holds results alone has no light maps to look at.
  if (const auto scan = Scan::open(args.scan))
    report.light_maps = ALHAZEN_TRY(light_map_samples(*scan));
  report.reference.clear();
  report.comparison.reset();
  if (!args.reference.empty()) {
    const Mesh reference = ALHAZEN_TRY(read_mesh(args.reference));
    report.comparison = ALHAZEN_TRY(compare(mesh, reference, {}, run));
    report.reference = args.reference.filename().string();
  }
  const std::filesystem::path out = args.out.empty() ? args.scan : args.out;
  std::error_code error;
  std::filesystem::create_directories(out, error);
  if (error) return Error{Code::unavailable, out.string() + ": " + error.message()};
  ALHAZEN_TRY(write_report(report, mesh, out));
  std::fputs(report.brief().c_str(), stdout);
  return {};
}

}  // namespace alhazen
