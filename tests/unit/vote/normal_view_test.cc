#include "reconstruct/vote/normal_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "reconstruct/vote/gather.h"
#include "reconstruct/vote/observations.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;
using testing::HasSubstr;

const Vector3d kCentre{2, -1, 50};
constexpr double kRadius_mm = 20, kDistance_mm = 500;
constexpr int kSide_px = 200;

/// Cameras that look at the middle of the default volume from `elevations_deg`.
Rig rig_of(const std::vector<double>& elevations_deg) {
  Rig rig;
  for (const double deg : elevations_deg) {
    const double e = deg * std::numbers::pi / 180;
    const Vector3d eye =
        Vector3d(0, 0, 51.2) + kDistance_mm * Vector3d(std::cos(e), 0, std::sin(e));
    CameraModel camera;
    camera.name = "c" + std::to_string(rig.cameras.size());
    camera.width_px = camera.height_px = kSide_px;
    camera.fx_px = camera.fy_px = kDistance_mm / 0.3;
    camera.cx_px = camera.cy_px = (kSide_px - 1) / 2.0;
    camera.distortion[0] = -0.1;
    const Vector3d z = (Vector3d(0, 0, 51.2) - eye).normalized();
    const Vector3d x = z.cross(Vector3d::UnitZ()).normalized();
    camera.camera_from_rig.rotation << x.transpose(), z.cross(x).transpose(), z.transpose();
    camera.camera_from_rig.translation_mm = -(camera.camera_from_rig.rotation * eye);
    rig.cameras.push_back(camera);
  }
  return rig;
}

/// The exact normal map of the sphere.
NormalMap sphere_map(const Rig& rig, const NormalMapKey& key, double angle_rad) {
  const CameraModel& camera = *rig.camera(key.camera);
  const Pose camera_from_object = camera.camera_from_rig * rig.turntable.rig_from_object(angle_rad);
  const Vector3d centre = camera_from_object * kCentre;
  NormalMap map;
  map.key = key;
  map.angle_rad = angle_rad;
  map.region = {0, 0, kSide_px, kSide_px};
  for (int y = 0; y < kSide_px; ++y) {
    for (int x = 0; x < kSide_px; ++x) {
      const Vector3d d = camera.direction(Eigen::Vector2d(x, y));
      const double along = d.dot(centre);
      const double inside = along * along - centre.squaredNorm() + kRadius_mm * kRadius_mm;
      map.label.push_back(inside > 0 ? NormalLabel::object : NormalLabel::background);
      map.normal.emplace_back(Eigen::Vector3f::Zero());
      if (inside <= 0) continue;
      map.normal.back() =
          (((along - std::sqrt(inside)) * d - centre) / kRadius_mm).cast<float>().normalized();
    }
  }
  return map;
}

Observations three_views() {
  const Rig rig = rig_of({10, 45, 70});
  Observations observations(rig, VoteOptions{}, {0, 0, 51.2});
  for (const CameraModel& camera : rig.cameras) {
    const Status added = observations.add(sphere_map(rig, {1, camera.name}, 0.3));
    EXPECT_TRUE(added) << added.error().text();
  }
  return observations;
}

/// Votes and free space at one point.
struct Found {
  std::vector<Vector3d> votes;
  bool is_free = false;
};
Found at(const Observations& observations, const Vector3d& p_mm, double radius_mm) {
  Gatherer gatherer(observations, VoteOptions{});
  PointBlock block;
  block.reset(p_mm, 0);
  block.add(p_mm, radius_mm);
  BlockVotes votes;
  gatherer.gather(block, votes);
  Found found;
  found.is_free = votes.free_space[0] != 0;
  for (std::size_t k = 0; k < votes.count[0]; ++k) {
    const std::size_t i = votes.begin[0] + k;
    found.votes.emplace_back(votes.x[i], votes.y[i], votes.z[i]);
    EXPECT_GE(votes.observation[i], observations.size());
  }
  return found;
}

/// Towards the cameras, in the object frame.
Vector3d facing(double elevation_deg, double off_deg) {
  const double e = elevation_deg * std::numbers::pi / 180;
  const double turn = -0.3 + off_deg * std::numbers::pi / 180;
  return {std::cos(e) * std::cos(turn), std::cos(e) * std::sin(turn), std::sin(e)};
}

TEST(NormalView, VotesAgreeOnTheSurfaceAndDriftOffIt) {
  const Observations observations = three_views();
  for (const double off_deg : {0.0, 15.0, -25.0}) {
    const Vector3d n = facing(40, off_deg);
    const Found on = at(observations, kCentre + kRadius_mm * n, 0);
    ASSERT_EQ(on.votes.size(), 3U);
    for (const Vector3d& vote : on.votes) EXPECT_LT((vote - n).norm(), 2e-4);
    // d outside of it they run apart by d · tan(incidence) / R.
    const Found off = at(observations, kCentre + (kRadius_mm - 1) * n, 0);
    ASSERT_EQ(off.votes.size(), 3U);
    EXPECT_GT((off.votes[0] - off.votes[2]).norm(), 0.03);
  }
}

TEST(NormalView, BackgroundIsFreeSpaceAndTheObjectIsNot) {
  const Observations observations = three_views();
  EXPECT_TRUE(at(observations, kCentre + (kRadius_mm + 4) * Vector3d::UnitY(), 1).is_free);
  EXPECT_FALSE(at(observations, kCentre + (kRadius_mm + 0.5) * Vector3d::UnitY(), 1).is_free)
      << "the ball touches the object";
  EXPECT_FALSE(at(observations, kCentre, 1).is_free);
  // Behind the object nothing is known, and what votes there is seen through it.
  EXPECT_FALSE(at(observations, kCentre - 0.9 * kRadius_mm * facing(40, 0), 1).is_free);
  // Beyond the picture nothing is known either.
  EXPECT_FALSE(at(observations, kCentre + 200 * Vector3d::UnitY(), 1).is_free);
}

TEST(NormalView, UnknownPixelsNeitherVoteNorCarve) {
  const Rig rig = rig_of({45});
  NormalMap map = sphere_map(rig, {0, "c0"}, 0);
  for (NormalLabel& label : map.label) label = NormalLabel::unknown;
  map.label[100 * kSide_px + 100] = NormalLabel::object;
  Observations observations(rig, VoteOptions{}, {0, 0, 51.2});
  ASSERT_TRUE(observations.add(map));
  for (const double y : {0.0, 15.0, 30.0}) {
    const Found found = at(observations, kCentre + y * Vector3d::UnitY(), 0.1);
    EXPECT_FALSE(found.is_free);
    EXPECT_TRUE(found.votes.empty());
  }
}

TEST(NormalView, NormalsAreNotInterpolatedOverACrease) {
  const Rig rig = rig_of({45});
  NormalMap map = sphere_map(rig, {0, "c0"}, 0);
  for (int y = 0; y < kSide_px; ++y) {
    for (int x = 0; x < kSide_px; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * kSide_px + static_cast<std::size_t>(x);
      map.label[i] = NormalLabel::object;
      map.normal[i] = Eigen::Vector3f(x < 100 ? -0.5F : 0.5F, 0, -1).normalized();
    }
  }
  const auto view = make_normal_view(map, rig, {});
  ASSERT_TRUE(view);
  EXPECT_EQ(view->cells[50 * kSide_px + 98], 1);
  EXPECT_EQ(view->cells[50 * kSide_px + 99], 0);
  EXPECT_EQ(view->cells[50 * kSide_px + 100], 1);
}

TEST(NormalView, OrderOfArrivalDoesNotMatterAndNothingComesTwice) {
  const Rig rig = rig_of({10, 45, 70});
  Observations one(rig, VoteOptions{}, {0, 0, 51.2}), two = one;
  for (const int i : {0, 1, 2}) {
    ASSERT_TRUE(one.add(sphere_map(rig, {i, "c1"}, 0.1 * i)));
    ASSERT_TRUE(two.add(sphere_map(rig, {2 - i, "c1"}, 0.1 * (2 - i))));
  }
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(one.normal_views()[i].key, two.normal_views()[i].key);
  }
  EXPECT_EQ(one.add(sphere_map(rig, {1, "c1"}, 0.1)).error().code, Code::conflict);
}

TEST(NormalView, RefusesWhatDoesNotFitTheRig) {
  const Rig rig = rig_of({45});
  const NormalMap good = sphere_map(rig, {0, "c0"}, 0);
  const auto refused = [&](const auto& spoil) {
    NormalMap map = good;
    spoil(map);
    const auto view = make_normal_view(map, rig, {});
    EXPECT_FALSE(view);
    return view ? std::string() : view.error().text();
  };
  EXPECT_THAT(refused([](NormalMap& m) { m.key.camera = "c7"; }), HasSubstr("no such camera"));
  EXPECT_THAT(refused([](NormalMap& m) { m.region.x = 1; }), HasSubstr("not within the sensor"));
  EXPECT_THAT(refused([](NormalMap& m) { m.label.pop_back(); }), HasSubstr("its lists hold"));
  EXPECT_THAT(refused([](NormalMap& m) { m.angle_rad = std::nan(""); }), HasSubstr("angle"));
  EXPECT_THAT(refused([](NormalMap& m) { m.noise_rad = 2; }), HasSubstr("noise"));
  EXPECT_THAT(refused([](NormalMap& m) {
                m.normal[100 * kSide_px + 100].x() = std::numeric_limits<float>::quiet_NaN();
              }),
              HasSubstr("no unit vector"));
}

}  // namespace
}  // namespace alhazen
