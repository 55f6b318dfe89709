#include "reconstruct/vote/octree.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <set>

namespace alhazen {
namespace {

constexpr std::uint32_t kCells = 1u << Octree::kMaxLevel;

/// The low corner and side of a leaf in cells of the finest grid.
std::array<std::uint32_t, 4> box(const Leaf& leaf) {
  const std::uint32_t side = kCells >> leaf.level;
  return {leaf.x * side, leaf.y * side, leaf.z * side, side};
}

/// Whether two leaves share part of a face normal to `axis`, a on the low side; by plain geometry.
bool share_face(const Leaf& leaf_a, const Leaf& leaf_b, std::size_t axis) {
  const auto a = box(leaf_a), b = box(leaf_b);
  if (a[axis] + a[3] != b[axis]) return false;
  for (std::size_t other = 0; other < 3; ++other) {
    if (other == axis) continue;
    if (std::max(a[other], b[other]) >= std::min(a[other] + a[3], b[other] + b[3])) return false;
  }
  return true;
}

double volume_of(const Octree& octree) {
  double sum = 0;
  for (const Leaf& leaf : octree.leaves()) sum += std::pow(0.125, leaf.level);
  return sum;
}

/// An uneven octree: fine around a few points.
Octree uneven(std::uint32_t seed, int finest) {
  Octree octree = Octree::uniform(Volume{}, 2);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> coordinate(-51, 51);
  std::array<Eigen::Vector3d, 3> points;
  for (Eigen::Vector3d& p : points) {
    p = octree.volume().centre_mm +
        Eigen::Vector3d(coordinate(random), coordinate(random), coordinate(random));
  }
  std::vector<std::uint8_t> target(octree.size(), 1);
  for (int level = 3; level <= finest; ++level) {
    target.assign(octree.size(), 1);
    for (const Eigen::Vector3d& p : points) {
      target[*octree.find(p)] = static_cast<std::uint8_t>(level);
    }
    octree = octree.adapted(target);
  }
  return octree;
}

TEST(Octree, UniformHoldsEveryCellOnceInMortonOrder) {
  const Octree octree = Octree::uniform(Volume{{1, 2, 3}, 8.0}, 3);
  ASSERT_EQ(octree.size(), 512u);
  EXPECT_EQ(octree.finest_level(), 3);
  EXPECT_EQ(octree.leaves()[0], (Leaf{0, 0, 0, 3}));
  EXPECT_EQ(octree.leaves()[1], (Leaf{1, 0, 0, 3}));
  EXPECT_EQ(octree.leaves()[2], (Leaf{0, 1, 0, 3}));
  EXPECT_EQ(octree.leaves()[4], (Leaf{0, 0, 1, 3}));
  EXPECT_EQ(octree.leaves()[511], (Leaf{7, 7, 7, 3}));
  std::set<std::array<int, 3>> seen;
  for (const Leaf& leaf : octree.leaves()) seen.insert({leaf.x, leaf.y, leaf.z});
  EXPECT_EQ(seen.size(), 512u);
  EXPECT_DOUBLE_EQ(octree.edge_mm(0), 1.0);
  EXPECT_TRUE(octree.centre_mm(0).isApprox(Eigen::Vector3d(-2.5, -1.5, -0.5)));
}

TEST(Octree, FindGivesTheLeafAroundAPoint) {
  const Octree octree = uneven(7, 8);
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const double reach = octree.edge_mm(i) * 0.499;
    EXPECT_EQ(octree.find(octree.centre_mm(i)), i);
    EXPECT_EQ(octree.find(octree.centre_mm(i) + Eigen::Vector3d(reach, -reach, reach)), i);
  }
  const double half = octree.volume().edge_mm / 2;
  const Eigen::Vector3d centre = octree.volume().centre_mm;
  EXPECT_EQ(octree.find(octree.low_corner_mm()), 0u);
  EXPECT_FALSE(octree.find(centre + Eigen::Vector3d(half, 0, 0)));
  EXPECT_FALSE(octree.find(centre - Eigen::Vector3d(0, half * 1.0001, 0)));
  EXPECT_FALSE(octree.find(Eigen::Vector3d(0, std::nan(""), 0)));
}

TEST(Octree, AdaptedIsABalancedPartitionAsFineAsAsked) {
  for (const std::uint32_t seed : {1u, 2u, 3u}) {
    const Octree octree = uneven(seed, 8);
    EXPECT_DOUBLE_EQ(volume_of(octree), 1.0);
    EXPECT_EQ(octree.finest_level(), 8);
    EXPECT_LE(octree.size(), 3000u) << "refined only where asked";
    for (const Face& face : octree.faces()) {
      const int step = int{octree.leaves()[face.a].level} - int{octree.leaves()[face.b].level};
      EXPECT_LE(std::abs(step), 1);
    }
    // Asking for nothing gives the root.
    EXPECT_EQ(octree.adapted(std::vector<std::uint8_t>(octree.size(), 0)).size(), 1u);
    // Asking for what is there changes nothing.
    std::vector<std::uint8_t> same;
    for (const Leaf& leaf : octree.leaves()) same.push_back(leaf.level);
    EXPECT_EQ(octree.adapted(same).leaves(), octree.leaves());
  }
}

TEST(Octree, AdaptedMergesOnlyWhereAWholeParentAsksForLess) {
  const Octree octree = Octree::uniform(Volume{}, 3);
  std::vector<std::uint8_t> target(octree.size(), 2);
  target[0] = 3;
  const Octree merged = octree.adapted(target);
  EXPECT_EQ(merged.size(), 63u + 8u);
  EXPECT_EQ(merged.leaves()[7].level, 3);
  EXPECT_EQ(merged.leaves()[8].level, 2);
}

TEST(Octree, FacesAreThoseOfPlainGeometryOnce) {
  const Octree octree = uneven(5, 6);
  const std::vector<Face> faces = octree.faces();
  std::set<std::array<std::uint32_t, 3>> found;
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const Face& face = faces[i];
    EXPECT_TRUE(found.insert({face.a, face.b, face.axis}).second);
    if (i > 0) {
      EXPECT_TRUE(std::tie(faces[i - 1].a, faces[i - 1].b) < std::tie(face.a, face.b));
    }
  }
  std::size_t expected = 0;
  for (std::uint32_t a = 0; a < octree.size(); ++a) {
    for (std::uint32_t b = 0; b < octree.size(); ++b) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (!share_face(octree.leaves()[a], octree.leaves()[b], axis)) continue;
        ++expected;
        EXPECT_TRUE(found.contains({a, b, static_cast<std::uint32_t>(axis)}));
      }
    }
  }
  EXPECT_EQ(found.size(), expected);
}

TEST(Octree, TheFacesOfEachLeafCoverItsSides) {
  const Octree octree = uneven(9, 8);
  std::vector<double> area(octree.size(), 0);
  for (const Face& face : octree.faces()) {
    const double edge = std::min(octree.edge_mm(face.a), octree.edge_mm(face.b));
    area[face.a] += edge * edge;
    area[face.b] += edge * edge;
  }
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const Leaf& leaf = octree.leaves()[i];
    const int last = (1 << leaf.level) - 1;
    int sides = 6;
    for (const int at : {int{leaf.x}, int{leaf.y}, int{leaf.z}}) {
      sides -= (at == 0 ? 1 : 0) + (at == last ? 1 : 0);
    }
    EXPECT_NEAR(area[i], sides * octree.edge_mm(i) * octree.edge_mm(i), 1e-9);
  }
}

TEST(Octree, LeafInCarriesValuesBothWays) {
  const Octree fine = uneven(4, 8);
  const Octree coarse = Octree::uniform(fine.volume(), 3);
  const auto down = fine.leaf_in(coarse);
  for (std::size_t i = 0; i < fine.size(); ++i) {
    EXPECT_EQ(coarse.find(fine.centre_mm(i) + Eigen::Vector3d::Constant(1e-6)), down[i]);
  }
  const auto up = coarse.leaf_in(fine);
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    EXPECT_EQ(fine.find(coarse.centre_mm(i) + Eigen::Vector3d::Constant(1e-6)), up[i]);
  }
}

TEST(Octree, SingleLeafHasNoFaces) {
  const Octree octree = Octree::uniform(Volume{}, 0);
  EXPECT_EQ(octree.size(), 1u);
  EXPECT_TRUE(octree.faces().empty());
  EXPECT_EQ(octree.adapted({4}).size(), 4096u);
}

}  // namespace
}  // namespace alhazen
