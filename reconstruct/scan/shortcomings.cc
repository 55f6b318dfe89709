#include "reconstruct/scan/shortcomings.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>
#include <set>

namespace alhazen {
namespace {

/// Turntables repeat to a few arc seconds; stops nearer than this are one and the same.
constexpr double kSameAngle_rad = 1e-4;
/// So many light maps are named one by one.
constexpr std::size_t kNamed = 5;

std::string degrees(double rad) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3f", rad * 180 / std::numbers::pi);
  return text;
}

std::string joined(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

/// Names of `all` of which nothing is present.
template <class Name>
std::vector<std::string> absent(const std::vector<Name>& all, const std::set<Name>& present) {
  std::vector<std::string> out;
  for (const Name& name : all) {
    if (present.contains(name)) continue;
    if constexpr (std::is_same_v<Name, int>) {
      out.push_back(std::to_string(name));
    } else {
      out.push_back(name);
    }
  }
  return out;
}

void missing(const Manifest& manifest, std::span<const StackKey> present,
             std::vector<std::string>& out) {
  const std::size_t planned =
      manifest.stops.size() * manifest.displays.size() * manifest.cameras.size();
  if (present.size() >= planned) return;
  std::string line = std::to_string(planned - present.size()) + " of " + std::to_string(planned) +
                     " light maps are missing";
  std::vector<int> stops;
  std::vector<std::string> displays, cameras;
  for (const Stop& stop : manifest.stops) stops.push_back(stop.index);
  for (const PlannedDisplay& display : manifest.displays) displays.push_back(display.name);
  for (const PlannedCamera& camera : manifest.cameras) cameras.push_back(camera.name);
  std::set<StackKey> there(present.begin(), present.end());
  std::set<int> stops_there;
  std::set<std::string> displays_there, cameras_there;
  for (const StackKey& key : present) {
    stops_there.insert(key.stop);
    displays_there.insert(key.display);
    cameras_there.insert(key.camera);
  }
  std::vector<std::string> parts;
  const auto all_of = [&](const char* what, const std::vector<std::string>& names) {
    if (!names.empty()) parts.push_back("all of " + (what + (" " + joined(names))));
  };
  all_of("stop", absent(stops, stops_there));
  all_of("display", absent(displays, displays_there));
  all_of("camera", absent(cameras, cameras_there));
  std::size_t others = 0;
  for (const int stop : stops_there) {
    for (const std::string& display : displays_there) {
      for (const std::string& camera : cameras_there) {
        if (there.contains({stop, display, camera})) continue;
        if (++others > kNamed) continue;
        parts.push_back("stop " + std::to_string(stop) + " display " + display + " camera " +
                        camera);
      }
    }
  }
  if (others > kNamed) parts.push_back(std::to_string(others - kNamed) + " more");
  out.push_back(line + ": " + joined(parts));
}

void repeated(const Manifest& manifest, std::vector<std::string>& out) {
  constexpr double kTurn = 2 * std::numbers::pi;
  std::vector<Stop> stops = manifest.stops;
  const auto within_turn = [](const Stop& stop) {
    const double rest = std::fmod(stop.wanted_rad, kTurn);
    return rest < 0 ? rest + kTurn : rest;
  };
  std::ranges::sort(stops, {}, within_turn);
  for (std::size_t i = 0; i < stops.size() && stops.size() > 1; ++i) {
    const Stop& a = stops[i];
    const Stop& b = stops[(i + 1) % stops.size()];
    const double apart = within_turn(b) - within_turn(a) + (i + 1 == stops.size() ? kTurn : 0);
    if (apart > kSameAngle_rad) continue;
    const auto [first, second] = std::minmax(a.index, b.index);
    out.push_back("stops " + std::to_string(first) + " and " + std::to_string(second) +
                  " are at the same angle, " + degrees(within_turn(a)) +
                  " deg: what they see counts twice");
    if (out.size() > 2 * kNamed) return;
  }
}

}  // namespace

std::vector<std::string> shortcomings(const Scan& scan, std::span<const StackKey> present) {
  std::vector<std::string> out;
  const Manifest& manifest = scan.manifest();
  if (const std::string hash = scan.rig().hash(); hash != manifest.rig_hash) {
    out.push_back("rig.json is not the one the scan was planned with: its hash is " + hash +
                  ", the manifest says " + manifest.rig_hash);
  }
  missing(manifest, present, out);
  repeated(manifest, out);
  return out;
}

}  // namespace alhazen
