#include "reconstruct/diagnose.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <numeric>
#include <optional>
#include <utility>

#include "reconstruct/vote/gather.h"
#include "reconstruct/vote/octree.h"
#include "reconstruct/vote/voter.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;

/// Points of the surface that are looked at: shares are known to 2 % then.
constexpr std::size_t kPoints = 600;
/// A hypothesis agrees within this of the surface's normal; looks from nearer to grazing, where
/// parts that stand before the point hide it first, do not count.
constexpr double kAgreeRad = 0.05, kMinCosine = 0.25;
/// A device does not belong to the rest where so little of its hypotheses agree, as a share of what
/// the best of its kind reaches, even if kDoubt more did; of fewer than kFewestVotes nothing is
/// said. A camera of which so few hypotheses meet the surface at all, as a share of the middle one,
/// is asked whether its picture is turned.
constexpr double kLostShare = 0.25, kSilentShare = 0.03;
constexpr std::size_t kFewestVotes = 20, kDoubt = 3;
/// Stops do not go wrong by themselves: more of them than this share, and it is the whole rig.
constexpr double kLostStops = 0.25;
/// It does belong where so much does; of so many at least, and for an exchange so many each.
constexpr double kMendedShare = 0.4;
constexpr std::size_t kFewestMended = 8, kFewestEach = 3;
/// Less of the mesh measured, or less agreement even of the best device, says that no surface was
/// found.
constexpr double kMeasuredShare = 0.05, kBestShare = 0.3;

/// Fewer light maps than this agree nowhere by more than chance, whatever the rig.
constexpr std::size_t kFewestMaps = 6;

/// The coarse vote: every leaf of kCoarse, then the best kKept leaves twice finer.
constexpr int kCoarse = 5, kFine = 7;
constexpr std::size_t kKept = 400, kJudged = 200;
/// Another rig is named where its votes agree so much better.
constexpr double kBetterFactor = 1.5, kBetterBy = 0.08;
/// Pairs of cameras are tried up to this many cameras; each takes a coarse vote.
constexpr std::size_t kMostPaired = 16;

// Rigs that may be meant --------------------------------------------------------------------------

struct Assumption {
  std::string what;  ///< "displays 'a' and 'b' are exchanged"
  Rig rig;
};

/// The camera if its pictures were mirrored, left to right or upside down, after it was calibrated.
/// Its frame then is left-handed, which projection does not mind.
void flip_picture(CameraModel& camera, bool columns) {
  const int axis = columns ? 0 : 1;
  camera.camera_from_rig.rotation.row(axis) *= -1;
  camera.camera_from_rig.translation_mm[axis] *= -1;
  if (columns) {
    camera.cx_px = camera.width_px - 1 - camera.cx_px;
    camera.distortion[3] *= -1;  // p2
  } else {
    camera.cy_px = camera.height_px - 1 - camera.cy_px;
    camera.distortion[2] *= -1;  // p1
  }
}

/// The display if its columns or rows ran the other way.
void flip_display(DisplayModel& display, bool columns) {
  Vector3d& step = columns ? display.u_mm : display.v_mm;
  display.origin_mm += step * ((columns ? display.width_px : display.height_px) - 1);
  step = -step;
}

std::string in_quotes(const std::string& name) { return "'" + name + "'"; }

/// Every way to turn pictures or displays over.
struct Flip {
  const char* what;
  bool columns, rows;
};
constexpr std::array<Flip, 3> kFlips = {{{"mirrored left to right", true, false},
                                         {"mirrored upside down", false, true},
                                         {"turned by half a turn", true, true}}};

template <class Device, class FlipOne>
void flip(Device& device, const Flip& how, const FlipOne& flip_one) {
  if (how.columns) flip_one(device, true);
  if (how.rows) flip_one(device, false);
}

template <class Device>
Assumption exchanged(Rig rig, const char* kind, std::vector<Device> Rig::*devices, std::size_t a,
                     std::size_t b) {
  std::vector<Device>& list = rig.*devices;
  const auto [first, second] = std::minmax(list[a].name, list[b].name);
  std::string what =
      std::string(kind) + " " + in_quotes(first) + " and " + in_quotes(second) + " are exchanged";
  std::swap(list[a].name, list[b].name);
  return {std::move(what), std::move(rig)};
}

/// Display `which`, or all of them where there is none.
Assumption with_display(Rig rig, std::optional<std::size_t> which, const Flip& how) {
  std::string what = which ? "display " + in_quotes(rig.displays[*which].name) + " is "
                           : std::string("every display is ");
  for (std::size_t i = 0; i < rig.displays.size(); ++i) {
    if (!which || *which == i) flip(rig.displays[i], how, flip_display);
  }
  return {what + how.what, std::move(rig)};
}

Assumption with_camera(Rig rig, std::size_t which, const Flip& how) {
  flip(rig.cameras[which], how, flip_picture);
  std::string what =
      "the picture of camera " + in_quotes(rig.cameras[which].name) + " is " + how.what;
  return {std::move(what), std::move(rig)};
}

/// The rig's mirror image in a plane that holds the turntable's axis and, if it can, `centre_mm`,
/// so that the volume stays where it is. Cameras see the mirror image of what they saw.
Rig mirror_image(Rig rig, const Vector3d& centre_mm) {
  const Vector3d axis = rig.turntable.direction, p = rig.turntable.point_mm;
  Vector3d normal = axis.cross(centre_mm - p);
  if (normal.norm() < 1e-6) normal = axis.unitOrthogonal();
  normal.normalize();
  const Eigen::Matrix3d over = Eigen::Matrix3d::Identity() - 2 * normal * normal.transpose();
  const Vector3d shift = 2 * normal.dot(p) * normal;
  for (DisplayModel& display : rig.displays) {
    display.origin_mm = over * display.origin_mm + shift;
    display.u_mm = over * display.u_mm;
    display.v_mm = over * display.v_mm;
  }
  for (CameraModel& camera : rig.cameras) {
    camera.camera_from_rig = camera.camera_from_rig * Pose{over, shift};
    flip_picture(camera, true);
  }
  return rig;
}

/// Rigs that differ from `rig` as a whole.
std::vector<Assumption> whole_rigs(const Rig& rig, const Vector3d& centre_mm) {
  std::vector<Assumption> out;
  Rig backwards = rig;
  backwards.turntable.direction *= -1;
  Rig flipped = rig, upside_down = rig;
  for (CameraModel& camera : flipped.cameras) flip_picture(camera, true);
  for (CameraModel& camera : upside_down.cameras) {
    flip_picture(camera, true);
    flip_picture(camera, false);
  }
  // What turns right-handed turns left-handed in a mirror.
  out.push_back({"the rig is mirrored", mirror_image(backwards, centre_mm)});
  out.push_back(
      {"the rig is mirrored in all but its turntable's direction", mirror_image(rig, centre_mm)});
  out.push_back({"the turntable turns the other way", std::move(backwards)});
  out.push_back({"every camera's picture is mirrored left to right", std::move(flipped)});
  out.push_back({"every camera's picture is turned by half a turn", std::move(upside_down)});
  const std::size_t displays = rig.displays.size();
  for (const Flip& how : kFlips) {
    if (displays > 1) out.push_back(with_display(rig, std::nullopt, how));
    for (std::size_t i = 0; i < displays; ++i) out.push_back(with_display(rig, i, how));
  }
  for (std::size_t a = 0; a < displays; ++a) {
    for (std::size_t b = a + 1; b < displays; ++b)
      out.push_back(exchanged(rig, "displays", &Rig::displays, a, b));
  }
  if (rig.cameras.size() <= kMostPaired) {
    for (std::size_t a = 0; a < rig.cameras.size(); ++a) {
      for (std::size_t b = a + 1; b < rig.cameras.size(); ++b)
        out.push_back(exchanged(rig, "cameras", &Rig::cameras, a, b));
    }
  }
  return out;
}

/// Puts a rig into observations for as long as this lives.
class Assuming {
 public:
  Assuming(Observations& observations, const Rig& rig)
      : observations_(observations), real_(observations.rig()) {
    fits_ = static_cast<bool>(observations_.assume(rig));
  }
  Assuming(const Assuming&) = delete;
  Assuming& operator=(const Assuming&) = delete;
  ~Assuming() {
    const Status back = observations_.assume(std::move(real_));
    ALHAZEN_CHECK(static_cast<bool>(back));
  }
  /// Whether the light maps could be of that rig at all.
  [[nodiscard]] bool fits() const noexcept { return fits_; }

 private:
  Observations& observations_;
  Rig real_;
  bool fits_ = false;
};

// Nothing seen ------------------------------------------------------------------------------------

template <class KeyOf>
void name_blind(const Observations& observations, const char* kind, const KeyOf& key_of,
                std::vector<std::string>& out) {
  std::map<std::string, std::pair<std::size_t, bool>> seen;  // light maps; whether one holds any
  for (const Observation& o : observations.all()) {
    auto& [maps, has_any] = seen[key_of(o.key)];
    ++maps;
    has_any = has_any || !o.cells.empty() || !o.sight.px.empty();
  }
  for (const auto& [name, entry] : seen) {
    if (entry.second) continue;
    out.push_back(std::string("none of the ") + std::to_string(entry.first) + " light maps of " +
                  kind + " " + name + " holds a position");
  }
}

/// Displays of which no light map can vote, for their lit side looks away from the volume.
std::vector<std::string> turned_away(const Observations& observations, const Volume& volume) {
  std::map<std::string, bool> is_away;
  for (const Observation& o : observations.all()) {
    const bool is_before = (o.origin_object_mm - volume.centre_mm).dot(o.inward_object) > 0;
    bool& away = is_away.try_emplace(o.key.display, true).first->second;
    away = away && !is_before;
  }
  std::vector<std::string> out;
  for (const auto& [name, away] : is_away) {
    if (away) out.push_back(name);
  }
  return out;
}

// Agreement on the surface ------------------------------------------------------------------------

/// Hypotheses on the surface, and how many of them agree with it.
struct Share {
  std::size_t votes = 0, agreeing = 0;
  [[nodiscard]] double share() const {
    return votes == 0 ? 0 : static_cast<double>(agreeing) / static_cast<double>(votes);
  }
};

enum class Kind : std::uint8_t { display, camera, stop };
constexpr std::array<Kind, 3> kKinds = {Kind::display, Kind::camera, Kind::stop};
constexpr std::array<const char*, 3> kKindNames = {"display", "camera", "stop"};

/// A camera, display or stop by its name.
using Device = std::pair<Kind, std::string>;

std::string name_in(const StackKey& key, Kind kind) {
  return kind == Kind::display  ? key.display
         : kind == Kind::camera ? key.camera
                                : std::to_string(key.stop);
}

struct MeasuredPoint {
  Vector3d p_mm;
  Eigen::Vector3f normal;
};

std::vector<MeasuredPoint> measured_points(const Mesh& mesh) {
  std::vector<std::size_t> measured;
  for (std::size_t i = 0; i < mesh.observed.size(); ++i) {
    if (mesh.observed[i] != 0) measured.push_back(i);
  }
  std::vector<MeasuredPoint> out;
  const std::size_t count = std::min(kPoints, measured.size());
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = measured[k * measured.size() / count];
    out.push_back({mesh.vertices_mm[i], mesh.normals[i]});
  }
  return out;
}

/// Of each observation, in their order.
std::vector<Share> shares_of(const Observations& observations, const VoteOptions& options,
                             const std::vector<MeasuredPoint>& points) {
  std::vector<Vector3d> eyes(observations.size());
  for (const View& view : observations.views()) {
    for (std::size_t i = view.begin; i < view.end; ++i) eyes[i] = view.eye_object_mm;
  }
  std::vector<Share> shares(observations.size());
  Gatherer gatherer(observations, options);
  PointBlock block;
  BlockVotes votes;
  for (const MeasuredPoint& point : points) {
    block.reset(point.p_mm, 0);
    block.add(point.p_mm, 0);
    gatherer.gather(block, votes);
    for (std::size_t k = votes.begin[0]; k < votes.begin[0] + votes.count[0]; ++k) {
      const std::size_t i = votes.observation[k];
      if (i >= shares.size()) continue;  // a normal map's
      const Vector3d sight = (eyes[i] - point.p_mm).normalized();
      if (sight.dot(point.normal.cast<double>()) < kMinCosine) continue;
      const Eigen::Vector3f n(votes.x[k], votes.y[k], votes.z[k]);
      ++shares[i].votes;
      shares[i].agreeing += (n - point.normal).norm() <= kAgreeRad ? 1U : 0U;
    }
  }
  return shares;
}

std::string percent(double share) {
  char text[16];
  std::snprintf(text, sizeof text, "%.0f %%", 100 * share);
  return text;
}

template <class Model>
std::size_t index_of(const std::vector<Model>& devices, const std::string& name) {
  return static_cast<std::size_t>(std::ranges::find(devices, name, &Model::name) - devices.begin());
}

/// Holds the devices against a surface, and looks for what would mend those that do not belong.
class Judge {
 public:
  Judge(Observations& observations, const VoteOptions& options, std::vector<MeasuredPoint> points)
      : observations_(observations),
        options_(options),
        points_(std::move(points)),
        shares_(shares_of(observations, options, points_)) {}

  /// The share that the best device of a kind reaches.
  [[nodiscard]] double best(Kind kind) const { return best_of(sums(shares_, kind, {})); }

  /// One sentence a fault. `away`: displays that look away from the volume.
  Result<std::vector<std::string>> faults(const std::vector<std::string>& away, const Run& run) {
    for (const std::string& name : away) lost_.emplace_back(Kind::display, name);
    // One after the other, the one of most hypotheses that disagree first: what disagrees only
    // because of another device does not any more when that one is left out.
    while (const auto device = worst()) lost_.push_back(*device);
    std::vector<std::string> out, misfits;
    bool is_cause_known = false;
    std::vector<Device> open = lost_;
    for (const Device& camera : silent_cameras()) open.push_back(camera);
    while (!open.empty()) {
      if (run.stopped()) return Error{Code::cancelled, "the diagnosis was stopped"};
      const Device device = open.front();
      open.erase(open.begin());
      if (device.first == Kind::stop) {
        out.push_back("stop " + device.second + figures(device) +
                      ": was its angle recorded right, did the object move?");
        continue;
      }
      const auto cause = cause_of(device);
      if (cause) {
        std::erase_if(open, [&](const Device& other) {
          return other.first == device.first &&
                 std::ranges::find(cause->devices, other.second) != cause->devices.end();
        });
        is_cause_known = true;
        out.push_back(cause->what + ", by what agrees with the surface: check rig and cables");
      } else if (device.first == Kind::display &&
                 std::ranges::find(away, device.second) != away.end()) {
        out.push_back("display " + in_quotes(device.second) +
                      " turns its back to the volume: its columns or its rows run the wrong way");
      } else if (std::ranges::find(lost_, device) != lost_.end()) {
        misfits.push_back(std::string(kKindNames[static_cast<std::size_t>(device.first)]) + " " +
                          in_quotes(device.second) + figures(device) +
                          ": has it moved since the calibration?");
      }
    }
    // What has a known cause comes first: it may be all that makes the rest disagree.
    if (!is_cause_known) out.insert(out.end(), misfits.begin(), misfits.end());
    return out;
  }

  /// Whether so many stops do not belong that it is the surface that is wrong. After faults().
  [[nodiscard]] bool has_lost_surface() const {
    const auto lost =
        std::ranges::count_if(lost_, [](const Device& d) { return d.first == Kind::stop; });
    return static_cast<double>(lost) >
           kLostStops * static_cast<double>(sums(shares_, Kind::stop, {}).size());
  }

 private:
  struct Cause {
    std::string what;
    std::vector<std::string> devices;  ///< that it is about
  };
  using Sums = std::map<std::string, Share>;

  /// By the devices of one kind, without the observations of any of `without`.
  [[nodiscard]] Sums sums(const std::vector<Share>& shares, Kind kind,
                          const std::vector<Device>& without) const {
    Sums out;
    for (std::size_t i = 0; i < shares.size(); ++i) {
      const StackKey& key = observations_.all()[i].key;
      const bool is_out = std::ranges::any_of(without, [&](const Device& device) {
        return name_in(key, device.first) == device.second;
      });
      Share& sum = out[name_in(key, kind)];
      if (is_out) continue;
      sum.votes += shares[i].votes;
      sum.agreeing += shares[i].agreeing;
    }
    return out;
  }
  static double best_of(const Sums& devices) {
    double best = 0;
    for (const auto& [name, share] : devices) {
      if (share.votes >= kFewestVotes) best = std::max(best, share.share());
    }
    return best;
  }
  [[nodiscard]] std::optional<Device> worst() const {
    std::optional<Device> out;
    std::size_t most = 0;
    for (const Kind kind : kKinds) {
      const Sums devices = sums(shares_, kind, lost_);
      const double least = kLostShare * best_of(devices);
      for (const auto& [name, share] : devices) {
        const std::size_t wrong = share.votes - share.agreeing;
        if (share.votes < kFewestVotes || wrong <= most ||
            static_cast<double>(share.agreeing + kDoubt) >=
                least * static_cast<double>(share.votes)) {
          continue;
        }
        most = wrong;
        out = Device(kind, name);
      }
    }
    return out;
  }
  [[nodiscard]] std::vector<Device> silent_cameras() const {
    const Sums cameras = sums(shares_, Kind::camera, lost_);
    std::vector<std::size_t> votes;
    for (const auto& [name, share] : cameras) votes.push_back(share.votes);
    if (votes.empty()) return {};
    std::ranges::sort(votes);
    const double few = kSilentShare * static_cast<double>(votes[votes.size() / 2]);
    std::vector<Device> out;
    for (const auto& [name, share] : cameras) {
      const Device device(Kind::camera, name);
      if (static_cast<double>(share.votes) < few && std::ranges::find(lost_, device) == lost_.end())
        out.push_back(device);
    }
    return out;
  }
  [[nodiscard]] std::string figures(const Device& device) const {
    std::vector<Device> others = lost_;
    std::erase(others, device);
    const Sums devices = sums(shares_, device.first, others);
    const Share& share = devices.at(device.second);
    return " does not fit the rest (" + percent(share.share()) + " of its " +
           std::to_string(share.votes) + " hypotheses agree with the surface, of the best's " +
           percent(best_of(devices)) + ")";
  }
  /// What would make a camera or display belong to the rest.
  [[nodiscard]] std::optional<Cause> cause_of(const Device& device) {
    const Kind kind = device.first;
    const std::string& name = device.second;  // no binding: clang 14 captures none
    const Rig rig = observations_.rig();
    std::optional<Cause> best_cause;
    double best_share = 0;
    const auto consider = [&](const Assumption& assumed, std::vector<std::string> devices) {
      const double share = mended_share(assumed.rig, kind, devices);
      if (share <= best_share) return;
      best_share = share;
      best_cause = Cause{assumed.what, std::move(devices)};
    };
    const auto consider_all = [&](const auto& models, const auto& exchange, const auto& turn) {
      const std::size_t i = index_of(models, name);
      for (std::size_t other = 0; other < models.size(); ++other) {
        if (other != i) consider(exchange(i, other), {name, models[other].name});
      }
      for (const Flip& how : kFlips) consider(turn(i, how), {name});
    };
    if (kind == Kind::camera) {
      consider_all(
          rig.cameras,
          [&](std::size_t a, std::size_t b) {
            return exchanged(rig, "cameras", &Rig::cameras, a, b);
          },
          [&](std::size_t i, const Flip& how) { return with_camera(rig, i, how); });
    } else {
      consider_all(
          rig.displays,
          [&](std::size_t a, std::size_t b) {
            return exchanged(rig, "displays", &Rig::displays, a, b);
          },
          [&](std::size_t i, const Flip& how) { return with_display(rig, i, how); });
    }
    return best_cause;
  }
  /// The lowest share of the named devices under that rig; 0 where they do not belong to the rest.
  [[nodiscard]] double mended_share(const Rig& rig, Kind kind,
                                    const std::vector<std::string>& names) {
    const Assuming assuming(observations_, rig);
    if (!assuming.fits()) return 0;
    std::vector<Device> others = lost_;
    for (const std::string& name : names) std::erase(others, Device(kind, name));
    const Sums before = sums(shares_, kind, others);
    const Sums now = sums(shares_of(observations_, options_, points_), kind, others);
    double lowest = 1;
    std::size_t agreeing = 0;
    for (const std::string& name : names) {
      const auto share = now.find(name);
      if (share == now.end() || share->second.agreeing < kFewestEach) return 0;
      lowest = std::min(lowest, share->second.share());
      agreeing += share->second.agreeing;
    }
    return agreeing >= kFewestMended && lowest >= kMendedShare * best_of(before) ? lowest : 0;
  }

  Observations& observations_;
  const VoteOptions& options_;
  std::vector<MeasuredPoint> points_;
  std::vector<Share> shares_;  ///< under the rig as given
  std::vector<Device> lost_;   ///< what does not belong to the rest
};

// The coarse vote ---------------------------------------------------------------------------------

/// The leaves of `level` with the highest consistency, at most `count`.
std::vector<std::size_t> best_leaves(const Octree& octree, const NormalField& field, int level,
                                     std::size_t count) {
  std::vector<std::size_t> leaves;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    if (octree.leaves()[i].level == level && field.consistency[i] > 0) leaves.push_back(i);
  }
  count = std::min(count, leaves.size());
  std::partial_sort(leaves.begin(), leaves.begin() + static_cast<std::ptrdiff_t>(count),
                    leaves.end(), [&](std::size_t a, std::size_t b) {
                      if (field.consistency[a] != field.consistency[b])
                        return field.consistency[a] > field.consistency[b];
                      return a < b;
                    });
  leaves.resize(count);
  return leaves;
}

/// How well the votes agree where they agree best: the mean consistency of the best leaves.
Result<double> peak_consistency(const Observations& observations, const VoteOptions& options,
                                const Volume& volume, const Run& run) {
  const Run quiet{run.stop, {}};
  const Voter voter(observations, options);
  Octree octree = Octree::uniform(volume, kCoarse);
  NormalField field = ALHAZEN_TRY(voter.vote(octree, nullptr, quiet));
  for (int level = kCoarse; level < kFine; ++level) {
    std::vector<std::uint8_t> wanted(octree.size());
    for (std::size_t i = 0; i < wanted.size(); ++i) wanted[i] = octree.leaves()[i].level;
    for (const std::size_t leaf : best_leaves(octree, field, level, kKept))
      wanted[leaf] = static_cast<std::uint8_t>(level + 1);
    Octree finer = octree.adapted(wanted);
    const VotedBefore before{octree, field};
    NormalField finer_field = ALHAZEN_TRY(voter.vote(finer, &before, quiet));
    octree = std::move(finer);
    field = std::move(finer_field);
  }
  double sum = 0;
  for (const std::size_t leaf : best_leaves(octree, field, kFine, kJudged))
    sum += static_cast<double>(field.consistency[leaf]);
  return sum / static_cast<double>(kJudged);
}

/// Whether another rig was found under which the votes agree clearly better; `out` names it, or how
/// little they agree as it is.
Result<bool> look_at_whole_rig(Observations& observations, const VoteOptions& options,
                               const Volume& volume, const Run& run,
                               std::vector<std::string>& out) {
  const double given = ALHAZEN_TRY(peak_consistency(observations, options, volume, run));
  double best = 0;
  std::string cause;
  const std::vector<Assumption> assumptions = whole_rigs(observations.rig(), volume.centre_mm);
  for (std::size_t i = 0; i < assumptions.size(); ++i) {
    run.tell("diagnose", static_cast<double>(i) / static_cast<double>(assumptions.size()));
    const Assuming assuming(observations, assumptions[i].rig);
    if (!assuming.fits()) continue;
    const double score = ALHAZEN_TRY(peak_consistency(observations, options, volume, run));
    if (score <= best) continue;
    best = score;
    cause = assumptions[i].what;
  }
  run.tell("diagnose", 1);
  char figures[96];
  const bool is_better = best > kBetterFactor * given && best > given + kBetterBy;
  if (is_better) {
    std::snprintf(figures, sizeof figures, "consistency %.2f instead of %.2f", best, given);
    out.push_back("the light maps agree far better if " + cause + " (" + figures +
                  "): check rig and cables");
  } else {
    std::snprintf(figures, sizeof figures, "consistency %.2f at best", given);
    out.push_back("the light maps hardly agree anywhere (" + std::string(figures) +
                  "): is this the rig that they were taken with, and is the object in the volume?");
  }
  return is_better;
}

}  // namespace

Result<std::vector<std::string>> diagnose(Observations& observations, const VoteOptions& options,
                                          const Volume& volume, const Mesh* mesh, const Run& run) {
  std::vector<std::string> out;
  name_blind(
      observations, "camera", [](const StackKey& key) { return in_quotes(key.camera); }, out);
  name_blind(
      observations, "display", [](const StackKey& key) { return in_quotes(key.display); }, out);
  name_blind(
      observations, "stop", [](const StackKey& key) { return std::to_string(key.stop); }, out);
  std::vector<MeasuredPoint> points;
  double measured_share = 0;
  if (mesh != nullptr && !mesh->observed.empty()) {
    points = measured_points(*mesh);
    const auto measured = std::ranges::count_if(mesh->observed, [](auto o) { return o != 0; });
    measured_share = static_cast<double>(measured) / static_cast<double>(mesh->observed.size());
  }
  if (observations.size() < kFewestMaps) return out;
  Judge judge(observations, options, std::move(points));
  if (measured_share < kMeasuredShare || judge.best(Kind::camera) < kBestShare) {
    static_cast<void>(ALHAZEN_TRY(look_at_whole_rig(observations, options, volume, run, out)));
    return out;
  }
  const std::vector<std::string> faults =
      ALHAZEN_TRY(judge.faults(turned_away(observations, volume), run));
  if (judge.has_lost_surface()) {
    std::vector<std::string> whole;
    if (ALHAZEN_TRY(look_at_whole_rig(observations, options, volume, run, whole))) {
      out.insert(out.end(), whole.begin(), whole.end());
      return out;
    }
  }
  out.insert(out.end(), faults.begin(), faults.end());
  return out;
}

}  // namespace alhazen
