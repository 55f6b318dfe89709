#include "reconstruct/refine/refine.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <random>
#include <string>

#include "reconstruct/refine/rig_shift.h"
#include "reconstruct/refine/sight.h"
#include "reconstruct/vote/depth.h"
#include "tests/support/analytic.h"
#include "tests/support/nobody.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::HasSubstr;

const Vector3d kCentre(0, 0, 51.2);
/// The scatter of a phase coding's positions at the footprints of these rigs.
constexpr double kNoisePx = 0.15;

/// A scan of a mirror: its true rig and its maps.
struct Scanned {
  analytic::Shape shape;
  Rig rig;
  std::vector<LightMap> maps;

  [[nodiscard]] Observations seen_by(const Rig& other) const {
    Observations observations(other, VoteOptions{}, kCentre);
    for (const LightMap& map : maps) EXPECT_TRUE(observations.add(map));
    return observations;
  }
};

Scanned scanned(const analytic::Shape& shape, const analytic::RigSize& size, int stops,
                const analytic::Coding& coding) {
  Scanned scan{shape, analytic::make_rig(size), {}};
  analytic::scan(scan.rig, shape, stops, coding, {0, 0, 50}, 27,
                 [&](LightMap map) { scan.maps.push_back(std::move(map)); });
  return scan;
}

const Scanned& sphere_scan() {
  static const Scanned scan = [] {
    analytic::RigSize size;
    size.cameras = 8;
    size.pixel_mm = 0.25;
    size.sensor_px = 480;
    size.tablet_turns = true;
    return scanned(analytic::Sphere{{1, -0.5, 50}, 25}, size, 12, {.noise_px = kNoisePx});
  }();
  return scan;
}

/// Smaller, far off the axis, and with displays that all stand still.
const Scanned& ball_scan() {
  static const Scanned scan = [] {
    analytic::RigSize size;
    size.cameras = 7;
    size.pixel_mm = 0.2;
    size.sensor_px = 480;
    return scanned(analytic::Sphere{{9, 6, 46}, 16}, size, 10, {.noise_px = kNoisePx});
  }();
  return scan;
}

/// Points near the upper part of a mirror's surface, as badly known as by a first reconstruction.
std::vector<SurfacePoint> points_of(const analytic::Shape& shape, int count,
                                    std::uint32_t seed = 3) {
  std::mt19937 random(seed);
  std::normal_distribution<double> deviate(0, 1);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<SurfacePoint> points;
  while (points.size() < static_cast<std::size_t>(count)) {
    Vector3d p(36 * unit(random), 36 * unit(random), 50 + 36 * unit(random));
    for (int step = 0; step < 30; ++step)
      p -= analytic::distance_mm(shape, p) * analytic::normal(shape, p);
    const Vector3d n = analytic::normal(shape, p);
    if (!(std::abs(analytic::distance_mm(shape, p)) < 1e-6) || n.z() < -0.2) continue;
    const Vector3d tilt(deviate(random), deviate(random), deviate(random));
    points.push_back({p + 0.03 * deviate(random) * n, (n + 3e-3 * tilt).normalized()});
  }
  return points;
}

/// How far cameras see points of the object from where they do in truth, in one frame.
double camera_error_px(const Rig& rig, const Rig& truth) {
  const Pose fit = fit_of_centres(truth, rig);
  double sum2 = 0;
  int count = 0;
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    for (const Vector3d& p : {Vector3d(0, 0, 50), Vector3d(20, 0, 60), Vector3d(0, 20, 40)}) {
      const auto seen = rig.cameras[i].project(rig.cameras[i].camera_from_rig * (fit * p));
      const auto is = truth.cameras[i].project(truth.cameras[i].camera_from_rig * p);
      sum2 += (*seen - *is).squaredNorm() / 2;
      ++count;
    }
  }
  return std::sqrt(sum2 / count);
}

RigShift shift_of(const Rig& rig) { return {rig, {0, 0, 50}}; }

TEST(RigShift, NoMotionIsTheRig) {
  const Rig& rig = sphere_scan().rig;
  const RigShift shift = shift_of(rig);
  const Rig same = shift.applied(rig, VectorXd::Zero(shift.size()));
  for (std::size_t i = 0; i < rig.cameras.size(); ++i) {
    EXPECT_LT((same.cameras[i].centre_rig_mm() - rig.cameras[i].centre_rig_mm()).norm(), 1e-10);
    EXPECT_EQ(same.cameras[i].camera_from_rig.rotation, rig.cameras[i].camera_from_rig.rotation);
  }
  for (std::size_t j = 0; j < rig.displays.size(); ++j)
    EXPECT_LT((same.displays[j].origin_mm - rig.displays[j].origin_mm).norm(), 1e-10);
  const Pose a = same.turntable.rig_from_object(1), b = rig.turntable.rig_from_object(1);
  EXPECT_LT((a.translation_mm - b.translation_mm).norm(), 1e-12);
  EXPECT_LT((a.rotation - b.rotation).norm(), 1e-14);
}

TEST(RigShift, GaugeFreeMotionsLeaveTheFitOfAllCentresAlone) {
  const Rig& rig = sphere_scan().rig;
  const RigShift shift = shift_of(rig);
  const Eigen::MatrixXd free = shift.gauge_free(rig);
  ASSERT_EQ(free.rows(), shift.size());
  ASSERT_EQ(free.cols(), shift.size() - 6);
  EXPECT_LT((free.transpose() * free - Eigen::MatrixXd::Identity(free.cols(), free.cols())).norm(),
            1e-12);
  std::mt19937 random(5);
  std::normal_distribution<double> deviate(0, 0.01);
  for (int round = 0; round < 20; ++round) {
    const VectorXd y = VectorXd::NullaryExpr(free.cols(), [&] { return deviate(random); });
    const Pose fit = fit_of_centres(shift.applied(rig, free * y), rig);
    EXPECT_LT((fit.rotation - Eigen::Matrix3d::Identity()).norm(), 1e-12);
    EXPECT_LT(fit.translation_mm.norm(), 1e-9);
  }
  // One camera fixes where it is, not how all turns about it.
  Rig alone = rig;
  alone.cameras.resize(1);
  const RigShift small = shift_of(alone);
  EXPECT_EQ(small.gauge_free(alone).cols(), small.size() - 3);
}

TEST(RigShift, FitOfCentresFindsAMotion) {
  const Rig& rig = sphere_scan().rig;
  const Pose motion{Eigen::AngleAxisd(0.3, Vector3d(1, 2, 3).normalized()).toRotationMatrix(),
                    {5, -7, 11}};
  Rig moved = rig;
  for (CameraModel& camera : moved.cameras)
    camera.camera_from_rig = camera.camera_from_rig * motion.inverse();
  const Pose found = fit_of_centres(rig, moved);
  EXPECT_LT((found.rotation - motion.rotation).norm(), 1e-12);
  EXPECT_LT((found.translation_mm - motion.translation_mm).norm(), 1e-9);
}

/// The vote of one observation at a point, with any rig.
std::optional<Vector3d> vote_of(const Observations& observations, const Rig& rig,
                                const RigShift& shift, const Vector3d& p, std::size_t observation) {
  std::vector<SightVote> votes;
  Sight(observations, rig, shift, 0.08).look(p, Vector3d::UnitZ(), 2, votes);
  for (const SightVote& vote : votes)
    if (vote.observation == observation) return vote.normal;
  return std::nullopt;
}

/// Light maps whose positions are an affine function of the pixel: there, bilinear look-up has the
/// one slope that any way to estimate it must find.
Observations affine_maps(const Rig& rig) {
  Observations observations(rig, VoteOptions{}, kCentre);
  for (LightMap map : sphere_scan().maps) {
    if (map.key.stop % 3 != 0) continue;
    const DisplayModel& display = *rig.display(map.key.display);
    const int k = map.key.stop + static_cast<int>(map.key.camera.back());
    const int first_u = display.width_px / 4, first_v = display.height_px / 4;
    for (int y = 0; y < map.region.height; ++y) {
      for (int x = 0; x < map.region.width; ++x) {
        const std::size_t i =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(map.region.width) +
            static_cast<std::size_t>(x);
        map.label[i] = Label::mirror;
        map.u_px[i] = static_cast<float>(first_u + (k % 3) * x + y);
        map.v_px[i] = static_cast<float>(first_v + x + (k % 2) * y);
      }
    }
    EXPECT_TRUE(observations.add(map));
  }
  return observations;
}

TEST(Sight, DerivativesAreCentralDifferences) {
  const Observations observations = affine_maps(sphere_scan().rig);
  // Not the rig that the observations were made with: nothing may come from there.
  const Rig rig = analytic::with_error(sphere_scan().rig, {.seed = 9});
  const RigShift shift = shift_of(rig);
  const Sight sight(observations, rig, shift, 0.08);
  std::vector<SightVote> votes;
  std::size_t compared = 0, turning = 0;
  for (const SurfacePoint& point : points_of(sphere_scan().shape, 4)) {
    sight.look(point.p_mm, point.normal, 2, votes);
    for (std::size_t v = 0; v < votes.size(); v += 7) {
      const SightVote& vote = votes[v];
      turning += rig.displays[vote.display].mount == Mount::turntable ? 1 : 0;
      const auto expect = [&](const std::optional<Vector3d>& more,
                              const std::optional<Vector3d>& less, double step,
                              const Vector3d& derivative, const std::string& what) {
        if (!more || !less) return;  // across the edge of a map
        const Vector3d central = (*more - *less) / (2 * step);
        EXPECT_LT((central - derivative).norm(), 2e-4 * (1 + derivative.norm()))
            << what << " of observation " << vote.observation << ": " << central.transpose()
            << " instead of " << derivative.transpose();
        ++compared;
      };
      constexpr double kStepMm = 1e-5;
      for (int axis = 0; axis < 3; ++axis) {
        const Vector3d step = kStepMm * Vector3d::Unit(axis);
        expect(vote_of(observations, rig, shift, point.p_mm + step, vote.observation),
               vote_of(observations, rig, shift, point.p_mm - step, vote.observation), kStepMm,
               vote.by_point.col(axis), "point");
      }
      for (Eigen::Index k = 0; k < shift.size(); ++k) {
        Vector3d derivative = Vector3d::Zero();
        if (k >= shift.axis()) {
          derivative = vote.by_axis.col(k - shift.axis());
        } else if (const auto c = k - shift.camera(vote.camera); c >= 0 && c < 6) {
          derivative = vote.by_camera.col(c);
        } else if (const auto d = k - shift.display(vote.display); d >= 0 && d < 6) {
          derivative = vote.by_display.col(d);
        } else if (k % 7 != 0) {
          continue;  // devices that have no part in this vote: a few of them
        }
        const double length_step =
            k >= shift.axis() ? (k < shift.axis() + 2 ? 1e-5 : 1e-7) : (k % 6 < 3 ? 1e-5 : 1e-7);
        const VectorXd step = length_step * VectorXd::Unit(shift.size(), k);
        expect(
            vote_of(observations, shift.applied(rig, step), shift, point.p_mm, vote.observation),
            vote_of(observations, shift.applied(rig, -step), shift, point.p_mm, vote.observation),
            length_step, derivative, "parameter " + std::to_string(k));
      }
    }
  }
  EXPECT_GT(compared, 500u);
  EXPECT_GT(turning, 5u) << "displays on the turntable have derivatives of their own";
}

/// Everything moved as one: rig, object, all.
Rig moved_by(const Pose& motion, Rig rig) {
  for (CameraModel& camera : rig.cameras)
    camera.camera_from_rig = camera.camera_from_rig * motion.inverse();
  for (DisplayModel& display : rig.displays) {
    display.origin_mm = motion * display.origin_mm;
    display.u_mm = motion.rotation * display.u_mm;
    display.v_mm = motion.rotation * display.v_mm;
  }
  rig.turntable.point_mm = motion * rig.turntable.point_mm;
  rig.turntable.direction = motion.rotation * rig.turntable.direction;
  return rig;
}

TEST(Refine, DoesNotDependOnTheFrame) {
  const Scanned& scan = sphere_scan();
  const Rig wrong = analytic::with_error(scan.rig, {.seed = 4});
  const Pose motion{Eigen::AngleAxisd(0.4, Vector3d(-1, 2, 1).normalized()).toRotationMatrix(),
                    {3, 5, -4}};
  std::vector<SurfacePoint> points = points_of(scan.shape, 1200);
  const auto here = refine_rig(scan.seen_by(wrong), points, {}, {}, kNobody);
  for (SurfacePoint& point : points) point = {motion * point.p_mm, motion.rotation * point.normal};
  Observations elsewhere(moved_by(motion, wrong), VoteOptions{}, motion * kCentre);
  for (const LightMap& map : scan.maps) ASSERT_TRUE(elsewhere.add(map));
  const auto there = refine_rig(elsewhere, points, {}, {}, kNobody);
  ASSERT_TRUE(here);
  ASSERT_TRUE(there);
  ASSERT_TRUE(here->how.is_accepted) << here->how.refusal;
  ASSERT_TRUE(there->how.is_accepted) << there->how.refusal;
  EXPECT_EQ(here->how.held_out_after.votes, there->how.held_out_after.votes);
  const Rig expected = moved_by(motion, here->rig);
  for (std::size_t i = 0; i < expected.cameras.size(); ++i) {
    EXPECT_LT((expected.cameras[i].centre_rig_mm() - there->rig.cameras[i].centre_rig_mm()).norm(),
              1e-5);
  }
  for (std::size_t j = 0; j < expected.displays.size(); ++j)
    EXPECT_LT((expected.displays[j].origin_mm - there->rig.displays[j].origin_mm).norm(), 1e-4);
  EXPECT_LT(camera_error_px(there->rig, expected), 1e-4);
}

/// Depths of leaves at the surface by the voting stage with a rig, against the true sphere: the RMS
/// of those accepted about the centre that fits them best (method's protocol of a sphere).
double depth_error_mm(const Scanned& scan, const Rig& rig) {
  const Observations observations = scan.seen_by(rig);
  const Octree octree = Octree::uniform(Volume{}, 6);
  std::vector<std::uint32_t> leaves;
  std::vector<Eigen::Vector3f> normals;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Vector3d p = octree.centre_mm(i), n = analytic::normal(scan.shape, p);
    if (std::abs(analytic::distance_mm(scan.shape, p)) > 0.8 || n.z() < -0.2) continue;
    leaves.push_back(static_cast<std::uint32_t>(i));
    normals.push_back(n.cast<float>());
  }
  const auto samples = refine_depth(observations, {}, {}, 1e-4, octree, leaves, normals, kNobody);
  EXPECT_TRUE(samples);
  std::vector<Vector3d> normal;
  std::vector<double> off;
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  Vector3d side = Vector3d::Zero();
  for (std::size_t k = 0; k < leaves.size(); ++k) {
    const DepthSample& sample = (*samples)[k];
    if (!sample.is_accepted) continue;
    const Vector3d foot =
        octree.centre_mm(leaves[k]) - double{sample.offset_mm} * sample.normal.cast<double>();
    normal.push_back(analytic::normal(scan.shape, foot));
    off.push_back(analytic::distance_mm(scan.shape, foot));
    matrix += normal.back() * normal.back().transpose();
    side += off.back() * normal.back();
  }
  EXPECT_GT(off.size(), leaves.size() / 8);
  const Vector3d centre_off = matrix.inverse() * side;
  double sum2 = 0;
  for (std::size_t k = 0; k < off.size(); ++k)
    sum2 += std::pow(off[k] - normal[k].dot(centre_off), 2);
  return std::sqrt(sum2 / static_cast<double>(off.size()));
}

TEST(Refine, RecoversKnownErrors) {
  struct Case {
    const Scanned& scan;
    double depth_true;  ///< with the true rig
    std::uint32_t seed;
  };
  const double sphere_true = depth_error_mm(sphere_scan(), sphere_scan().rig),
               ball_true = depth_error_mm(ball_scan(), ball_scan().rig);
  for (const Case& c : {Case{sphere_scan(), sphere_true, 1}, Case{sphere_scan(), sphere_true, 2},
                        Case{ball_scan(), ball_true, 1}}) {
    SCOPED_TRACE(std::to_string(c.scan.rig.cameras.size()) + " cameras, seed " +
                 std::to_string(c.seed));
    const Rig wrong = analytic::with_error(c.scan.rig, {.seed = c.seed});
    const Observations observations = c.scan.seen_by(wrong);
    const auto refined = refine_rig(observations, points_of(c.scan.shape, 2000), {}, {}, kNobody);
    ASSERT_TRUE(refined) << refined.error().text();
    ASSERT_TRUE(refined->how.is_accepted) << refined->how.refusal;
    const double camera_before = camera_error_px(wrong, c.scan.rig),
                 camera_after = camera_error_px(refined->rig, c.scan.rig);
    const double depth_before = depth_error_mm(c.scan, wrong),
                 depth_after = depth_error_mm(c.scan, refined->rig);
    // As good as the exact calibration, but for a quarter and half a micrometre.
    EXPECT_GT(depth_before, 0.008);
    EXPECT_LT(depth_after, 1.25 * c.depth_true + 0.0005);
    // Motions that change no vote, of which the sphere's place is one, stay as presumed.
    EXPECT_LT(camera_after, 0.6 * camera_before);
    const Refinement& how = refined->how;
    EXPECT_LT(how.used_after.median_rad, 0.2 * how.used_before.median_rad);
    EXPECT_LT(how.held_out_after.median_rad, 0.2 * how.held_out_before.median_rad);
    EXPECT_GT(how.held_out_after.votes, how.held_out_before.votes * 95 / 100);
    EXPECT_LE(how.iterations, 6);
    ASSERT_EQ(how.shifts.size(), c.scan.rig.cameras.size() + c.scan.rig.displays.size() + 1);
    for (std::size_t j = 0; j < c.scan.rig.displays.size(); ++j) {
      const DeviceShift& shift = how.shifts[c.scan.rig.cameras.size() + j];
      EXPECT_EQ(shift.name, c.scan.rig.displays[j].name);
      EXPECT_GT(shift.shift_mm, 0.01);
      EXPECT_GT(shift.sigma_mm, 0);
      EXPECT_LT(shift.sigma_mm, 0.2) << "more is known than was presumed";
    }
  }
}

TEST(Refine, AnExactCalibrationStaysWithinItsOwnUncertainty) {
  const Scanned& scan = sphere_scan();
  const auto refined =
      refine_rig(scan.seen_by(scan.rig), points_of(scan.shape, 1500), {}, {}, kNobody);
  ASSERT_TRUE(refined) << refined.error().text();
  // Accepted or not, it is no worse than what the votes' noise leaves open.
  EXPECT_LT(camera_error_px(refined->rig, scan.rig), 0.03);
  EXPECT_LT(depth_error_mm(scan, refined->rig), 1.25 * depth_error_mm(scan, scan.rig));
}

TEST(Refine, IsTheSameForAnyThreads) {
  const Scanned& scan = sphere_scan();
  const Observations observations = scan.seen_by(analytic::with_error(scan.rig, {.seed = 6}));
  const std::vector<SurfacePoint> points = points_of(scan.shape, 1200);
  const auto run = [&](int threads) {
    tbb::task_arena arena(threads);
    return arena.execute([&] {
      auto refined = refine_rig(observations, points, {}, {}, kNobody);
      EXPECT_TRUE(refined);
      EXPECT_TRUE(refined->how.is_accepted) << refined->how.refusal;
      return refined->rig.to_json();
    });
  };
  EXPECT_EQ(run(1), run(2));
}

TEST(Refine, KeepsTheRigWithoutASurface) {
  const Scanned& scan = sphere_scan();
  const auto refined = refine_rig(scan.seen_by(scan.rig), {}, {}, {}, kNobody);
  ASSERT_TRUE(refined);
  EXPECT_FALSE(refined->how.is_accepted);
  EXPECT_THAT(refined->how.refusal, HasSubstr("votes agree at 0 and 0 points"));
  EXPECT_EQ(refined->rig.to_json(), scan.rig.to_json());
  const auto few = refine_rig(scan.seen_by(scan.rig), points_of(scan.shape, 90), {}, {}, kNobody);
  ASSERT_TRUE(few);
  EXPECT_FALSE(few->how.is_accepted);
  EXPECT_THAT(few->how.refusal, HasSubstr("a refinement takes 100 to compute with"));
}

TEST(Refine, KeepsTheRigWhereTheMapsAreRandom) {
  const Scanned& scan = sphere_scan();
  std::mt19937 random(1);
  std::uniform_real_distribution<float> unit(0, 1);
  Observations observations(scan.rig, VoteOptions{.jump_rad = 3}, kCentre);
  for (LightMap map : scan.maps) {
    const DisplayModel& display = *scan.rig.display(map.key.display);
    for (std::size_t i = 0; i < map.size_px(); ++i) {
      if (!map.is_position(i)) continue;
      map.u_px[i] = unit(random) * static_cast<float>(display.width_px - 1);
      map.v_px[i] = unit(random) * static_cast<float>(display.height_px - 1);
    }
    ASSERT_TRUE(observations.add(map));
  }
  const auto refined = refine_rig(observations, points_of(scan.shape, 2000), {}, {}, kNobody);
  ASSERT_TRUE(refined);
  EXPECT_FALSE(refined->how.is_accepted);
  EXPECT_NE(refined->how.refusal, "");
  EXPECT_EQ(refined->rig.to_json(), scan.rig.to_json());
  EXPECT_TRUE(refined->how.shifts.empty());
}

TEST(Refine, KeepsTheRigWhereOnlyTheUsedPointsAgreeBetter) {
  // A handful of points, noisy maps, a right calibration and next to no trust in it: what is fitted
  // is noise, and the points held out tell.
  Scanned scan = sphere_scan();
  std::mt19937 random(7);
  std::normal_distribution<float> deviate(0, 3);
  for (LightMap& map : scan.maps) {
    for (std::size_t i = 0; i < map.size_px(); ++i) {
      const DisplayModel& display = *scan.rig.display(map.key.display);
      map.u_px[i] =
          std::clamp(map.u_px[i] + deviate(random), 0.0F, static_cast<float>(display.width_px - 1));
      map.v_px[i] = std::clamp(map.v_px[i] + deviate(random), 0.0F,
                               static_cast<float>(display.height_px - 1));
    }
  }
  RefineOptions options;
  options.camera_px = 5;
  options.camera_mm = 5;
  options.display_mm = 50;
  options.display_rad = 0.2;
  options.axis_mm = 5;
  options.axis_rad = 0.1;
  options.held_out_share = 0.5;
  options.min_points = 10;
  options.min_votes = 3;
  const Observations observations = scan.seen_by(scan.rig);
  int judged = 0;
  for (std::uint32_t seed = 1; seed <= 5; ++seed) {
    const auto refined =
        refine_rig(observations, points_of(scan.shape, 150, seed), {}, options, kNobody);
    ASSERT_TRUE(refined);
    if (refined->how.iterations == 0) continue;
    EXPECT_FALSE(refined->how.is_accepted) << seed;
    EXPECT_EQ(refined->rig.to_json(), scan.rig.to_json());
    // Some draws leave nothing to fit, even to noise; which ones hangs on rounding.
    if (refined->how.refusal.find("at points that were not used") != std::string::npos) ++judged;
  }
  EXPECT_GT(judged, 2);
}

TEST(Refine, StopsWhenAsked) {
  const Scanned& scan = sphere_scan();
  std::stop_source source;
  source.request_stop();
  const auto refined = refine_rig(scan.seen_by(scan.rig), points_of(scan.shape, 400), {}, {},
                                  alhazen::Run{source.get_token(), {}});
  ASSERT_FALSE(refined);
  EXPECT_EQ(refined.error().code, Code::cancelled);
}

}  // namespace
}  // namespace alhazen
