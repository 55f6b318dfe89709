#include "reconstruct/refine/refine.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

#include "reconstruct/refine/rig_shift.h"
#include "reconstruct/refine/sight.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// Rounds of looking and moving in which a point finds the depth and normal its votes agree on.
constexpr int kSettleRounds = 3;
/// Reweightings in each.
constexpr int kTukeyRounds = 3;
/// Tukey's constant for 95 % efficiency, and the median of a two-dimensional normal error in
/// standard deviations of a component.
constexpr double kTukey = 4.685, kMedian = 1.18;
/// No map is better than this: keeps weights finite where votes agree exactly.
constexpr double kLeastNoiseRad = 1e-6;
/// Points summed together, so that no result depends on how threads share them.
constexpr std::size_t kPointsPerBlock = 32;
/// Converged where no number moves by more than this share of its remaining uncertainty.
constexpr double kConverged = 0.3;
/// A rig that loses more votes only looks better.
constexpr double kKeptVotes = 0.95;

/// Runs body(block, begin, end) over blocks of points.
template <class Body>
void for_point_blocks(std::size_t count, const Body& body) {
  for_each_index((count + kPointsPerBlock - 1) / kPointsPerBlock, [&](std::size_t block) {
    body(block, block * kPointsPerBlock, std::min(count, (block + 1) * kPointsPerBlock));
  });
}

double median_of(std::vector<double>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::string mrad(double rad) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4f mrad", 1000 * rad);
  return text.data();
}

/// A surface point with the votes that it has where it has settled.
struct Settled {
  SurfacePoint at;
  Eigen::Matrix<double, 3, 2> across;  ///< two directions across the normal
  std::vector<SightVote> votes;
  std::vector<Vector2d> residual, drift;  ///< across the normal: of n_v, and of it per mm of depth
  std::vector<double> weight;
  bool is_agreed = false;  ///< enough votes have weight
};

/// Solves for depth and normal (`mode`, across the present one) with Tukey's biweight and leaves
/// the residuals there. Returns the depth. REQUIRES: votes not empty.
double agree(Settled& point, double noise_rad, double depth_mm, Vector2d& mode,
             std::vector<double>& scratch) {
  const std::size_t count = point.votes.size();
  point.weight.assign(count, 1);
  point.residual.resize(count);
  point.drift.resize(count);
  std::vector<Vector2d>& residual = point.residual;
  std::vector<Vector2d> tilt(count);
  for (std::size_t v = 0; v < count; ++v) {
    tilt[v] = point.across.transpose() * point.votes[v].normal;
    point.drift[v] = point.across.transpose() * point.votes[v].by_point * point.at.normal;
  }
  double depth = 0, scale = noise_rad;
  for (int round = 0;; ++round) {
    Vector2d mean_tilt = Vector2d::Zero(), mean_drift = Vector2d::Zero();
    double weight = 0;
    for (std::size_t v = 0; v < count; ++v) {
      mean_tilt += point.weight[v] * tilt[v];
      mean_drift += point.weight[v] * point.drift[v];
      weight += point.weight[v];
    }
    mean_tilt /= weight;
    mean_drift /= weight;
    double cross = 0, information = scale * scale / (depth_mm * depth_mm);
    for (std::size_t v = 0; v < count; ++v) {
      const Vector2d apart = point.drift[v] - mean_drift;
      cross += point.weight[v] * (tilt[v] - mean_tilt).dot(apart);
      information += point.weight[v] * apart.squaredNorm();
    }
    depth = -cross / information;
    mode = mean_tilt + depth * mean_drift;
    scratch.clear();
    for (std::size_t v = 0; v < count; ++v) {
      residual[v] = tilt[v] + depth * point.drift[v] - mode;
      scratch.push_back(residual[v].norm());
    }
    if (round == kTukeyRounds) return depth;
    scale = std::max(median_of(scratch) / kMedian, noise_rad);
    for (std::size_t v = 0; v < count; ++v) {
      const double r = residual[v].norm() / (kTukey * scale);
      point.weight[v] = r < 1 ? (1 - r * r) * (1 - r * r) : 0;
    }
  }
}

void settle(const Sight& sight, const RefineOptions& options, double noise_rad, Settled& point,
            std::vector<double>& scratch) {
  point.is_agreed = false;
  for (int round = 0; round <= kSettleRounds; ++round) {
    sight.look(point.at.p_mm, point.at.normal, options.cone_rad, point.votes);
    if (point.votes.size() < static_cast<std::size_t>(options.min_votes)) return;
    point.across.col(0) = point.at.normal.unitOrthogonal();
    point.across.col(1) = point.at.normal.cross(point.across.col(0));
    Vector2d mode;
    const double depth = agree(point, noise_rad, options.depth_mm, mode, scratch);
    if (round == kSettleRounds) break;  // votes and residuals stay those of this place
    point.at.p_mm += std::clamp(depth, -options.depth_mm, options.depth_mm) * point.at.normal;
    point.at.normal = (point.at.normal + point.across * mode).normalized();
  }
  const auto agreeing = std::count_if(point.weight.begin(), point.weight.end(),
                                      [](double weight) { return weight > 0; });
  point.is_agreed = agreeing >= options.min_votes;
}

/// The points of one kind, used or held out, as one rig sees them.
struct Cloud {
  std::vector<Settled> points;
  VoteResidual residual;
};

/// The same points with another rig, settled anew from where they are.
Cloud settled(const Observations& observations, const Rig& rig, const RigShift& shift,
              double min_cosine, const RefineOptions& options, double noise_rad, const Cloud& from,
              const Run& run) {
  const Sight sight(observations, rig, shift, min_cosine);
  Cloud cloud;
  cloud.points.resize(from.points.size());
  for_point_blocks(cloud.points.size(), [&](std::size_t, std::size_t begin, std::size_t end) {
    std::vector<double> scratch;
    for (std::size_t i = begin; i < end && !run.stopped(); ++i) {
      cloud.points[i].at = from.points[i].at;
      settle(sight, options, noise_rad, cloud.points[i], scratch);
    }
  });
  std::vector<double> all;
  for (const Settled& point : cloud.points) {
    if (!point.is_agreed) continue;
    ++cloud.residual.points;
    for (const Vector2d& r : point.residual) all.push_back(r.norm());
  }
  cloud.residual.votes = all.size();
  cloud.residual.median_rad = median_of(all);
  return cloud;
}

/// Normal equations of the rig's motion, the points' own unknowns eliminated.
struct Normal {
  MatrixXd matrix;
  VectorXd slope;  ///< half the gradient
};

Normal normal_equations(const Cloud& cloud, const RigShift& shift, double scale_rad,
                        double depth_mm) {
  const Eigen::Index size = shift.size();
  std::vector<Normal> partial((cloud.points.size() + kPointsPerBlock - 1) / kPointsPerBlock);
  for_point_blocks(cloud.points.size(), [&](std::size_t b, std::size_t begin, std::size_t end) {
    Normal& sum = partial[b];
    sum.matrix = MatrixXd::Zero(size, size);
    sum.slope = VectorXd::Zero(size);
    MatrixXd coupling(3, size);  // of the point's tilt (2) and depth with the rig
    for (std::size_t i = begin; i < end; ++i) {
      const Settled& point = cloud.points[i];
      if (!point.is_agreed) continue;
      coupling.setZero();
      Eigen::Matrix3d own = Eigen::Matrix3d::Zero();
      own(2, 2) = scale_rad * scale_rad / (depth_mm * depth_mm);
      Vector3d own_slope = Vector3d::Zero();
      for (std::size_t v = 0; v < point.votes.size(); ++v) {
        const double weight = point.weight[v];
        if (weight <= 0) continue;
        const SightVote& vote = point.votes[v];
        const Eigen::Index at[3] = {shift.camera(vote.camera), shift.display(vote.display),
                                    shift.axis()};
        constexpr int kCount[3] = {RigShift::kDevice, RigShift::kDevice, RigShift::kAxis};
        const Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, RigShift::kDevice> by[3] = {
            point.across.transpose() * vote.by_camera, point.across.transpose() * vote.by_display,
            point.across.transpose() * vote.by_axis};
        Eigen::Matrix<double, 2, 3> by_own;
        by_own << -1, 0, point.drift[v].x(), 0, -1, point.drift[v].y();
        for (int r = 0; r < 3; ++r) {
          for (int c = 0; c < 3; ++c) {
            sum.matrix.block(at[r], at[c], kCount[r], kCount[c]) +=
                weight * by[r].transpose() * by[c];
          }
          sum.slope.segment(at[r], kCount[r]) += weight * by[r].transpose() * point.residual[v];
          coupling.middleCols(at[r], kCount[r]) += weight * by_own.transpose() * by[r];
        }
        own += weight * by_own.transpose() * by_own;
        own_slope += weight * by_own.transpose() * point.residual[v];
      }
      const Eigen::Matrix3d inverse = own.inverse();
      sum.matrix -= coupling.transpose() * inverse * coupling;
      sum.slope -= coupling.transpose() * inverse * own_slope;
    }
  });
  Normal total{MatrixXd::Zero(size, size), VectorXd::Zero(size)};
  for (const Normal& part : partial) {
    total.matrix += part.matrix;
    total.slope += part.slope;
  }
  const double weight = 1 / (scale_rad * scale_rad);
  total.matrix *= weight;
  total.slope *= weight;
  return total;
}

/// At most `most` of the points, evenly picked; every so many of them judge.
struct Picked {
  Cloud used, held_out;
};

Picked pick(const std::vector<SurfacePoint>& surface, const RefineOptions& options) {
  Picked picked;
  const auto most = static_cast<std::size_t>(options.points);
  const std::size_t count = std::min(most, surface.size());
  double due = 0;
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = k * surface.size() / count;
    due += options.held_out_share;
    Cloud& cloud = due >= 1 ? picked.held_out : picked.used;
    if (due >= 1) due -= 1;
    cloud.points.emplace_back().at = surface[i];
  }
  return picked;
}

/// Forgets the points at which nothing agrees.
void keep_agreed(Cloud& cloud) {
  std::erase_if(cloud.points, [](const Settled& point) { return !point.is_agreed; });
}

double median_noise_rad(const Observations& observations) {
  std::vector<double> noise;
  for (const Observation& seen : observations.all())
    if (seen.noise_rad > 0) noise.push_back(double{seen.noise_rad});
  return std::max(median_of(noise), kLeastNoiseRad);
}

std::vector<DeviceShift> device_shifts(const Rig& rig, const RigShift& shift, const VectorXd& by,
                                       const MatrixXd& covariance) {
  std::vector<DeviceShift> shifts;
  const auto add = [&](const std::string& name, Eigen::Index at, Eigen::Index count) {
    const auto sigma = [&](Eigen::Index from) {
      return std::sqrt(covariance.diagonal().segment(from, count).mean());
    };
    shifts.push_back({name, by.segment(at, count).norm(), by.segment(at + count, count).norm(),
                      sigma(at), sigma(at + count)});
  };
  for (std::size_t i = 0; i < rig.cameras.size(); ++i)
    add(rig.cameras[i].name, shift.camera(i), RigShift::kDevice / 2);
  for (std::size_t j = 0; j < rig.displays.size(); ++j)
    add(rig.displays[j].name, shift.display(j), RigShift::kDevice / 2);
  add("turntable", shift.axis(), RigShift::kAxis / 2);
  return shifts;
}

}  // namespace

Result<RefinedRig> refine_rig(const Observations& observations,
                              const std::vector<SurfacePoint>& surface,
                              const VoteOptions& vote_options, const RefineOptions& options,
                              const Run& run) {
  const auto cancelled = [] { return Error{Code::cancelled, "refinement was stopped"}; };
  const Rig& previous = observations.rig();
  RefinedRig refined{previous, {}};
  Refinement& how = refined.how;
  Vector3d near_mm = Vector3d::Zero();
  for (const SurfacePoint& point : surface) near_mm += point.p_mm;
  if (!surface.empty()) near_mm /= static_cast<double>(surface.size());
  const RigShift shift(previous, near_mm);
  const double noise_rad = median_noise_rad(observations);
  const auto settle_all = [&](const Rig& rig, const Cloud& cloud) {
    return settled(observations, rig, shift, vote_options.min_cosine, options, noise_rad, cloud,
                   run);
  };

  const Picked picked = pick(surface, options);
  Cloud used = settle_all(previous, picked.used);
  Cloud held_out = settle_all(previous, picked.held_out);
  if (run.stopped()) return cancelled();
  keep_agreed(used);
  keep_agreed(held_out);
  how.used_before = how.used_after = used.residual;
  how.held_out_before = how.held_out_after = held_out.residual;
  const auto fewest = static_cast<std::size_t>(options.min_points);
  if (used.residual.points < fewest || held_out.residual.points < fewest) {
    how.refusal = "votes agree at " + std::to_string(used.residual.points) + " and " +
                  std::to_string(held_out.residual.points) +
                  " points of the surface; a refinement takes " + std::to_string(fewest) +
                  " to compute with and as many to be judged by";
    return refined;
  }

  const VectorXd sigma = shift.presumed_sigma(previous, options);
  const MatrixXd free = shift.gauge_free(previous);
  VectorXd by = VectorXd::Zero(shift.size());  // θ
  MatrixXd covariance;
  while (how.iterations < options.iterations) {
    const double scale_rad = std::max(used.residual.median_rad / kMedian, noise_rad);
    const Normal normal = normal_equations(used, shift, scale_rad, options.depth_mm);
    const MatrixXd matrix =
        free.transpose() *
        (normal.matrix + MatrixXd(sigma.cwiseAbs2().cwiseInverse().asDiagonal())) * free;
    const VectorXd slope = free.transpose() * (normal.slope + by.cwiseQuotient(sigma.cwiseAbs2()));
    const Eigen::LDLT<MatrixXd> factors(matrix);
    const VectorXd step = -(free * factors.solve(slope));
    const MatrixXd left = free * factors.solve(free.transpose());
    if (!step.allFinite()) break;
    const VectorXd next_by = by + step;
    Cloud next = settle_all(shift.applied(previous, next_by), used);
    if (run.stopped()) return cancelled();
    ++how.iterations;
    run.tell("refine", static_cast<double>(how.iterations) / options.iterations);
    if (!(next.residual.median_rad < used.residual.median_rad)) break;
    by = next_by;
    covariance = left;
    used = std::move(next);
    const VectorXd uncertain = left.diagonal().cwiseMax(0).cwiseSqrt();
    if ((step.cwiseAbs().array() <= kConverged * uncertain.array() + 1e-12).all()) break;
  }
  run.tell("refine", 1);

  const Rig moved = shift.applied(previous, by);
  how.used_after = used.residual;
  how.held_out_after = settle_all(moved, held_out).residual;
  if (run.stopped()) return cancelled();
  const VoteResidual &before = how.held_out_before, &after = how.held_out_after;
  if (covariance.size() == 0) {
    how.refusal = "no motion of the devices makes the votes agree better";
  } else if (!(after.median_rad < before.median_rad)) {
    how.refusal = "at points that were not used the votes' median residual went from " +
                  mrad(before.median_rad) + " to " + mrad(after.median_rad);
  } else if (static_cast<double>(after.votes) < kKeptVotes * static_cast<double>(before.votes)) {
    how.refusal = "at points that were not used " + std::to_string(after.votes) + " of " +
                  std::to_string(before.votes) + " votes were left";
  } else {
    how.is_accepted = true;
    refined.rig = moved;
    how.shifts = device_shifts(previous, shift, by, covariance);
  }
  return refined;
}

}  // namespace alhazen
