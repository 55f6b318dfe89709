// Offline: runs the stages of a reconstruction on a scan directory, examines and compares.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "daemon/base/exit_code.h"
#include "reconstruct/run.h"
#include "reconstruct/vote/octree.h"
#include "tools/reconstruct_commands.h"

namespace {

using alhazen::Run;
using alhazen::Status;

/// Turns SIGINT and SIGTERM into a request to stop. REQUIRES: made before any other thread, so that
/// all inherit the blocked signals.
class Interrupt {
 public:
  Interrupt() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGINT);
    sigaddset(&signals_, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    watch_ = std::jthread([this](const std::stop_token& done) {
      const timespec wait{.tv_sec = 0, .tv_nsec = 100'000'000};
      while (!done.stop_requested()) {
        if (sigtimedwait(&signals_, nullptr, &wait) > 0) stop_.request_stop();
      }
    });
  }
  [[nodiscard]] std::stop_token token() const { return stop_.get_token(); }

 private:
  sigset_t signals_{};
  std::stop_source stop_;
  std::jthread watch_;  // last: ends before the others go
};

/// Prints "stage  42 %" to standard error: in place on a terminal, else one line a tenth.
class Progress {
 public:
  void tell(std::string_view stage, double share) {
    const int percent = static_cast<int>(std::clamp(share, 0.0, 1.0) * 100);
    const std::lock_guard lock(mutex_);
    const int step = is_terminal_ ? 1 : 10;
    if (stage == stage_ && percent / step <= percent_ / step) return;
    if (is_terminal_ && !stage_.empty() && stage != stage_) std::fputc('\n', stderr);
    stage_ = stage;
    percent_ = percent;
    std::fprintf(stderr, is_terminal_ ? "\r%-24s %3d %%" : "%-24s %3d %%\n", stage_.c_str(),
                 percent_);
  }
  void end() {
    const std::lock_guard lock(mutex_);
    if (is_terminal_ && !stage_.empty()) std::fputc('\n', stderr);
  }

 private:
  std::mutex mutex_;
  const bool is_terminal_ = isatty(STDERR_FILENO) == 1;
  std::string stage_;
  int percent_ = -1;
};

}  // namespace

int main(int argc, char** argv) {
  const Interrupt interrupt;
  Progress progress;
  CLI::App app{
      "alhazen-reconstruct: from a scan directory to a mesh, stage by stage.\n"
      "Exit codes: 0 done, 64 wrong request, 69 not available, 70 our bug, 74 no space,\n"
      "75 damaged or wrong moment, 130 interrupted."};
  app.require_subcommand(1);
  app.fallthrough();  // --quiet may stand behind the sub-command, too
  app.set_help_all_flag("--help-all", "help of every sub-command");
  bool is_quiet = false;
  app.add_flag("--quiet", is_quiet, "no progress");
  std::function<Status(const Run&)> work;

  alhazen::InfoArgs info;
  auto* info_command =
      app.add_subcommand("info", "what a scan directory holds and what is missing");
  info_command->add_option("SCAN", info.scan, "scan directory")->required();
  info_command->add_flag("--maps", info.has_maps, "load every light map: what its pixels saw");
  info_command->add_flag("--json", info.as_json, "one JSON object");
  info_command->callback([&] { work = [&](const Run& r) { return show_scan(info, r); }; });

  alhazen::RunArgs whole;
  auto* run_command =
      app.add_subcommand("run", "reconstruct a scan directory: mesh.ply, report.json, report.html");
  run_command->add_option("SCAN", whole.scan, "scan directory")->required();
  run_command
      ->add_option("--level", whole.level,
                   "finest octree level instead of the scan's: leaves of edge / 2^level")
      ->check(CLI::Range(1, alhazen::Octree::kMaxLevel));
  run_command->add_option("--reference", whole.reference, "the true surface: errors in the report");
  run_command->add_option("--out", whole.out, "folder for the results; the scan directory if none");
  run_command->add_flag("--field", whole.has_field,
                        "also field.vtu: normals, consistency and cut of every leaf, for ParaView");
  run_command->add_flag("--refine", whole.is_refined,
                        "refine the calibration from the scan's own reflections first: "
                        "rig_refined.json");
  run_command->callback([&] { work = [&](const Run& r) { return run_reconstruction(whole, r); }; });

  alhazen::ReportArgs report;
  auto* report_command = app.add_subcommand(
      "report", "write the report again from a scan directory's mesh.ply and report.json");
  report_command->add_option("SCAN", report.scan, "folder with mesh.ply and report.json")
      ->required();
  report_command->add_option("--reference", report.reference,
                             "the true surface: errors in the report");
  report_command->add_option("--out", report.out, "folder for the report; SCAN if none");
  report_command->callback([&] { work = [&](const Run& r) { return report_again(report, r); }; });

  alhazen::DecodeArgs decode;
  auto* decode_command = app.add_subcommand(
      "decode",
      "pictures of Gray code, as listed in a table, to light maps.\n"
      "Columns of the table, named in its first line: file camera display stop angle_deg\n"
      "exposure_us kind [gray, white, black] axis [u, v, -] bit [significance, 0 = finest] "
      "inverted.\n"
      "Prints one JSON object a light map.");
  decode_command->add_option("--frames", decode.frames, "the table; files are relative to it")
      ->required();
  decode_command->add_option("--out", decode.out, "folder for STOP_DISPLAY_CAMERA.exr")
      ->default_val("light_maps");
  decode_command->add_option("--rig", decode.rig, "rig.json: checks names and sizes");
  decode_command->add_option(
      "--display-size", decode.display_sizes,
      "NAME=WxH, for displays not in the rig; else as many as the bits tell apart");
  decode_command->add_option("--bits", decode.bits,
                             "significant bits of a pixel, 8 to 16; 0: all that the file has");
  decode_command
      ->add_option("--min-contrast", decode.options.min_contrast,
                   "smallest white - black, share of full scale")
      ->capture_default_str();
  decode_command
      ->add_option("--min-modulation", decode.options.min_modulation,
                   "smallest |pattern - inverse|, share of white - black")
      ->capture_default_str();
  decode_command
      ->add_option("--noise", decode.options.noise,
                   "deviation of |pattern - inverse| by noise, share of full scale")
      ->capture_default_str();
  decode_command
      ->add_option("--max-bit", decode.options.max_bit, "coarsest bit that is still a position")
      ->capture_default_str();
  decode_command->callback([&] { work = [&](const Run& r) { return decode_frames(decode, r); }; });

  const auto add_rig_options = [](CLI::App* command, alhazen::RigArgs& rig) {
    command->add_option("--rig", rig.rig, "rig.json")->required();
    command
        ->add_option(
            "--cameras", rig.cameras,
            "camera file for what rig.json leaves out of its cameras; may be given several times:\n"
            "[NAME=]FILE[#SUFFIX] of OpenCV (YAML, XML, JSON), or a folder with COLMAP's "
            "cameras.txt\n"
            "and images.txt, whose world is the rig frame")
        ->allow_extra_args(false);
    command
        ->add_option("--camera-unit-mm", rig.camera_unit_mm,
                     "unit of length of the camera files: 1000 where they are in metres")
        ->capture_default_str();
  };
  alhazen::ImportArgs import_args;
  auto* import_command = app.add_subcommand(
      "import",
      "a whole scan directory of pictures that other software took, as listed in a table\n"
      "(see decode); then: alhazen-reconstruct run SCAN. An import that was interrupted is\n"
      "gone on with. Prints one JSON object.");
  add_rig_options(import_command, import_args.rig);
  import_command->add_option("--frames", import_args.frames, "the table; files are relative to it")
      ->required();
  import_command->add_option("--out", import_args.out, "the scan directory")->required();
  import_command->add_option("--scan-id", import_args.scan_id,
                             "a-z 0-9 -; the directory's name if none");
  import_command->add_option("--object", import_args.object_id, "what was scanned");
  import_command->add_option("--note", import_args.note, "for the report");
  import_command
      ->add_option("--volume-centre-mm", import_args.volume_centre_mm,
                   "x y z of the middle of the cube that is reconstructed, object frame")
      ->expected(3)
      ->capture_default_str();
  import_command->add_option("--volume-edge-mm", import_args.volume_edge_mm, "its edge")
      ->capture_default_str();
  import_command
      ->add_option("--level", import_args.level, "finest octree level: leaves of edge / 2^level")
      ->check(CLI::Range(1, alhazen::Octree::kMaxLevel))
      ->capture_default_str();
  import_command->add_option("--bits", import_args.bits,
                             "significant bits of a pixel, 8 to 16; 0: all that the file has");
  import_command->add_flag("--leave-out-bad", import_args.leaves_out_bad,
                           "go on without what cannot be decoded, and name it");
  import_command
      ->add_option("--min-contrast", import_args.decode.min_contrast,
                   "smallest white - black, share of full scale")
      ->capture_default_str();
  import_command->callback(
      [&] { work = [&](const Run& r) { return import_frames(import_args, r); }; });

  alhazen::ConvertRigArgs convert;
  auto* rig_command = app.add_subcommand(
      "rig", "check a rig.json, put camera files into it, write it as JSON or as COLMAP text");
  add_rig_options(rig_command, convert.rig);
  rig_command->add_option("--out", convert.out, "NAME.json, else a folder for COLMAP's files")
      ->required();
  rig_command->callback([&] { work = [&](const Run& r) { return convert_rig(convert, r); }; });

  alhazen::ExportArgs exported;
  auto* export_command = app.add_subcommand(
      "export", "for other software: the mesh as OBJ, every view as COLMAP text");
  export_command->add_option("SCAN", exported.scan, "scan directory")->required();
  export_command->add_option("--out", exported.out, "folder; SCAN/export if none");
  export_command->add_option("--format", exported.formats, "obj, stl or ply; may be given twice")
      ->check(CLI::IsMember({"obj", "stl", "ply"}))
      ->allow_extra_args(false)
      ->capture_default_str();
  export_command->callback([&] { work = [&](const Run& r) { return export_scan(exported, r); }; });

  alhazen::NormalsArgs normals;
  auto* normals_command = app.add_subcommand(
      "normals",
      "normal maps of calibrated views, as listed in a table, to mesh.ply, report.json,\n"
      "report.html. Columns of the table, named in its first line: file [PNG or EXR] camera\n"
      "[stop angle_deg axes (camera, opengl, rig) mask noise_deg].");
  normals_command->add_option("VIEWS", normals.views, "the table; files are relative to it")
      ->required();
  normals_command->add_option("--rig", normals.rig, "rig.json: the cameras")->required();
  normals_command->add_option("--out", normals.out, "folder for the results")->required();
  normals_command->add_option("--reference", normals.reference,
                              "the true surface: errors in the report");
  normals_command
      ->add_option("--volume-centre-mm", normals.centre_mm, "of the volume, object frame: x y z")
      ->expected(3);
  normals_command->add_option("--volume-edge-mm", normals.edge_mm, "of the volume, a cube");
  normals_command->add_option("--level", normals.level, "finest octree level")
      ->check(CLI::Range(4, alhazen::Octree::kMaxLevel))
      ->capture_default_str();
  normals_command->callback(
      [&] { work = [&](const Run& r) { return reconstruct_normals(normals, r); }; });

  alhazen::StereoArgs stereo;
  auto* stereo_command = app.add_subcommand(
      "stereo",
      "photometric stereo: pictures of one view, each under one light, to a normal map.\n"
      "Columns of the table, named in its first line: file x y z [kind (far: a direction to the\n"
      "light; near: its position, mm) axes (camera, opengl) intensity]. Prints one JSON object.");
  stereo_command->add_option("LIGHTS", stereo.lights, "the table; pictures are relative to it")
      ->required();
  stereo_command->add_option("--out", stereo.out, "the normal map, .exr or .png")->required();
  stereo_command->add_option("--mask", stereo.mask, "white on the object; all of it if none");
  auto* ball = stereo_command->add_option(
      "--mirror-ball", stereo.mirror_ball,
      "table of pictures of a mirror ball under the same lights in the same order: their\n"
      "directions come from its highlights instead of the columns x y z");
  stereo_command->add_option("--mirror-ball-mask", stereo.mirror_ball_mask, "white on the ball")
      ->needs(ball);
  stereo_command->add_option("--rig", stereo.rig, "rig.json, where lights are near");
  stereo_command->add_option("--camera", stereo.camera, "its name in the rig");
  stereo_command->add_option("--depth-mm", stereo.depth_mm,
                             "distance of the surface along the camera's axis, where lights are "
                             "near");
  stereo_command->add_option("--gamma", stereo.gamma, "pictures hold intensity^(1/gamma)")
      ->check(CLI::Range(0.2, 5.0))
      ->capture_default_str();
  stereo_command
      ->add_option("--rounds", stereo.options.rounds,
                   "of Tukey's reweighting; 0: plain least squares")
      ->capture_default_str();
  stereo_command
      ->add_option("--dark", stereo.options.dark_share,
                   "share of a pixel's brightest below which it is in shadow")
      ->capture_default_str();
  stereo_command
      ->add_option("--bright", stereo.options.bright_share, "share of its lights left out as gloss")
      ->capture_default_str();
  stereo_command->callback([&] { work = [&](const Run& r) { return stereo_normals(stereo, r); }; });

  alhazen::CompareArgs compare;
  auto* compare_command =
      app.add_subcommand("compare", "measure a mesh against the truth (no alignment)");
  compare_command->add_option("MESH", compare.mesh, "PLY, OBJ, OFF or STL, mm")->required();
  auto* reference =
      compare_command->add_option("REFERENCE", compare.reference, "the true surface, mm");
  compare_command
      ->add_option("--sphere-radius-mm", compare.sphere_radius_mm,
                   "instead of a reference: a sphere of this radius, its centre fitted")
      ->excludes(reference);
  compare_command->add_flag("--json", compare.as_json, "one JSON object");
  compare_command->callback(
      [&] { work = [&](const Run& r) { return compare_meshes(compare, r); }; });

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : alhazen::exit_code(alhazen::Code::invalid);
  }

  Run run;
  run.stop = interrupt.token();
  if (!is_quiet)
    run.progress = [&](std::string_view stage, double share) { progress.tell(stage, share); };
  const Status status = work(run);
  progress.end();
  if (status) return 0;
  std::fprintf(stderr, "alhazen-reconstruct: %s\n", status.error().text().c_str());
  return alhazen::exit_code(status.error().code);
}
