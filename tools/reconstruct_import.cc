#include "reconstruct/exchange/import.h"

#include <array>
#include <cstdio>
#include <ctime>
#include <nlohmann/json.hpp>

#include "reconstruct/exchange/camera_files.h"
#include "reconstruct/scan/safe_file.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {
namespace {

constexpr std::uint64_t kMaxRigBytes = 16U << 20U;

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text.data();
}

}  // namespace

Result<Rig> load_rig(const RigArgs& args) {
  if (!(args.camera_unit_mm > 0)) {
    return Error{Code::invalid, "--camera-unit-mm is " + std::to_string(args.camera_unit_mm) +
                                    "; it must be above 0"};
  }
  std::vector<ForeignCamera> cameras;
  for (const std::string& source : args.cameras) {
    for (ForeignCamera& camera : ALHAZEN_TRY(read_cameras(source, args.camera_unit_mm)))
      cameras.push_back(std::move(camera));
  }
  const std::string text = ALHAZEN_TRY(read_file(args.rig, kMaxRigBytes));
  return rig_with_cameras(text, cameras).in(args.rig.string());
}

Status import_frames(const ImportArgs& args, const Run& run) {
  const Rig rig = ALHAZEN_TRY(load_rig(args.rig));
  ImportOptions options;
  options.scan_id = args.scan_id;
  options.object_id = args.object_id;
  options.note = args.note;
  options.created_at = utc_now();
  options.software_version = ALHAZEN_VERSION;
  options.volume.centre_mm = {args.volume_centre_mm[0], args.volume_centre_mm[1],
                              args.volume_centre_mm[2]};
  options.volume.edge_mm = args.volume_edge_mm;
  options.level = args.level;
  options.leaves_out_bad = args.leaves_out_bad;
  const Imported imported =
      ALHAZEN_TRY(import_scan(rig, args.frames, args.out,
                              {args.frames.parent_path(), args.bits, args.decode}, options, run));
  for (const std::string& warning : imported.warnings)
    std::fprintf(stderr, "warning: %s\n", warning.c_str());
  const nlohmann::ordered_json line = {{"scan", args.out.string()},
                                       {"light_maps", imported.light_maps},
                                       {"decoded", imported.decoded},
                                       {"warnings", imported.warnings}};
  std::printf("%s\n", line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace).c_str());
  return {};
}

}  // namespace alhazen
