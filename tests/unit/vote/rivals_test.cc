#include "reconstruct/vote/rivals.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/analytic.h"
#include "tests/support/nobody.h"

namespace alhazen {
namespace {

constexpr double kMinConsistency = 0.25;

/// A sphere of whose top nothing is seen: no display above.
struct TopIsUnseen {
  TopIsUnseen() {
    analytic::RigSize size;
    size.cameras = 6;
    size.pixel_mm = 0.45;
    size.sensor_px = 270;
    size.has_above = false;
    const Rig rig = analytic::make_rig(size);
    observations.emplace(rig, VoteOptions{}, Volume{}.centre_mm);
    analytic::scan(rig, analytic::Sphere{}, 16, {.noise_px = 0.2}, {0, 0, 50}, 28,
                   [&](const LightMap& map) { EXPECT_TRUE(observations->add(map)); });
    voter.emplace(*observations, VoteOptions{});
    field = *voter->vote(octree, nullptr, kNobody);
  }
  std::optional<Observations> observations;
  std::optional<Voter> voter;
  Octree octree = Octree::uniform(Volume{}, 7);
  NormalField field;

  [[nodiscard]] double edges_off(std::size_t leaf) const {
    return std::abs(analytic::distance_mm(analytic::Sphere{}, octree.centre_mm(leaf))) /
           octree.edge_mm(leaf);
  }
};

const TopIsUnseen& top_is_unseen() {
  static const TopIsUnseen scene;
  return scene;
}

TEST(Rivals, FarVotesAreExplainedByTheSurface) {
  const TopIsUnseen& scene = top_is_unseen();
  NormalField field = scene.field;
  ASSERT_TRUE(remove_rivals(*scene.observations, VoteOptions{}, *scene.voter, kMinConsistency,
                            scene.octree, field, kNobody));
  std::size_t surface = 0, lost = 0, far = 0, left = 0;
  for (std::size_t i = 0; i < scene.octree.size(); ++i) {
    if (field.no_surface[i] != 0) {
      ASSERT_EQ(field.consistency[i], 0);
      ASSERT_TRUE(field.normal[i].isZero());
    } else {
      ASSERT_EQ(field.consistency[i], scene.field.consistency[i]);
    }
    const double off = scene.edges_off(i);
    if (off < 0.5 && scene.field.consistency[i] >= kMinConsistency) {
      ++surface;
      lost += field.no_surface[i];
    }
    if (off > 8 && scene.field.consistency[i] > 0.05F) {
      ++far;
      left += field.no_surface[i] == 0 ? 1U : 0U;
    }
  }
  EXPECT_GT(surface, 2000u);
  EXPECT_EQ(lost, 0u);
  EXPECT_GT(far, 500u);
  EXPECT_LT(left, far / 10);
}

TEST(Rivals, WhereNothingIsSureNothingIsTaken) {
  const TopIsUnseen& scene = top_is_unseen();
  NormalField field = scene.field;
  ASSERT_TRUE(remove_rivals(*scene.observations, VoteOptions{}, *scene.voter, 1.1, scene.octree,
                            field, kNobody));
  EXPECT_EQ(field.consistency, scene.field.consistency);
  EXPECT_EQ(field.no_surface, scene.field.no_surface);
}

TEST(Rivals, StopsWhenAsked) {
  const TopIsUnseen& scene = top_is_unseen();
  NormalField field = scene.field;
  std::stop_source stop;
  stop.request_stop();
  const Status status =
      remove_rivals(*scene.observations, VoteOptions{}, *scene.voter, kMinConsistency, scene.octree,
                    field, alhazen::Run{stop.get_token(), {}});
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, Code::cancelled);
}

}  // namespace
}  // namespace alhazen
