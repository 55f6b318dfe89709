#include "reconstruct/reconstruct.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <ctime>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "reconstruct/diagnose.h"
#include "reconstruct/mesh/clean.h"
#include "reconstruct/mesh/contour.h"
#include "reconstruct/surface/divergence.h"
#include "reconstruct/surface/min_cut.h"
#include "reconstruct/surface/signed_distance.h"
#include "reconstruct/vote/depth.h"
#include "reconstruct/vote/observations.h"
#include "reconstruct/vote/parallel.h"
#include "reconstruct/vote/rivals.h"
#include "reconstruct/vote/voter.h"

namespace alhazen {
namespace {

/// 16³ leaves: below that no object has a shape.
constexpr int kMinLevel = 4;
/// Previews: 1.6 mm at the default volume, a fraction of a second.
constexpr int kPreviewLevel = 6;
constexpr double kPreviewGap = 0.05;
/// Leaves away from the surface are at most so many levels above the start level.
constexpr int kCoarserLevels = 2;
/// Depths are measured this many leaves from the cut: its own error is about half a leaf.
constexpr int kDepthLeaves = 1;
/// A vertex is called measured where it lies within so many standard deviations of the nearest
/// measured leaf's depth, or so much of a leaf's edge, and its normal so near to that leaf's.
constexpr double kObservedSigmas = 3, kObservedEdges = 0.025, kMaxTurnRad = 0.3;

/// Adds the time of a scope to the stage's.
class Stopwatch {
 public:
  Stopwatch(std::vector<StageTime>& times, std::string_view stage) : times_(times), stage_(stage) {}
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;
  ~Stopwatch() {
    StageTime time = clock_.read(std::string(stage_));
    const auto found = std::find_if(times_.begin(), times_.end(),
                                    [&](const StageTime& t) { return t.stage == stage_; });
    if (found == times_.end()) {
      times_.push_back(std::move(time));
    } else {
      found->cpu_s += time.cpu_s;
      found->wall_s += time.wall_s;
    }
  }

 private:
  std::vector<StageTime>& times_;
  std::string_view stage_;
  StageClock clock_;
};

/// Tells the caller of a stage that comes in several steps as of one whose share only grows.
class Steps {
 public:
  Steps(const Run& run, std::string_view stage, int steps)
      : run_(run), stage_(stage), steps_(steps) {}
  /// The run to lend to the next step.
  [[nodiscard]] Run next() {
    const double done = std::min(done_++, steps_ - 1);
    return {run_.stop, [this, done](std::string_view, double share) {
              tell((done + std::clamp(share, 0.0, 1.0)) / steps_);
            }};
  }
  void finish() { tell(1); }

 private:
  void tell(double share) {
    double last = told_.load();
    while (share > last) {
      if (!told_.compare_exchange_weak(last, share)) continue;
      run_.tell(stage_, share);
      return;
    }
  }

  const Run& run_;
  std::string_view stage_;
  int steps_, done_ = 0;
  std::atomic<double> told_ = -1;
};

/// Octree, field and cut that belong together.
struct Solved {
  Octree octree;
  std::vector<Face> faces;
  NormalField field;
  std::vector<float> divergence;
  Indicator indicator;
};

bool is_inside(const Solved& solved, std::size_t leaf) {
  return !solved.indicator.u.empty() && solved.indicator.u[leaf] >= 0.5F;
}

/// How many steps over faces each leaf is from the cut, at most `limit`: 0 for the leaves on both
/// sides of it.
std::vector<std::uint8_t> steps_from_cut(const Solved& solved, int limit) {
  std::vector<std::uint8_t> steps(solved.octree.size(), static_cast<std::uint8_t>(limit));
  for (const Face& face : solved.faces) {
    if (is_inside(solved, face.a) != is_inside(solved, face.b)) steps[face.a] = steps[face.b] = 0;
  }
  for (int step = 1; step < limit; ++step) {
    for (const Face& face : solved.faces) {
      const auto reached = static_cast<std::uint8_t>(step);
      if (steps[face.a] == step - 1 && steps[face.b] > reached) steps[face.b] = reached;
      if (steps[face.b] == step - 1 && steps[face.a] > reached) steps[face.a] = reached;
    }
  }
  return steps;
}

/// The level wanted in each leaf: `level` near the cut and where votes agree, elsewhere as coarse
/// as balance allows down to `coarsest`.
std::vector<std::uint8_t> wanted_levels(const Solved& solved, int level, int coarsest,
                                        int band_leaves, double min_consistency) {
  const auto finest = static_cast<std::uint8_t>(level);
  std::vector<std::uint8_t> wanted(solved.octree.size(), static_cast<std::uint8_t>(coarsest));
  const std::vector<std::uint8_t> steps = steps_from_cut(solved, band_leaves + 1);
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (steps[i] <= band_leaves) wanted[i] = finest;
  }
  for (const Face& face : solved.faces) {
    const auto agrees = [&](std::uint32_t leaf) {
      return solved.field.consistency[leaf] >= static_cast<float>(min_consistency) &&
             solved.octree.leaves()[leaf].level + 1 >= level;
    };
    if (agrees(face.a) || agrees(face.b)) wanted[face.a] = wanted[face.b] = finest;
  }
  return wanted;
}

/// Whether the cut lies well within leaves of `level`: two more on each side of it, so that no
/// coarser leaf had a say in where it is.
bool is_settled(const Solved& solved, int level) {
  const std::vector<std::uint8_t> steps = steps_from_cut(solved, 2);
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps[i] < 2 && solved.octree.leaves()[i].level < level) return false;
  }
  return true;
}

/// Votes on `octree`, where `before` does not know already, and cuts it, starting from the cut of
/// `before` if it has one.
Result<Solved> solve(const Voter& voter, const SurfaceOptions& options, Octree octree,
                     const Solved* before, Steps& vote_steps, Steps& cut_steps,
                     std::vector<StageTime>& times) {
  Solved solved{std::move(octree), {}, {}, {}, {}};
  {
    const Stopwatch watch(times, "vote");
    std::optional<VotedBefore> known;
    if (before != nullptr) known.emplace(VotedBefore{before->octree, before->field});
    solved.field =
        ALHAZEN_TRY(voter.vote(solved.octree, known ? &*known : nullptr, vote_steps.next()));
  }
  const Stopwatch watch(times, "surface");
  solved.faces = solved.octree.faces();
  solved.divergence = flux_divergence(solved.octree, solved.faces, solved.field);
  std::optional<Indicator> warm;
  if (before != nullptr && !before->indicator.u.empty()) {
    warm.emplace();
    const std::vector<std::uint32_t> from = solved.octree.leaf_in(before->octree);
    warm->u.resize(from.size());
    for (std::size_t i = 0; i < from.size(); ++i) warm->u[i] = before->indicator.u[from[i]];
  }
  solved.indicator =
      ALHAZEN_TRY(min_cut(solved.octree, solved.faces, solved.field, solved.divergence, options,
                          warm ? &*warm : nullptr, cut_steps.next()));
  return solved;
}

/// The first octree: every leaf of `level` is voted on; what nothing agrees in is then merged, so
/// that the cut works on the rest. The field of the former comes with it, without a cut.
struct Start {
  Solved voted;
  Octree octree;
};

Result<Start> start(const Observations& observations, const Options& options, const Voter& voter,
                    const Volume& volume, int level, int coarsest, Steps& vote_steps) {
  Solved voted{Octree::uniform(volume, level), {}, {}, {}, {}};
  voted.field = ALHAZEN_TRY(voter.vote(voted.octree, nullptr, vote_steps.next()));
  if (std::all_of(voted.field.consistency.begin(), voted.field.consistency.end(),
                  [](float c) { return c <= 0; })) {
    return Error{Code::conflict, "no two of the " + std::to_string(observations.map_count()) +
                                     " maps agree on a normal anywhere in the volume: no "
                                     "surface"};
  }
  ALHAZEN_TRY(remove_rivals(observations, options.vote, voter, options.adapt.min_consistency,
                            voted.octree, voted.field, vote_steps.next()));
  voted.faces = voted.octree.faces();
  Octree octree = voted.octree.adapted(
      wanted_levels(voted, level, coarsest, 1, options.adapt.min_consistency / 2));
  return Start{std::move(voted), std::move(octree)};
}

/// Depths of the finest leaves within one step of the cut.
struct Depths {
  SurfaceSamples samples;
  std::vector<float> sigma_mm;  ///< per leaf; 0 where no depth was accepted
};

Result<Depths> measure(const Observations& observations, const Voter& voter, const Options& options,
                       const Solved& solved, int band_leaves, const Run& run) {
  const std::size_t size = solved.octree.size();
  Depths depths;
  depths.samples.normal.assign(size, Eigen::Vector3f::Zero());
  depths.samples.offset_mm.assign(size, 0);
  depths.samples.weight.assign(size, 0);
  depths.sigma_mm.assign(size, 0);
  const std::vector<std::uint8_t> steps = steps_from_cut(solved, band_leaves + 1);
  std::vector<std::uint32_t> leaves;
  std::vector<Eigen::Vector3f> normals;
  for (std::size_t i = 0; i < size; ++i) {
    if (steps[i] > band_leaves || solved.octree.leaves()[i].level < solved.octree.finest_level() ||
        solved.field.consistency[i] <= 0) {
      continue;
    }
    leaves.push_back(static_cast<std::uint32_t>(i));
    normals.push_back(solved.field.normal[i]);
  }
  const std::vector<DepthSample> found =
      ALHAZEN_TRY(refine_depth(observations, options.vote, options.depth, voter.noise_rad(),
                               solved.octree, leaves, normals, run));
  for (std::size_t k = 0; k < leaves.size(); ++k) {
    const DepthSample& sample = found[k];
    if (!sample.is_accepted) continue;
    const std::size_t leaf = leaves[k];
    depths.samples.normal[leaf] = sample.normal;
    depths.samples.offset_mm[leaf] = sample.offset_mm;
    depths.samples.weight[leaf] = 1 / sample.variance_mm2;
    depths.sigma_mm[leaf] = std::sqrt(sample.variance_mm2);
  }
  return depths;
}

double allowed_mm(double edge_mm, double sigma_mm) {
  return std::max(kObservedEdges * edge_mm, kObservedSigmas * sigma_mm);
}

/// Which leaves have a measured depth that the surface that came out follows.
LeafFacts facts_of(const Solved& solved, const Depths& depths, const SignedDistance& distance) {
  const std::size_t size = solved.octree.size();
  LeafFacts facts;
  facts.consistency = solved.field.consistency;
  facts.observed.assign(size, 0);
  facts.depth_sigma_mm = depths.sigma_mm;
  for (std::size_t i = 0; i < size; ++i) {
    if (depths.samples.weight[i] <= 0 || distance.in_band[i] == 0) continue;
    const double off_mm = std::abs(distance.value_mm[i] - depths.samples.offset_mm[i]);
    facts.observed[i] = off_mm <= allowed_mm(solved.octree.edge_mm(i), depths.sigma_mm[i]) ? 1 : 0;
  }
  return facts;
}

/// Takes the flag from vertices that the nearest measured leaf does not speak for: off its plane by
/// more than its uncertainty and a bend allow, or turned away from its normal. At the rim of what
/// was seen the surface may leave the measured one within a leaf.
void check_observed(const Solved& solved, const Depths& depths, const LeafFacts& facts,
                    Mesh& mesh) {
  const Octree& octree = solved.octree;
  const double edge_mm = octree.volume().edge_mm / (1 << octree.finest_level());
  for_each_index(mesh.vertices_mm.size(), [&](std::size_t v) {
    if (mesh.observed[v] == 0) return;
    const Eigen::Vector3d& p = mesh.vertices_mm[v];
    double nearest2 = edge_mm * edge_mm;
    std::optional<std::size_t> leaf;
    for (int k = 0; k < 27; ++k) {
      const Eigen::Vector3d step =
          Eigen::Vector3i(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1).cast<double>();
      const auto near = octree.find(p + edge_mm * step);
      if (!near || facts.observed[*near] == 0) continue;
      const double distance2 = (octree.centre_mm(*near) - p).squaredNorm();
      if (distance2 > nearest2) continue;
      nearest2 = distance2;
      leaf = near;
    }
    bool is_measured = false;
    if (leaf) {
      const Eigen::Vector3d n = depths.samples.normal[*leaf].cast<double>();
      const double off_mm =
          std::abs(depths.samples.offset_mm[*leaf] + n.dot(p - octree.centre_mm(*leaf)));
      const double turned_rad = (mesh.normals[v].cast<double>() - n).norm();
      // Between two points of a surface of one curvature that turns by α over s lies αs/2.
      is_measured =
          turned_rad <= kMaxTurnRad && off_mm <= allowed_mm(edge_mm, depths.sigma_mm[*leaf]) +
                                                     0.5 * turned_rad * std::sqrt(nearest2);
    }
    if (!is_measured) {
      mesh.observed[v] = 0;
      mesh.depth_sigma_mm[v] = std::numeric_limits<float>::quiet_NaN();
    }
  });
}

/// Takes the flag from vertices that no observed triangle holds: single ones among others that
/// disagree are where a few votes agreed by chance.
void drop_lonely(Mesh& mesh) {
  std::vector<std::uint8_t> is_held(mesh.vertices_mm.size(), 0);
  for (const auto& triangle : mesh.triangles) {
    if (!std::all_of(triangle.begin(), triangle.end(),
                     [&](std::uint32_t v) { return mesh.observed[v] != 0; })) {
      continue;
    }
    for (const std::uint32_t v : triangle) is_held[v] = 1;
  }
  for (std::size_t v = 0; v < is_held.size(); ++v) {
    if (mesh.observed[v] == 0 || is_held[v] != 0) continue;
    mesh.observed[v] = 0;
    mesh.depth_sigma_mm[v] = std::numeric_limits<float>::quiet_NaN();
  }
}

Result<Mesh> mesh_of(const Octree& octree, const SignedDistance& distance, const LeafFacts& facts,
                     const Run& run) {
  Mesh mesh = ALHAZEN_TRY(contour(octree, distance.value_mm, run));
  CleanOptions cleaning;
  cleaning.min_edge_mm = 0.05 * octree.volume().edge_mm / (1 << octree.finest_level());
  mesh = ALHAZEN_TRY(clean(std::move(mesh), cleaning));
  annotate(octree, facts, mesh);
  return mesh;
}

}  // namespace

struct Reconstruction::State {
  State(const Rig& rig, const Volume& wanted_volume, int wanted_level, const Options& wanted)
      : volume(wanted_volume),
        level(wanted_level),
        options(wanted),
        observations(rig, wanted.vote, wanted_volume.centre_mm) {}
  Volume volume;
  int level;
  Options options;
  Observations observations;
  std::vector<StageTime> times;  ///< of adding and previewing
  std::uint64_t hypotheses = 0;
};

Reconstruction::Reconstruction(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}
Reconstruction::Reconstruction(Reconstruction&&) noexcept = default;
Reconstruction& Reconstruction::operator=(Reconstruction&&) noexcept = default;
Reconstruction::~Reconstruction() = default;

Result<Reconstruction> Reconstruction::make(const Rig& rig, const Volume& volume, int level,
                                            const Options& options) {
  ALHAZEN_TRY(options.is_valid());
  if (level < kMinLevel || level > Octree::kMaxLevel) {
    return Error{Code::invalid, "level is " + std::to_string(level) + ", allowed " +
                                    std::to_string(kMinLevel) + " to " +
                                    std::to_string(Octree::kMaxLevel)};
  }
  if (!(volume.edge_mm > 0 && volume.edge_mm <= 10000) || !volume.centre_mm.allFinite()) {
    return Error{Code::invalid, "the volume's edge is " + std::to_string(volume.edge_mm) +
                                    " mm, allowed above 0 to 10000 mm about a finite centre"};
  }
  return Reconstruction(std::make_unique<State>(rig, volume, level, options));
}

Status Reconstruction::add(const LightMap& map) {
  const Stopwatch watch(state_->times, "add");
  return state_->observations.add(map);
}

Status Reconstruction::add(const NormalMap& map) {
  const Stopwatch watch(state_->times, "add");
  return state_->observations.add(map);
}

Result<Mesh> Reconstruction::preview(const Run& run) {
  if (state_->observations.map_count() == 0) {
    return Error{Code::conflict, "no light map has come yet"};
  }
  const Stopwatch watch(state_->times, "preview");
  std::vector<StageTime> unused;
  const Voter voter(state_->observations, state_->options.vote);
  Steps vote_steps(run, "vote", 4), cut_steps(run, "surface", 3), mesh_steps(run, "mesh", 1);
  const int level = std::min(state_->level, kPreviewLevel);
  const int coarsest = std::max(0, level - kCoarserLevels);
  SurfaceOptions options = state_->options.surface;
  options.relative_gap = std::max(options.relative_gap, kPreviewGap);
  auto solve_preview = [&]() -> Result<Solved> {
    Start first = ALHAZEN_TRY(start(state_->observations, state_->options, voter, state_->volume,
                                    level, coarsest, vote_steps));
    const Solved coarse = ALHAZEN_TRY(solve(voter, options, std::move(first.octree), &first.voted,
                                            vote_steps, cut_steps, unused));
    return solve(voter, options,
                 coarse.octree.adapted(wanted_levels(coarse, level, coarsest,
                                                     state_->options.adapt.band_leaves,
                                                     state_->options.adapt.min_consistency)),
                 &coarse, vote_steps, cut_steps, unused);
  };
  auto solved = solve_preview();
  state_->hypotheses += voter.hypotheses();
  if (!solved) return std::move(solved).error();
  SurfaceSamples samples;
  samples.normal = solved->field.normal;
  samples.offset_mm.assign(solved->octree.size(), 0);
  samples.weight.assign(solved->octree.size(), 0);
  const SignedDistance distance =
      ALHAZEN_TRY(signed_distance(solved->octree, solved->faces, solved->indicator, samples,
                                  state_->options.surface, cut_steps.next()));
  LeafFacts facts;
  facts.consistency = solved->field.consistency;
  facts.observed.assign(solved->octree.size(), 0);
  facts.depth_sigma_mm.assign(solved->octree.size(), 0);
  return mesh_of(solved->octree, distance, facts, mesh_steps.next());
}

Result<Reconstructed> Reconstruction::finish(const Run& run) {
  Result<Reconstructed> made = make_all(run);
  if (!made && made.error().code != Code::conflict) return made;
  std::vector<StageTime> times;
  std::vector<std::string> faults;
  if (state_->observations.size() > 0) {
    const Stopwatch watch(times, "diagnose");
    faults = ALHAZEN_TRY(diagnose(state_->observations, state_->options.vote, state_->volume,
                                  made ? &made->mesh : nullptr, run));
  }
  if (made) {
    made->times.insert(made->times.end(), times.begin(), times.end());
    made->warnings = std::move(faults);
    // Only now: where a device is wrong, single vertices are what its votes leave of the surface.
    drop_lonely(made->mesh);
    return made;
  }
  // That nothing agrees, which a preview may wait for to change, is the plan's fault now.
  Error& error = made.error();
  error.code = Code::invalid;
  error.what += "; take more stops, cameras or displays, or another volume";
  for (const std::string& fault : faults) error.what += "; " + fault;
  return made;
}

Result<RefinedRig> Reconstruction::refine(const Mesh& mesh, const Run& run) const {
  std::vector<SurfacePoint> surface;
  for (std::size_t i = 0; i < mesh.observed.size(); ++i) {
    if (mesh.observed[i] != 0)
      surface.push_back({mesh.vertices_mm[i], mesh.normals[i].cast<double>()});
  }
  return refine_rig(state_->observations, surface, state_->options.vote, state_->options.refine,
                    run);
}

Result<Reconstructed> Reconstruction::make_all(const Run& run) {
  if (state_->observations.map_count() == 0) {
    return Error{Code::conflict, "no light map has come: there is nothing to reconstruct"};
  }
  const Options& options = state_->options;
  const AdaptOptions& adapt = options.adapt;
  const Voter voter(state_->observations, options.vote);
  Reconstructed result{{}, Octree::uniform(state_->volume, 0), {}, {}, {}, {}, {}, 0, 0, 0};
  result.times = state_->times;
  result.light_maps = state_->observations.size();
  result.normal_maps = state_->observations.normal_views().size();
  const int start_level = std::min(state_->level, adapt.start_level);
  const int coarsest = std::max(0, start_level - kCoarserLevels);
  const int rounds = (state_->level - start_level + 1) * adapt.adaptions;
  Steps vote_steps(run, "vote", rounds + 2), cut_steps(run, "surface", rounds + 2);
  Steps depth_steps(run, "depth", 1), mesh_steps(run, "mesh", 1);

  std::optional<Octree> octree;  // to be cut next, where it is known already
  std::optional<Solved> solved;
  {
    const Stopwatch watch(result.times, "vote");
    Start first = ALHAZEN_TRY(start(state_->observations, options, voter, state_->volume,
                                    start_level, coarsest, vote_steps));
    solved.emplace(std::move(first.voted));
    octree.emplace(std::move(first.octree));
  }
  for (int level = start_level; level <= state_->level; ++level) {
    for (int adaption = 0; adaption < adapt.adaptions; ++adaption) {
      std::optional<Octree> next_octree = std::exchange(octree, std::nullopt);
      if (!next_octree) {
        if (adaption > 0 && is_settled(*solved, level)) break;
        // Before the first cut of a level its leaves are still one level too large.
        const int band_leaves = adaption == 0 ? (adapt.band_leaves + 1) / 2 : adapt.band_leaves;
        next_octree = solved->octree.adapted(
            wanted_levels(*solved, level, coarsest, band_leaves, adapt.min_consistency));
        if (next_octree->leaves() == solved->octree.leaves()) break;
      }
      Solved next = ALHAZEN_TRY(solve(voter, options.surface, *std::move(next_octree), &*solved,
                                      vote_steps, cut_steps, result.times));
      solved.emplace(std::move(next));
    }
  }
  vote_steps.finish();

  std::optional<Depths> depths;
  {
    const Stopwatch watch(result.times, "depth");
    depths.emplace(ALHAZEN_TRY(
        measure(state_->observations, voter, options, *solved, kDepthLeaves, depth_steps.next())));
    depth_steps.finish();
  }
  std::optional<SignedDistance> distance;
  {
    const Stopwatch watch(result.times, "surface");
    distance.emplace(
        ALHAZEN_TRY(signed_distance(solved->octree, solved->faces, solved->indicator,
                                    depths->samples, options.surface, cut_steps.next())));
    cut_steps.finish();
  }
  {
    const Stopwatch watch(result.times, "mesh");
    const LeafFacts facts = facts_of(*solved, *depths, *distance);
    result.mesh = ALHAZEN_TRY(mesh_of(solved->octree, *distance, facts, mesh_steps.next()));
    check_observed(*solved, *depths, facts, result.mesh);
    mesh_steps.finish();
  }
  result.octree = std::move(solved->octree);
  result.field = std::move(solved->field);
  result.divergence = std::move(solved->divergence);
  result.indicator = std::move(solved->indicator);
  result.hypotheses = state_->hypotheses + voter.hypotheses();
  return result;
}

}  // namespace alhazen
