#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "reconstruct/report/report.h"
#include "reconstruct/scan/scan.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {
namespace {

constexpr std::array<const char*, 6> kLabels{"none",  "mirror",    "direct_sight",
                                             "mixed", "saturated", "second_bounce"};

/// What the pixels of all light maps of one camera and display saw.
struct LabelCounts {
  std::uint64_t maps = 0, pixels = 0;
  std::array<std::uint64_t, kLabels.size()> label{};
};
using CountsByPair = std::map<std::pair<std::string, std::string>, LabelCounts>;

std::vector<StackKey> missing_of(const Manifest& manifest, const std::vector<StackKey>& present) {
  std::vector<StackKey> missing;
  for (const Stop& stop : manifest.stops) {
    for (const PlannedDisplay& display : manifest.displays) {
      for (const PlannedCamera& camera : manifest.cameras) {
        StackKey key{stop.index, display.name, camera.name};
        if (std::find(present.begin(), present.end(), key) == present.end())
          missing.push_back(std::move(key));
      }
    }
  }
  return missing;
}

Result<CountsByPair> count_labels(const Scan& scan, const std::vector<StackKey>& keys,
                                  const Run& run) {
  CountsByPair counts;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (run.stopped()) return Error{Code::cancelled, "interrupted"};
    run.tell("light maps", static_cast<double>(i) / static_cast<double>(keys.size()));
    const LightMap map = ALHAZEN_TRY(scan.load_light_map(keys[i]));
    LabelCounts& sum = counts[{keys[i].camera, keys[i].display}];
    ++sum.maps;
    sum.pixels += map.size_px();
    for (const Label label : map.label) ++sum.label[static_cast<std::size_t>(label)];
  }
  return counts;
}

std::string name_of(const StackKey& key) {
  return "stop " + std::to_string(key.stop) + ", display " + key.display + ", camera " + key.camera;
}

void print_json(const Scan& scan, const std::vector<StackKey>& present,
                const std::vector<StackKey>& missing, const CaptureFigures& figures,
                const CountsByPair& counts) {
  nlohmann::ordered_json json{
      {"manifest", nlohmann::ordered_json::parse(scan.manifest().to_json())},
      {"light_maps", present.size()},
      {"missing", nlohmann::ordered_json::array()},
      {"frames", figures.frames},
      {"retakes", figures.retakes},
      {"bytes", figures.bytes},
      {"duration_s", figures.duration_s},
      {"pixels", nlohmann::ordered_json::array()}};
  for (const StackKey& key : missing)
    json["missing"].push_back(
        {{"stop", key.stop}, {"display", key.display}, {"camera", key.camera}});
  for (const auto& [pair, sum] : counts) {
    nlohmann::ordered_json entry{{"camera", pair.first},
                                 {"display", pair.second},
                                 {"light_maps", sum.maps},
                                 {"pixels", sum.pixels}};
    for (std::size_t i = 0; i < kLabels.size(); ++i) entry[kLabels[i]] = sum.label[i];
    json["pixels"].push_back(std::move(entry));
  }
  std::printf("%s\n", json.dump(1).c_str());
}

void print_text(const Scan& scan, const std::vector<StackKey>& present,
                const std::vector<StackKey>& missing, const CaptureFigures& figures,
                const CountsByPair& counts) {
  const Manifest& m = scan.manifest();
  std::printf("scan        %s, %s\n", m.scan_id.c_str(), m.created_at.c_str());
  std::printf("software    %s, rig %s\n", m.software_version.c_str(), m.rig_hash.c_str());
  std::printf("plan        %zu cameras x %zu stops x %zu displays\n", m.cameras.size(),
              m.stops.size(), m.displays.size());
  std::printf("volume      %.2f mm about (%.2f, %.2f, %.2f) mm, level %d: voxels %.3f mm\n",
              m.volume.edge_mm, m.volume.centre_mm.x(), m.volume.centre_mm.y(),
              m.volume.centre_mm.z(), m.level, m.volume.edge_mm / (1 << m.level));
  std::printf("frames      %llu in %.1f s, %llu retakes\n",
              static_cast<unsigned long long>(figures.frames), figures.duration_s,
              static_cast<unsigned long long>(figures.retakes));
  std::printf("directory   %.1f MB\n", static_cast<double>(figures.bytes) * 1e-6);
  std::printf("light maps  %zu safe, %zu missing\n", present.size(), missing.size());
  constexpr std::size_t kShown = 20;  // --json names all
  for (std::size_t i = 0; i < std::min(missing.size(), kShown); ++i)
    std::printf("  missing   %s\n", name_of(missing[i]).c_str());
  if (missing.size() > kShown) std::printf("  and %zu more\n", missing.size() - kShown);
  if (counts.empty()) return;
  std::printf("\n%-14s %-14s %6s", "camera", "display", "maps");
  for (const char* label : kLabels) std::printf(" %13s", label);
  std::printf("\n");
  for (const auto& [pair, sum] : counts) {
    std::printf("%-14s %-14s %6llu", pair.first.c_str(), pair.second.c_str(),
                static_cast<unsigned long long>(sum.maps));
    for (const std::uint64_t count : sum.label)
      std::printf(" %11.2f %%", sum.pixels > 0 ? 100 * static_cast<double>(count) /
                                                     static_cast<double>(sum.pixels)
                                               : 0.0);
    std::printf("\n");
  }
}

}  // namespace

Status show_scan(const InfoArgs& args, const Run& run) {
  const Scan scan = ALHAZEN_TRY(Scan::open(args.scan).in(args.scan.string()));
  const std::vector<StackKey> present = ALHAZEN_TRY(scan.light_maps());
  const CaptureFigures figures = ALHAZEN_TRY(capture_figures(scan));
  const std::vector<StackKey> missing = missing_of(scan.manifest(), present);
  CountsByPair counts;
  if (args.has_maps) counts = ALHAZEN_TRY(count_labels(scan, present, run));
  (args.as_json ? print_json : print_text)(scan, present, missing, figures, counts);
  return {};
}

}  // namespace alhazen
