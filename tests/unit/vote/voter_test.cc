#include "reconstruct/vote/voter.h"

#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <numbers>
#include <random>

#include "reconstruct/vote/depth.h"
#include "tests/support/analytic.h"
#include "tests/support/nobody.h"

namespace alhazen {
namespace {

const Volume kVolume{};

analytic::RigSize small_rig() {
  analytic::RigSize size;
  size.cameras = 5;
  size.pixel_mm = 0.35;
  size.sensor_px = 320;
  size.tablet_turns = true;
  return size;
}

/// Twelve stops of a sphere with a small rig: exact or Gray.
const Observations& sphere_observations(bool is_gray) {
  static const auto make = [](bool gray) {
    const Rig rig = analytic::make_rig(small_rig());
    Observations made(rig, VoteOptions{}, kVolume.centre_mm);
    analytic::scan(rig, analytic::Sphere{}, 12, {.gray = gray}, {0, 0, 50}, 28,
                   [&](const LightMap& map) {
                     const Status added = made.add(map);
                     EXPECT_TRUE(added) << added.error().text();
                   });
    return made;
  };
  static const Observations exact = make(false), gray = make(true);
  return is_gray ? gray : exact;
}

/// All votes at single points, by a block of one.
std::vector<Eigen::Vector3d> votes_at(const Observations& observations,
                                      const Eigen::Vector3d& p_mm) {
  Gatherer gatherer(observations, VoteOptions{});
  PointBlock block;
  block.reset(p_mm, 0);
  block.add(p_mm, 0);
  BlockVotes votes;
  gatherer.gather(block, votes);
  std::vector<Eigen::Vector3d> list;
  for (std::size_t k = 0; k < votes.count[0]; ++k) {
    list.emplace_back(votes.x[votes.begin[0] + k], votes.y[votes.begin[0] + k],
                      votes.z[votes.begin[0] + k]);
  }
  return list;
}

TEST(Gatherer, HypothesesOfExactMapsAgreeOnTheTrueSurface) {
  struct Case {
    analytic::Shape shape;
    std::vector<Eigen::Vector3d> points;
  };
  std::vector<Case> cases(3);
  cases[0].shape = analytic::Sphere{};
  cases[1].shape = analytic::Torus{{0, 0, 50}, 25, 10};
  cases[2].shape = analytic::Plane{{0, 0, 40}, Eigen::Vector3d(0.1, 0.05, 1).normalized()};
  std::mt19937 random(3);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 600; ++i) {
    const double azimuth = unit(random) * std::numbers::pi,
                 height = 0.2 + 0.7 * std::abs(unit(random));
    const Eigen::Vector3d across(std::cos(azimuth), std::sin(azimuth), 0);
    const double around = std::sqrt(1 - height * height);
    cases[0].points.push_back(Eigen::Vector3d(0, 0, 50) +
                              25 * (around * across + height * Eigen::Vector3d::UnitZ()));
    cases[1].points.push_back(Eigen::Vector3d(0, 0, 50) + 25 * across +
                              10 * (around * across + height * Eigen::Vector3d::UnitZ()));
    const auto& plane = std::get<analytic::Plane>(cases[2].shape);
    Eigen::Vector3d p(15 * unit(random), 15 * unit(random), 0);
    p.z() = 40 - (0.1 * p.x() + 0.05 * p.y());
    EXPECT_NEAR(analytic::distance_mm(plane, p), 0, 1e-12);
    cases[2].points.push_back(p);
  }
  for (const Case& c : cases) {
    SCOPED_TRACE(c.shape.index());
    const bool is_torus = std::holds_alternative<analytic::Torus>(c.shape);  // slow to trace
    analytic::RigSize size = small_rig();
    if (is_torus) size.cameras = 3;
    const Rig rig = analytic::make_rig(size);
    Observations observations(rig, VoteOptions{}, kVolume.centre_mm);
    analytic::scan(rig, c.shape, is_torus ? 1 : 6, {}, {0, 0, 50}, 36,
                   [&](const LightMap& map) { EXPECT_TRUE(observations.add(map)); });
    std::size_t votes = 0, right = 0, near = 0;
    std::vector<double> errors;
    for (const Eigen::Vector3d& p : c.points) {
      const Eigen::Vector3d truth = analytic::normal(c.shape, p);
      for (const Eigen::Vector3d& n : votes_at(observations, p)) {
        ++votes;
        const double error = (n - truth).norm();
        if (error < 0.02) errors.push_back(error);
        near += error < 0.02 ? 1 : 0;
        right += error < 2e-3 ? 1 : 0;
      }
    }
    // Those seen through the object disagree by far more; a handful of the others lie where one
    // pixel of this coarse camera spans several degrees of a curved mirror.
    EXPECT_GT(near, is_torus ? 30u : 100u);
    EXPECT_GT(static_cast<double>(near), 0.3 * static_cast<double>(votes));
    EXPECT_GT(static_cast<double>(right), 0.9 * static_cast<double>(near));
    std::sort(errors.begin(), errors.end());
    EXPECT_LT(errors[errors.size() / 2], is_torus ? 4e-4 : 2e-4);
  }
}

TEST(Gatherer, ABlockGivesWhatItsPointsGiveAlone) {
  const Observations& observations = sphere_observations(true);
  const double reach = std::min(3.0, Gatherer::max_reach_mm(observations, kVolume.centre_mm));
  const Eigen::Vector3d centre(17, 0, 68);
  Gatherer gatherer(observations, VoteOptions{});
  PointBlock block;
  block.reset(centre, reach);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 200; ++i) {
    points.push_back(centre + reach / std::sqrt(3.0) *
                                  Eigen::Vector3d(unit(random), unit(random), unit(random)));
    block.add(points.back(), 0);
  }
  BlockVotes votes;
  EXPECT_GT(gatherer.gather(block, votes), 0u);
  std::size_t compared = 0, differ = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::vector<Eigen::Vector3d> alone = votes_at(observations, points[i]);
    // A pixel on the edge of a cell may fall to either side.
    if (alone.size() != votes.count[i]) {
      ++differ;
      continue;
    }
    for (std::size_t k = 0; k < alone.size(); ++k) {
      const std::size_t at = votes.begin[i] + k;
      const Eigen::Vector3d n(votes.x[at], votes.y[at], votes.z[at]);
      // 1e-3 px of a coarse camera on a 25 mm sphere: 0.5 µm / 25 mm, a few times.
      EXPECT_LT((n - alone[k]).norm(), 1e-4);
      ++compared;
    }
  }
  EXPECT_GT(compared, 500u);
  EXPECT_LE(differ, 4u);
}

TEST(Voter, ConsistencyPeaksOnTheSurfaceWithTheTrueNormal) {
  const Observations& observations = sphere_observations(true);
  const Voter voter(observations, VoteOptions{});
  const Octree octree = Octree::uniform(kVolume, 6);
  const auto field = voter.vote(octree, nullptr, kNobody);
  ASSERT_TRUE(field);
  EXPECT_GT(voter.hypotheses(), 100000u);
  double on = 0, inside = 0, outside = 0;
  std::size_t on_count = 0, inside_count = 0, outside_count = 0, right = 0, seen = 0;
  const analytic::Shape sphere = analytic::Sphere{};
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Eigen::Vector3d p = octree.centre_mm(i);
    const Eigen::Vector3d n = analytic::normal(sphere, p);
    if (n.z() < -0.2 || n.z() > 0.9) continue;  // hardly seen by the small rig
    const double d = analytic::distance_mm(sphere, p);
    EXPECT_GE(field->consistency[i], 0);
    EXPECT_LE(field->consistency[i], 1);
    if (std::abs(d) < 0.5) {
      on += field->consistency[i];
      ++on_count;
      if (field->consistency[i] > 0.1F) {
        ++seen;
        right += (field->normal[i].cast<double>() - n).norm() < 0.04 ? 1 : 0;
      }
    } else if (d > -6 && d < -4) {
      inside += field->consistency[i];
      ++inside_count;
    } else if (d > 4 && d < 6) {
      outside += field->consistency[i];
      ++outside_count;
    }
  }
  EXPECT_GT(on / static_cast<double>(on_count), 4 * inside / static_cast<double>(inside_count));
  EXPECT_GT(on / static_cast<double>(on_count), 4 * outside / static_cast<double>(outside_count));
  EXPECT_GT(static_cast<double>(right), 0.97 * static_cast<double>(seen));
  EXPECT_GT(static_cast<double>(seen), 0.5 * static_cast<double>(on_count));
}

TEST(Voter, LeavesVotedBeforeKeepTheirValues) {
  const Observations& observations = sphere_observations(true);
  const Voter voter(observations, VoteOptions{});
  const Octree coarse = Octree::uniform(kVolume, 5);
  const auto first = voter.vote(coarse, nullptr, kNobody);
  ASSERT_TRUE(first);
  std::vector<std::uint8_t> target(coarse.size(), 4);
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    if (first->consistency[i] > 0.2F) target[i] = 6;
  }
  const Octree fine = coarse.adapted(target);
  const VotedBefore before{coarse, *first};
  const auto kept = voter.vote(fine, &before, kNobody);
  const auto anew = voter.vote(fine, nullptr, kNobody);
  ASSERT_TRUE(kept);
  ASSERT_TRUE(anew);
  const auto old = fine.leaf_in(coarse);
  std::size_t same = 0, close = 0, split = 0;
  for (std::size_t i = 0; i < fine.size(); ++i) {
    if (fine.leaves()[i] == coarse.leaves()[old[i]]) {
      EXPECT_EQ(kept->consistency[i], first->consistency[old[i]]);
      EXPECT_EQ(kept->votes[i], first->votes[old[i]]);
      ++same;
    }
    if (fine.leaves()[i].level > coarse.leaves()[old[i]].level) {
      ++split;
      close += std::abs(int{kept->votes[i]} - int{anew->votes[i]}) <= 1 ? 1 : 0;
    }
    if (fine.leaves()[i].level < coarse.leaves()[old[i]].level) {
      // What was merged says what its middle said.
      EXPECT_EQ(kept->consistency[i], first->consistency[old[i]]);
    }
  }
  EXPECT_GT(same, 100u);
  // Blocks of another shape expand the projection elsewhere: 1e-3 px move a vote over an edge.
  EXPECT_GT(static_cast<double>(close), 0.999 * static_cast<double>(split));
  EXPECT_GT(split, 100u);
}

TEST(Voter, IsTheSameForAnyOrderOfArrivalAndAnyThreads) {
  const Rig rig = analytic::make_rig(small_rig());
  std::vector<LightMap> maps;
  analytic::scan(rig, analytic::Sphere{}, 2, {.gray = true}, {0, 0, 50}, 28,
                 [&](LightMap map) { maps.push_back(std::move(map)); });
  const Octree octree = Octree::uniform(kVolume, 5);
  const auto vote = [&](int threads) {
    Observations observations(rig, VoteOptions{}, kVolume.centre_mm);
    for (const LightMap& map : maps) EXPECT_TRUE(observations.add(map));
    const Voter voter(observations, VoteOptions{});
    tbb::task_arena arena(threads);
    return arena.execute([&] { return *voter.vote(octree, nullptr, kNobody); });
  };
  const NormalField first = vote(1);
  std::mt19937 random(2);
  std::shuffle(maps.begin(), maps.end(), random);
  const NormalField second = vote(2);
  EXPECT_EQ(std::memcmp(first.normal.data(), second.normal.data(),
                        first.normal.size() * sizeof(first.normal[0])),
            0);
  EXPECT_EQ(first.consistency, second.consistency);
  EXPECT_EQ(first.support, second.support);
  EXPECT_EQ(first.votes, second.votes);
  EXPECT_EQ(first.free_space, second.free_space);
}

TEST(Voter, DirectSightCarvesFreeSpaceAndNeverTheObject) {
  // A display straight behind the object, and maps of its direct sight.
  Rig rig = analytic::make_rig(small_rig());
  const Eigen::Vector3d eye = rig.cameras[1].centre_rig_mm();
  const Eigen::Vector3d gaze = (Eigen::Vector3d(0, 0, 50) - eye).normalized();
  DisplayModel& display = rig.displays[0];
  display.u_mm = 0.4 * gaze.cross(Eigen::Vector3d::UnitZ()).normalized();
  display.v_mm = 0.4 * gaze.cross(display.u_mm).normalized();
  display.width_px = display.height_px = 700;
  display.origin_mm = Eigen::Vector3d(0, 0, 50) + 200 * gaze - 350 * (display.u_mm + display.v_mm);
  const analytic::Shape sphere = analytic::Sphere{};
  Observations observations(rig, VoteOptions{}, kVolume.centre_mm);
  Observations unlabelled(rig, VoteOptions{}, kVolume.centre_mm);
  for (int stop = 0; stop < 6; ++stop) {
    LightMap map = analytic::light_map(rig, sphere, {stop, display.name, rig.cameras[1].name},
                                       stop * std::numbers::pi / 3, {});
    EXPECT_GT(std::count(map.label.begin(), map.label.end(), Label::direct_sight), 10000);
    ASSERT_TRUE(observations.add(map));
    // A decoder does not know the rig: to it all positions are reflections. The same comes out.
    for (Label& label : map.label) {
      if (label == Label::direct_sight) label = Label::mirror;
    }
    ASSERT_TRUE(unlabelled.add(map));
    EXPECT_EQ(unlabelled.all().back().sight.px, observations.all().back().sight.px);
    EXPECT_EQ(unlabelled.all().back().cells, observations.all().back().cells);
  }
  const Voter voter(observations, VoteOptions{});
  const Octree octree = Octree::uniform(kVolume, 6);
  const auto field = voter.vote(octree, nullptr, kNobody);
  ASSERT_TRUE(field);
  std::size_t free = 0, far = 0;
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const double d = analytic::distance_mm(sphere, octree.centre_mm(i));
    if (d < 0) {
      EXPECT_EQ(field->free_space[i], 0) << "inside the object";
    }
    const Eigen::Vector3d p = octree.centre_mm(i) - kVolume.centre_mm;
    if (d > 5 && p.norm() < 45) {
      ++far;
      free += field->free_space[i];
    }
  }
  EXPECT_GT(static_cast<double>(free), 0.6 * static_cast<double>(far));
}

TEST(Depth, RecoversKnownOffsets) {
  for (const bool is_gray : {false, true}) {
    SCOPED_TRACE(is_gray);
    const Observations& observations = sphere_observations(is_gray);
    const Voter voter(observations, VoteOptions{});
    const analytic::Shape sphere = analytic::Sphere{};
    const Octree octree = Octree::uniform(kVolume, 7);
    std::vector<std::uint32_t> leaves;
    std::vector<Eigen::Vector3f> normals;
    for (std::size_t i = 0; i < octree.size(); ++i) {
      const Eigen::Vector3d p = octree.centre_mm(i);
      const Eigen::Vector3d n = analytic::normal(sphere, p);
      if (std::abs(analytic::distance_mm(sphere, p)) > 0.5 || n.z() < -0.1 || n.z() > 0.9) continue;
      if (i % 3 != 0) continue;
      leaves.push_back(static_cast<std::uint32_t>(i));
      normals.push_back(n.cast<float>());
    }
    const auto samples = refine_depth(observations, VoteOptions{}, DepthOptions{},
                                      voter.noise_rad(), octree, leaves, normals, kNobody);
    ASSERT_TRUE(samples);
    std::vector<double> errors;
    double z2 = 0;
    for (std::size_t i = 0; i < leaves.size(); ++i) {
      const DepthSample& sample = (*samples)[i];
      if (!sample.is_accepted) continue;
      const Eigen::Vector3d p = octree.centre_mm(leaves[i]);
      const double error = sample.offset_mm - analytic::distance_mm(sphere, p);
      errors.push_back(std::abs(error));
      z2 += error * error / sample.variance_mm2;
      EXPECT_LT((sample.normal.cast<double>() - analytic::normal(sphere, p)).norm(), 0.03);
    }
    ASSERT_GT(errors.size(), leaves.size() / 8);
    std::sort(errors.begin(), errors.end());
    const double z = std::sqrt(z2 / static_cast<double>(errors.size()));
    // A third of a millimetre a pixel: interpolation alone leaves some micrometres.
    EXPECT_LT(errors[errors.size() / 2], is_gray ? 0.04 : 0.012);
    EXPECT_LT(errors[errors.size() * 9 / 10], is_gray ? 0.12 : 0.03);
    if (is_gray) {
      EXPECT_GT(z, 0.4);
      EXPECT_LT(z, 2.5);
    }
  }
}

TEST(Voter, StopsWhenAsked) {
  std::stop_source source;
  source.request_stop();
  const Voter voter(sphere_observations(true), VoteOptions{});
  const auto field =
      voter.vote(Octree::uniform(kVolume, 4), nullptr, alhazen::Run{source.get_token(), {}});
  ASSERT_FALSE(field);
  EXPECT_EQ(field.error().code, Code::cancelled);
}

class BadLightMap : public testing::Test {
 protected:
  Rig rig_ = analytic::make_rig(small_rig());
  LightMap map_ =
      analytic::light_map(rig_, analytic::Sphere{}, {0, "side", "c02"}, 0, {}, {100, 80, 120, 140});
  Observations observations_{rig_, VoteOptions{}, kVolume.centre_mm};

  void expect(Code code, const std::string& word) {
    const Status added = observations_.add(map_);
    ASSERT_FALSE(added);
    EXPECT_EQ(added.error().code, code);
    EXPECT_NE(added.error().what.find(word), std::string::npos) << added.error().what;
  }
};

TEST_F(BadLightMap, UnknownCamera) {
  map_.key.camera = "c99";
  expect(Code::invalid, "no such camera");
}
TEST_F(BadLightMap, UnknownDisplay) {
  map_.key.display = "ceiling";
  expect(Code::invalid, "no such display");
}
TEST_F(BadLightMap, RegionOutsideTheSensor) {
  map_.region.x = 201;
  expect(Code::invalid, "not within the sensor of 320 x 320 px");
}
TEST_F(BadLightMap, RegionOverflows) {
  map_.region.x = 2147483647;
  expect(Code::invalid, "not within the sensor");
}
TEST_F(BadLightMap, ListsOfAnotherLength) {
  map_.u_px.pop_back();
  expect(Code::invalid, "its lists hold");
}
TEST_F(BadLightMap, PositionNotFinite) {
  *std::find_if(map_.u_px.begin(), map_.u_px.end(), [](float u) { return std::isfinite(u); }) =
      std::nanf("");
  expect(Code::invalid, "not on the display of 1920 x 1080 px");
}
TEST_F(BadLightMap, AngleNotFinite) {
  map_.angle_rad = std::nan("");
  expect(Code::invalid, "angle");
}
TEST_F(BadLightMap, CameTwice) {
  EXPECT_TRUE(observations_.add(map_));
  expect(Code::conflict, "came before");
}

}  // namespace
}  // namespace alhazen
