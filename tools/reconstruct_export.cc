#include <cstdio>
#include <map>
#include <system_error>

#include "reconstruct/exchange/camera_files.h"
#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/scan/safe_file.h"
#include "reconstruct/scan/scan.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

Status make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    return Error{Code::unavailable,
                 "cannot make folder '" + folder.string() + "': " + error.message()};
  return {};
}

Status write_colmap(std::span<const ColmapImage> images, const fs::path& folder) {
  ALHAZEN_TRY(make_folder(folder));
  const ColmapModel model = to_colmap(images);
  ALHAZEN_TRY(write_file_safely(folder / "cameras.txt", model.cameras_txt));
  ALHAZEN_TRY(write_file_safely(folder / "images.txt", model.images_txt));
  return write_file_safely(folder / "points3D.txt", model.points3d_txt);
}

/// Every camera at every stop, seen from the object, which stands still then.
Result<std::vector<ColmapImage>> views_of(const Scan& scan) {
  std::map<int, double> measured_rad;
  for (const FrameRecord& record : ALHAZEN_TRY(scan.frame_log()).records)
    measured_rad[record.stop] = record.angle_rad;
  std::vector<ColmapImage> views;
  for (const Stop& stop : scan.manifest().stops) {
    const auto measured = measured_rad.find(stop.index);
    const Pose rig_from_object = scan.rig().turntable.rig_from_object(
        measured != measured_rad.end() ? measured->second : stop.wanted_rad);
    for (const PlannedCamera& planned : scan.manifest().cameras) {
      const CameraModel* camera = scan.rig().camera(planned.name);
      if (camera == nullptr)
        return Error{Code::invalid, "the rig has no camera '" + planned.name + "'"};
      char number[16];
      std::snprintf(number, sizeof number, "%03d", stop.index);
      views.push_back({std::string(number) + "_" + planned.name + ".png", *camera,
                       camera->camera_from_rig * rig_from_object});
    }
  }
  return views;
}

}  // namespace

Status convert_rig(const ConvertRigArgs& args, const Run& /*run*/) {
  const Rig rig = ALHAZEN_TRY(load_rig(args.rig));
  if (args.out.extension() == ".json") {
    ALHAZEN_TRY(write_file_safely(args.out, rig.to_json() + "\n"));
  } else {
    std::vector<ColmapImage> images;
    for (const CameraModel& camera : rig.cameras)
      images.push_back({camera.name + ".png", camera, camera.camera_from_rig});
    ALHAZEN_TRY(write_colmap(images, args.out));
  }
  std::printf("%s: %zu cameras, %zu displays, hash %s\n", args.out.c_str(), rig.cameras.size(),
              rig.displays.size(), rig.hash().c_str());
  return {};
}

Status export_scan(const ExportArgs& args, const Run& /*run*/) {
  const Scan scan = ALHAZEN_TRY(Scan::open(args.scan).in(args.scan.string()));
  const fs::path out = args.out.empty() ? args.scan / "export" : args.out;
  ALHAZEN_TRY(make_folder(out));
  const std::vector<ColmapImage> views = ALHAZEN_TRY(views_of(scan));
  ALHAZEN_TRY(write_colmap(views, out / "colmap"));
  std::printf("cameras     %s: %zu views\n", (out / "colmap").c_str(), views.size());
  std::error_code ignored;
  const fs::path from = args.scan / "mesh.ply";
  if (fs::exists(from, ignored)) {
    const Mesh mesh = ALHAZEN_TRY(read_mesh(from));
    for (const std::string& format : args.formats) {
      const fs::path file = out / ("mesh." + format);
      ALHAZEN_TRY(write_mesh(mesh, file));
      std::printf("mesh        %s\n", file.c_str());
    }
  } else {
    std::printf("mesh        none yet: alhazen-reconstruct run %s\n", args.scan.c_str());
  }
  std::printf("light maps  %s\n", (args.scan / "light_maps").c_str());
  return {};
}

}  // namespace alhazen
