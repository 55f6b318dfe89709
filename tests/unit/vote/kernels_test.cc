#include "reconstruct/vote/kernels.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

namespace alhazen {
namespace {

using kernels::kPadding;

/// Runs the body once for every instruction set of this machine.
template <class Body>
void for_each_target(const Body& body) {
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    SCOPED_TRACE(std::string("target ") + hwy::TargetName(target));
    body();
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

struct Cloud {
  std::vector<Eigen::Vector3d> n;
  std::vector<float> x, y, z;
};

/// Unit vectors: clusters of Gaussian spread about random axes, and a uniform rest.
Cloud cloud(std::uint32_t seed, const std::vector<int>& clusters, int rest, double spread_rad) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, 1);
  const auto direction = [&] {
    return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
  };
  Cloud made;
  for (const int size : clusters) {
    const Eigen::Vector3d axis = direction();
    for (int i = 0; i < size; ++i) {
      made.n.push_back(
          (axis + spread_rad * Eigen::Vector3d(normal(random), normal(random), normal(random)))
              .normalized());
    }
  }
  for (int i = 0; i < rest; ++i) made.n.push_back(direction());
  std::shuffle(made.n.begin(), made.n.end(), random);
  for (Eigen::Vector3d& n : made.n) {
    made.x.push_back(static_cast<float>(n.x()));
    made.y.push_back(static_cast<float>(n.y()));
    made.z.push_back(static_cast<float>(n.z()));
    n = {made.x.back(), made.y.back(), made.z.back()};
  }
  for (std::vector<float>* list : {&made.x, &made.y, &made.z}) {
    list->resize(made.n.size() + kPadding, std::nanf(""));
  }
  return made;
}

/// A kernel of the density, by d², and what weighs in its mean shift.
struct Profile {
  const char* name;
  double (*height)(double d2, double h);
  double (*pull)(double d2, double h);
  kernels::Mode (*find)(float* x, float* y, float* z, std::size_t count, float h, float least);
};
const Profile kProfiles[] = {
    {"Gaussian", [](double d2, double h) { return std::exp(-d2 / (2 * h * h)); },
     [](double d2, double h) { return std::exp(-d2 / (2 * h * h)); }, kernels::mean_shift},
    {"Epanechnikov", [](double d2, double h) { return std::max(0.0, 1 - d2 / (6 * h * h)); },
     [](double d2, double h) { return d2 < 6 * h * h ? 1.0 : 0.0; },
     kernels::mean_shift_epanechnikov}};

double density(const Profile& profile, const Cloud& votes, const Eigen::Vector3d& at, double h) {
  double sum = 0;
  for (const Eigen::Vector3d& n : votes.n) sum += profile.height((n - at).squaredNorm(), h);
  return sum;
}

/// The highest mode by mean shift from every vote, to convergence, in double.
std::pair<Eigen::Vector3d, double> brute_force(const Profile& profile, const Cloud& votes,
                                               double h) {
  std::pair<Eigen::Vector3d, double> best{Eigen::Vector3d::Zero(), 0};
  for (Eigen::Vector3d at : votes.n) {
    for (int step = 0; step < 500; ++step) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const Eigen::Vector3d& n : votes.n) {
        sum += profile.pull((n - at).squaredNorm(), h) * n;
      }
      const Eigen::Vector3d next = sum.normalized();
      if ((next - at).norm() < 1e-10) break;
      at = next;
    }
    const double height = density(profile, votes, at, h);
    if (height > best.second) best = {at, height};
  }
  return best;
}

TEST(MeanShift, FindsTheHighestModeOfBruteForceInDouble) {
  struct Case {
    std::vector<int> clusters;
    int rest;
    double spread_rad, h;
  };
  const std::vector<Case> cases = {{{24}, 0, 0.001, 0.01},     {{12}, 12, 0.004, 0.01},
                                   {{5}, 20, 0.003, 0.0067},   {{9, 7}, 15, 0.005, 0.015},
                                   {{30, 28}, 60, 0.01, 0.01}, {{2}, 1, 0.002, 0.01},
                                   {{60}, 300, 0.005, 0.0067}, {{1}, 0, 0.1, 0.01},
                                   {{16}, 0, 0.2, 0.3},        {{17, 17, 17}, 0, 0.01, 0.02}};
  for (std::uint32_t round = 0; round < 20; ++round) {
    const Profile& profile = kProfiles[round % 2];
    SCOPED_TRACE(profile.name);
    const std::uint32_t seed = round / 2;
    for (const Case& c : cases) {
      const Cloud made = cloud(seed, c.clusters, c.rest, c.spread_rad);
      const auto [normal, height] = brute_force(profile, made, c.h);
      for_each_target([&, truth = normal, most = height] {
        Cloud votes = made;
        const kernels::Mode mode = profile.find(votes.x.data(), votes.y.data(), votes.z.data(),
                                                votes.n.size(), static_cast<float>(c.h), 1.0F);
        const Eigen::Vector3d found(mode.x, mode.y, mode.z);
        EXPECT_NEAR(found.norm(), 1, 1e-5);
        // What it says is true …
        EXPECT_NEAR(mode.support, density(profile, votes, found, c.h), 2e-3 * most);
        // … and as high as the best: exactly where the votes are few enough to seed from all.
        EXPECT_GT(mode.support, (votes.n.size() <= 32 ? 0.995 : 0.9) * most)
            << "clusters " << c.clusters.size() << " of " << c.clusters[0] << ", seed " << seed;
        if (c.clusters.size() == 1 && c.clusters[0] > 4) {
          EXPECT_LT((found - truth).norm(), 0.05 * c.h);
        }
      });
    }
  }
}

TEST(Histogram, TheFullestCellSpeaks) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    const Cloud votes = cloud(seed, {static_cast<int>(seed) + 2, 9}, 120, 0.004);
    const double h = seed % 2 == 0 ? 0.01 : 0.05;
    // The same cells, counted in double: x + y + z = ±1 unfolded onto the square.
    std::map<std::pair<int, int>, std::vector<std::size_t>> cells;
    for (std::size_t i = 0; i < votes.n.size(); ++i) {
      const Eigen::Vector3d p = votes.n[i] / votes.n[i].cwiseAbs().sum();
      Eigen::Vector2d at = p.head<2>();
      if (p.z() < 0) {
        at = {(1 - std::abs(p.y())) * std::copysign(1.0, p.x()),
              (1 - std::abs(p.x())) * std::copysign(1.0, p.y())};
      }
      cells[{static_cast<int>((at.x() + 1) / (2 * h)), static_cast<int>((at.y() + 1) / (2 * h))}]
          .push_back(i);
    }
    std::size_t most = 0;
    for (const auto& [cell, list] : cells) most = std::max(most, list.size());
    std::vector<std::uint64_t> scratch(votes.n.size());
    const kernels::Mode mode =
        kernels::histogram_mode(votes.x.data(), votes.y.data(), votes.z.data(), votes.n.size(),
                                static_cast<float>(h), scratch.data());
    EXPECT_EQ(mode.support, static_cast<float>(most));
    const bool is_mean_of_a_fullest =
        std::any_of(cells.begin(), cells.end(), [&](const auto& cell) {
          Eigen::Vector3d sum = Eigen::Vector3d::Zero();
          for (const std::size_t i : cell.second) sum += votes.n[i];
          return cell.second.size() == most &&
                 (sum.normalized() - Eigen::Vector3d(mode.x, mode.y, mode.z)).norm() < 1e-5;
        });
    EXPECT_TRUE(is_mean_of_a_fullest);
  }
  EXPECT_EQ(kernels::histogram_mode(nullptr, nullptr, nullptr, 0, 0.01F, nullptr).support, 0);
}

TEST(MeanShift, NothingVotedGivesNothing) {
  std::vector<float> x(kPadding), y(kPadding), z(kPadding);
  EXPECT_EQ(kernels::mean_shift(x.data(), y.data(), z.data(), 0, 0.01F, 1.2F).support, 0);
}

/// A light map with holes and points around it, and the same look-ups in double.
class LookUp : public testing::Test {
 protected:
  static constexpr int kWidth = 61, kHeight = 47;
  static constexpr std::size_t kPoints = 333;

  void SetUp() override {
    std::mt19937 random(11);
    std::uniform_real_distribution<float> unit(0, 1);
    uv_.resize(2 * kWidth * kHeight);
    cells_.assign((kWidth * kHeight + 31) / 32, 0);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const std::size_t i = pixel(x, y);
        uv_[2 * i] = 100 + 17.0F * static_cast<float>(x) + unit(random);
        uv_[2 * i + 1] = 900 - 13.0F * static_cast<float>(y) + unit(random);
        if (x + 1 < kWidth && y + 1 < kHeight && unit(random) < 0.6F) {
          cells_[i / 32] |= 1u << (i % 32);
        }
      }
    }
    // Rows of pairs one after the other, a gap behind each: where they begin is free.
    for (int y = kHeight; y-- > 0;) {
      pairs_.insert(pairs_.end(), uv_.begin() + 2 * y * kWidth, uv_.begin() + 2 * (y + 1) * kWidth);
      pairs_.insert(pairs_.end(), 6, -1e6F);
      row_pair_.insert(row_pair_.begin(), (kHeight - 1 - y) * (kWidth + 3));
    }
    map_.uv_px = pairs_.data();
    map_.row_pair = row_pair_.data();
    map_.cells = cells_.data();
    map_.box_x = 200;
    map_.box_y = 300;
    map_.width = kWidth;
    map_.height = kHeight;
    const float origin[3] = {-250, 400, 150}, u[3] = {0.27F, 0.01F, 0}, v[3] = {0, 0.02F, -0.27F};
    const float eye[3] = {600, -30, 200};
    for (int axis = 0; axis < 3; ++axis) {
      map_.origin_mm[axis] = origin[axis];
      map_.u_mm[axis] = u[axis];
      map_.v_mm[axis] = v[axis];
      map_.eye_mm[axis] = eye[axis];
    }
    map_.min_cosine = 0.6F;
    projection_ = {{230, 6, -1, 0.5F, 0.02F, -0.01F, 0.004F, 0.003F, -0.02F, 0.01F},
                   {322, 0.4F, 5, -0.7F, 0.01F, 0.02F, -0.01F, 0.01F, 0.005F, -0.02F}};
    for (std::size_t i = 0; i < kPoints; ++i) {
      x_.push_back(14 * unit(random) - 7);
      y_.push_back(14 * unit(random) - 7);
      z_.push_back(14 * unit(random) - 7);
    }
    for (std::vector<float>* list : {&x_, &y_, &z_}) list->resize(kPoints + kPadding, 0);
  }

  static std::size_t pixel(int x, int y) {
    return static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x);
  }

  /// The hypothesis of a pixel for a point; none where the light map does not know.
  [[nodiscard]] std::optional<Eigen::Vector3d> reference(std::size_t i, double px,
                                                         double py) const {
    const double x = px - map_.box_x, y = py - map_.box_y;
    if (!(x >= 0 && y >= 0 && x < kWidth - 1 && y < kHeight - 1)) return std::nullopt;
    const int column = static_cast<int>(x), row = static_cast<int>(y);
    const std::size_t cell = pixel(column, row);
    if ((cells_[cell / 32] >> (cell % 32) & 1) == 0) return std::nullopt;
    const double fx = x - column, fy = y - row;
    Eigen::Vector2d uv = Eigen::Vector2d::Zero();
    for (const int dy : {0, 1}) {
      for (const int dx : {0, 1}) {
        const std::size_t at = 2 * (cell + pixel(dx, dy));
        uv += (dx == 1 ? fx : 1 - fx) * (dy == 1 ? fy : 1 - fy) *
              Eigen::Vector2d(uv_[at], uv_[at + 1]);
      }
    }
    const auto vector = [](const float* v) { return Eigen::Vector3d(v[0], v[1], v[2]); };
    const Eigen::Vector3d point(x_[i], y_[i], z_[i]);
    const Eigen::Vector3d q =
        vector(map_.origin_mm) + uv.x() * vector(map_.u_mm) + uv.y() * vector(map_.v_mm);
    const Eigen::Vector3d n = (q - point).normalized() + (vector(map_.eye_mm) - point).normalized();
    if (n.norm() / 2 < map_.min_cosine) return std::nullopt;
    return n.normalized();
  }

  std::vector<float> uv_, pairs_, x_, y_, z_;
  std::vector<std::int32_t> row_pair_;
  std::vector<std::uint32_t> cells_;
  kernels::MapView map_;
  kernels::LocalProjection projection_;
};

TEST_F(LookUp, EveryTargetGivesTheHypothesesOfDouble) {
  for_each_target([&] {
    std::vector<float> px(kPoints + kPadding), py(px), scratch(3 * px.size());
    kernels::project(projection_, x_.data(), y_.data(), z_.data(), kPoints, px.data(), py.data());
    std::vector<std::uint32_t> point(kPoints + kPadding);
    std::vector<float> nx(point.size()), ny(nx), nz(nx);
    const std::size_t found =
        kernels::look_up(map_, x_.data(), y_.data(), z_.data(), px.data(), py.data(), kPoints,
                         scratch.data(), {point.data(), nx.data(), ny.data(), nz.data()});
    std::size_t expected = 0;
    for (std::size_t i = 0; i < kPoints; ++i) {
      const double x = x_[i], y = y_[i], z = z_[i];
      const double term[10] = {1, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z};
      double wanted_x = 0, wanted_y = 0;
      for (int k = 0; k < 10; ++k) {
        wanted_x += double{projection_.x_px[k]} * term[k];
        wanted_y += double{projection_.y_px[k]} * term[k];
      }
      EXPECT_NEAR(px[i], wanted_x, 1e-3);
      EXPECT_NEAR(py[i], wanted_y, 1e-3);
      const auto n = reference(i, px[i], py[i]);
      if (!n) continue;
      ASSERT_LT(expected, found);
      EXPECT_EQ(point[expected], i);
      EXPECT_LT((Eigen::Vector3d(nx[expected], ny[expected], nz[expected]) - *n).norm(), 1e-6);
      ++expected;
    }
    EXPECT_EQ(found, expected);
    EXPECT_GT(found, 50u);
  });
}

/// The light map ends before the first pixels of its box: what fills vectors must not read there.
TEST_F(LookUp, ReadsNoPositionThatNoCellUses) {
  const std::size_t begin = kHeight / 2;  // rows above have no cell
  for (std::size_t cell = 0; cell < begin * kWidth; ++cell)
    cells_[cell / 32] &= ~(1U << (cell % 32));
  const std::vector<float> kept(uv_.begin() + static_cast<std::ptrdiff_t>(2 * begin * kWidth),
                                uv_.end());
  for (std::size_t y = 0; y < row_pair_.size(); ++y) {
    row_pair_[y] = (static_cast<int>(y) - static_cast<int>(begin)) * kWidth;
  }
  map_.uv_px = kept.data();
  for_each_target([&] {
    std::vector<float> px(kPoints + kPadding), py(px), scratch(3 * px.size());
    kernels::project(projection_, x_.data(), y_.data(), z_.data(), kPoints, px.data(), py.data());
    std::vector<std::uint32_t> point(kPoints + kPadding);
    std::vector<float> nx(point.size()), ny(nx), nz(nx);
    const std::size_t found =
        kernels::look_up(map_, x_.data(), y_.data(), z_.data(), px.data(), py.data(), kPoints,
                         scratch.data(), {point.data(), nx.data(), ny.data(), nz.data()});
    EXPECT_GT(found, 20U);
    for (std::size_t i = 0; i < found; ++i) {
      const auto n = reference(point[i], px[point[i]], py[point[i]]);
      ASSERT_TRUE(n);
      EXPECT_LT((Eigen::Vector3d(nx[i], ny[i], nz[i]) - *n).norm(), 1e-6);
    }
  });
}

TEST_F(LookUp, PaddingIsSeenByNoMap) {
  std::vector<float> px(kPoints + kPadding, 230), py(kPoints + kPadding, 322);
  kernels::project(projection_, x_.data(), y_.data(), z_.data(), kPoints, px.data(), py.data());
  for (std::size_t i = kPoints; i < px.size(); ++i) {
    EXPECT_LT(px[i], -1e8);
    EXPECT_LT(py[i], -1e8);
  }
}

}  // namespace
}  // namespace alhazen
