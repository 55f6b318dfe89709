#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/decode/decoder.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/normals/photometric_stereo.h"
#include "reconstruct/run.h"

namespace alhazen {

// The sub-commands of alhazen-reconstruct, each in its own file reconstruct_NAME.cc. Results go to
// standard output, progress to the Run.

/// Of a table that a sub-command is given.
constexpr std::uint64_t kMaxTableBytes = std::uint64_t{1} << 30;

/// alhazen-reconstruct info
struct InfoArgs {
  std::filesystem::path scan;
  bool has_maps = false;  ///< loads every light map and says what its pixels saw
  bool as_json = false;
};
Status show_scan(const InfoArgs& args, const Run& run);

/// alhazen-reconstruct run
struct RunArgs {
  std::filesystem::path scan;
  std::optional<int> level;         ///< instead of the scan's
  std::filesystem::path reference;  ///< empty where there is none
  std::filesystem::path out;        ///< empty: into the scan directory
  bool has_field = false;           ///< writes field.vtu, too
  bool is_refined = false;          ///< the calibration first, from the scan's own reflections
};
Status run_reconstruction(const RunArgs& args, const Run& run);

/// alhazen-reconstruct report
struct ReportArgs {
  std::filesystem::path scan;       ///< with mesh.ply and report.json
  std::filesystem::path reference;  ///< empty where there is none
  std::filesystem::path out;        ///< empty: into the scan directory
};
Status report_again(const ReportArgs& args, const Run& run);

/// alhazen-reconstruct decode
struct DecodeArgs {
  std::filesystem::path frames;            ///< frames.csv; its pictures lie relative to it
  std::filesystem::path rig;               ///< empty: sizes of cameras are not checked
  std::filesystem::path out;               ///< folder of the light maps
  std::vector<std::string> display_sizes;  ///< "NAME=WxH", before the rig's
  int bits = 0;                            ///< significant bits of a pixel, 0: the file's
  DecodeOptions options;
};
/// Prints one JSON object a light map.
Status decode_frames(const DecodeArgs& args, const Run& run);

/// alhazen-reconstruct normals
struct NormalsArgs {
  std::filesystem::path views;  ///< VIEWS.csv; its files lie relative to it
  std::filesystem::path rig;
  std::filesystem::path out;
  std::filesystem::path reference;  ///< empty where there is none
  std::vector<double> centre_mm;    ///< of the volume: none or three
  std::optional<double> edge_mm;    ///< of the volume
  int level = 8;
};
Status reconstruct_normals(const NormalsArgs& args, const Run& run);

/// alhazen-reconstruct stereo
struct StereoArgs {
  std::filesystem::path lights;  ///< LIGHTS.csv; its pictures lie relative to it
  std::filesystem::path mask;    ///< empty: every pixel is the object's
  std::filesystem::path out;     ///< normal map, .exr or .png
  std::filesystem::path mirror_ball, mirror_ball_mask;  ///< table of the ball's pictures
  std::filesystem::path rig;                            ///< of the camera, where lights are near
  std::string camera;
  std::optional<double>
      depth_mm;      ///< of the surface along the camera's axis, where lights are near
  double gamma = 1;  ///< pictures hold intensity^(1/gamma)
  StereoOptions options;
};
/// Prints one JSON object.
Status stereo_normals(const StereoArgs& args, const Run& run);

/// alhazen-reconstruct compare
struct CompareArgs {
  std::filesystem::path mesh;
  std::filesystem::path reference;         ///< empty where a sphere is the reference
  std::optional<double> sphere_radius_mm;  ///< instead of a reference
  bool as_json = false;
};
Status compare_meshes(const CompareArgs& args, const Run& run);

/// A rig.json, and camera files of other software for what it leaves out.
struct RigArgs {
  std::filesystem::path rig;
  std::vector<std::string> cameras;  ///< as read_cameras() takes them
  double camera_unit_mm = 1;         ///< unit of length of the camera files
};
/// Fails: as Rig::load(), read_cameras() and rig_with_cameras().
Result<Rig> load_rig(const RigArgs& args);

/// alhazen-reconstruct import
struct ImportArgs {
  RigArgs rig;
  std::filesystem::path frames;  ///< frames.csv; its pictures lie relative to it
  std::filesystem::path out;     ///< the scan directory
  std::string scan_id, object_id, note;
  std::vector<double> volume_centre_mm{0, 0, 51.2};  ///< three
  double volume_edge_mm = 102.4;
  int level = 8;
  int bits = 0;  ///< significant bits of a pixel, 0: the file's
  bool leaves_out_bad = false;
  DecodeOptions decode;
};
/// Prints one JSON object.
Status import_frames(const ImportArgs& args, const Run& run);

/// alhazen-reconstruct rig
struct ConvertRigArgs {
  RigArgs rig;
  std::filesystem::path out;  ///< NAME.json, else a folder for COLMAP's text files
};
Status convert_rig(const ConvertRigArgs& args, const Run& run);

/// alhazen-reconstruct export
struct ExportArgs {
  std::filesystem::path scan;
  std::filesystem::path out;                ///< empty: SCAN/export
  std::vector<std::string> formats{"obj"};  ///< of the mesh
};
Status export_scan(const ExportArgs& args, const Run& run);

}  // namespace alhazen
