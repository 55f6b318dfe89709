#include "reconstruct/normals/photometric_stereo.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "tests/support/nobody.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;
using testing::HasSubstr;

constexpr int kBallSide_px = 61;
constexpr double kBallRadius_px = 28;

/// Truth about the pixels of a sphere seen from afar.
struct Ball {
  std::vector<Vector3d> normal;
  std::vector<std::uint8_t> mask;
};

Ball ball() {
  Ball made;
  for (int y = 0; y < kBallSide_px; ++y) {
    for (int x = 0; x < kBallSide_px; ++x) {
      const double u = (x - (kBallSide_px - 1) / 2.0) / kBallRadius_px;
      const double v = (y - (kBallSide_px - 1) / 2.0) / kBallRadius_px;
      const double inside = 1 - u * u - v * v;
      made.mask.push_back(inside > 0 ? 1 : 0);
      made.normal.push_back(inside > 0 ? Vector3d(u, v, -std::sqrt(inside))
                                       : Vector3d(Vector3d::Zero()));
    }
  }
  return made;
}

/// Lights on a ring about the viewer, and one from there.
std::vector<Light> ring(int count, double off_rad) {
  std::vector<Light> lights(1);
  for (int k = 1; k < count; ++k) {
    const double turn = 2 * std::numbers::pi * k / (count - 1);
    lights.push_back({{std::sin(off_rad) * std::cos(turn), std::sin(off_rad) * std::sin(turn),
                       -std::cos(off_rad)},
                      false,
                      1});
  }
  return lights;
}

/// Lambertian pictures with attached shadows; `gloss`: a sharp lobe on top.
LightStack shaded(const Ball& truth, const std::vector<Light>& lights, double gloss) {
  LightStack stack;
  stack.width = stack.height = kBallSide_px;
  stack.lights = lights;
  stack.mask = truth.mask;
  for (const Light& light : lights) {
    const Vector3d l = light.vector.normalized();
    std::vector<float>& picture = stack.intensity.emplace_back(truth.mask.size(), 0.0F);
    for (std::size_t i = 0; i < picture.size(); ++i) {
      const Vector3d& n = truth.normal[i];
      const double cosine = n.dot(l);
      if (truth.mask[i] == 0 || cosine <= 0) continue;
      const double half = std::max(0.0, n.dot((l + Vector3d(0, 0, -1)).normalized()));
      picture[i] = static_cast<float>(
          std::min(1.0, light.intensity * (0.5 * cosine + gloss * std::pow(half, 80))));
    }
  }
  return stack;
}

/// Mean angle to the truth, degrees, and how many pixels have a normal.
std::pair<double, std::size_t> error_of(const StereoMap& found, const Ball& truth) {
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < truth.mask.size(); ++i) {
    if (found.map.label[i] != NormalLabel::object) continue;
    const Vector3d n = found.map.normal[i].cast<double>();
    sum += std::atan2(n.cross(truth.normal[i]).norm(), n.dot(truth.normal[i]));
    ++count;
  }
  return {sum / static_cast<double>(count) * 180 / std::numbers::pi, count};
}

TEST(PhotometricStereo, IsExactOnALambertianSphereInSpiteOfShadows) {
  const Ball truth = ball();
  const auto found = photometric_stereo(shaded(truth, ring(12, 0.8), 0), {}, kNobody);
  ASSERT_TRUE(found) << found.error().text();
  const auto [mean_deg, count] = error_of(*found, truth);
  EXPECT_LT(mean_deg, 1e-3);
  EXPECT_GT(count, 2000U);
  for (std::size_t i = 0; i < truth.mask.size(); ++i) {
    if (truth.mask[i] == 0) {
      EXPECT_EQ(found->map.label[i], NormalLabel::background);
    } else if (found->map.label[i] == NormalLabel::object) {
      EXPECT_NEAR(found->albedo[i], 0.5F, 1e-4F);
      EXPECT_LT(found->residual[i], 1e-3F);
    }
  }
}

TEST(PhotometricStereo, PlaneUnderKnownLightsComesOutTilted) {
  Ball plane;
  plane.mask.assign(kBallSide_px * kBallSide_px, 1);
  plane.normal.assign(plane.mask.size(), Vector3d(0.3, -0.2, -1).normalized());
  const auto found = photometric_stereo(shaded(plane, ring(8, 0.5), 0), {}, kNobody);
  ASSERT_TRUE(found) << found.error().text();
  const auto [mean_deg, count] = error_of(*found, plane);
  EXPECT_LT(mean_deg, 1e-3);
  EXPECT_EQ(count, plane.mask.size());
}

TEST(PhotometricStereo, RejectsGlossThatMisleadsLeastSquares) {
  const Ball truth = ball();
  const LightStack stack = shaded(truth, ring(30, 0.7), 0.6);
  StereoOptions plain;
  plain.rounds = 0;
  plain.dark_share = plain.bright_share = 0;
  const auto by_least_squares = photometric_stereo(stack, plain, kNobody);
  const auto robust = photometric_stereo(stack, {}, kNobody);
  ASSERT_TRUE(by_least_squares && robust);
  EXPECT_GT(error_of(*by_least_squares, truth).first, 1.0);
  EXPECT_LT(error_of(*robust, truth).first, 0.4);
}

TEST(PhotometricStereo, BelievesItsOwnStandardDeviation) {
  const Ball truth = ball();
  LightStack stack = shaded(truth, ring(12, 0.6), 0);
  std::mt19937 random(5);
  std::normal_distribution<float> noise(0, 0.01F);
  for (auto& picture : stack.intensity) {
    for (float& value : picture) value += noise(random);
  }
  const auto found = photometric_stereo(stack, {}, kNobody);
  ASSERT_TRUE(found);
  double z2 = 0, count = 0;
  for (std::size_t i = 0; i < truth.mask.size(); ++i) {
    // Where every light shines, no shadow edge adds to the noise.
    if (found->map.label[i] != NormalLabel::object || truth.normal[i].z() > -0.8) continue;
    const double turn = (found->map.normal[i].cast<double>() - truth.normal[i]).norm();
    z2 += turn * turn / (2 * found->sigma_rad[i] * found->sigma_rad[i]);
    ++count;
  }
  EXPECT_NEAR(std::sqrt(z2 / count), 1, 0.35);
  EXPECT_GT(found->map.noise_rad, 0.002);
  EXPECT_LT(found->map.noise_rad, 0.05);
}

TEST(PhotometricStereo, NearLightsShineFromWhereTheyStand) {
  // A tilted plane 300 mm away, lights 250 mm beside and before it.
  const Vector3d n = Vector3d(0.2, 0.1, -1).normalized();
  LightStack stack;
  stack.width = stack.height = kBallSide_px;
  stack.mask.assign(kBallSide_px * kBallSide_px, 1);
  for (int y = 0; y < kBallSide_px; ++y) {
    for (int x = 0; x < kBallSide_px; ++x) {
      stack.point_mm.emplace_back(static_cast<float>(2 * (x - 30)),
                                  static_cast<float>(2 * (y - 30)), 300.0F);
    }
  }
  for (int k = 0; k < 8; ++k) {
    const double turn = k * std::numbers::pi / 4;
    stack.lights.push_back(
        {{200 * std::cos(turn), 200 * std::sin(turn), 60.0 + 10 * (k % 3)}, true, 1});
    std::vector<float>& picture = stack.intensity.emplace_back();
    const Vector3d& at = stack.lights.back().vector;
    const double reach2 = (at - Vector3d(0, 0, 300)).squaredNorm();
    for (const Eigen::Vector3f& p : stack.point_mm) {
      const Vector3d away = at - p.cast<double>();
      picture.push_back(static_cast<float>(0.4 * std::max(0.0, n.dot(away.normalized())) * reach2 /
                                           away.squaredNorm()));
    }
  }
  const auto found = photometric_stereo(stack, {}, kNobody);
  ASSERT_TRUE(found) << found.error().text();
  Ball truth;
  truth.mask = stack.mask;
  truth.normal.assign(truth.mask.size(), n);
  EXPECT_LT(error_of(*found, truth).first, 1e-3);
  EXPECT_NEAR(found->albedo[30 * kBallSide_px + 30], 0.4F, 1e-3F);

  stack.point_mm.clear();
  EXPECT_THAT(photometric_stereo(stack, {}, kNobody).error().what, HasSubstr("near light"));
}

TEST(MirrorBall, TellsTheLightsByItsHighlights) {
  const Ball truth = ball();
  const std::vector<Light> lights = ring(9, 0.9);
  std::vector<std::vector<float>> pictures;
  for (const Light& light : lights) {
    std::vector<float>& picture = pictures.emplace_back(truth.mask.size(), 0.02F);
    for (std::size_t i = 0; i < picture.size(); ++i) {
      const Vector3d& n = truth.normal[i];
      if (truth.mask[i] == 0) continue;
      const Vector3d mirrored = 2 * n.dot(Vector3d(0, 0, -1)) * n - Vector3d(0, 0, -1);
      picture[i] += static_cast<float>(
          0.95 * std::exp(-20 * (mirrored - light.vector.normalized()).squaredNorm()));
    }
  }
  const auto found = lights_of_mirror_ball(kBallSide_px, kBallSide_px, pictures, truth.mask);
  ASSERT_TRUE(found) << found.error().text();
  for (std::size_t k = 0; k < lights.size(); ++k) {
    EXPECT_LT(((*found)[k].vector.normalized() - lights[k].vector.normalized()).norm(), 0.03) << k;
  }
  pictures[4].assign(truth.mask.size(), 0.0F);
  EXPECT_THAT(lights_of_mirror_ball(kBallSide_px, kBallSide_px, pictures, truth.mask).error().what,
              HasSubstr("picture 4"));
}

TEST(PhotometricStereo, RefusesWhatCannotBe) {
  const Ball truth = ball();
  const LightStack good = shaded(truth, ring(12, 0.8), 0);
  const auto refused = [&](const auto& spoil, const StereoOptions& options = {}) {
    LightStack stack = good;
    spoil(stack);
    const auto found = photometric_stereo(stack, options, kNobody);
    EXPECT_FALSE(found);
    EXPECT_EQ(found.error().code, Code::invalid);
    return found.error().what;
  };
  const auto nothing = [](LightStack&) {};
  EXPECT_THAT(refused([](LightStack& s) { s.lights.resize(2); }), HasSubstr("2 lights"));
  EXPECT_THAT(refused([](LightStack& s) { s.intensity.pop_back(); }), HasSubstr("11 pictures"));
  EXPECT_THAT(refused([](LightStack& s) { s.intensity[3].pop_back(); }), HasSubstr("light 3"));
  EXPECT_THAT(refused([](LightStack& s) { s.mask.pop_back(); }), HasSubstr("mask"));
  EXPECT_THAT(refused([](LightStack& s) { std::fill(s.mask.begin(), s.mask.end(), 0); }),
              HasSubstr("no object pixel"));
  EXPECT_THAT(refused([](LightStack& s) { s.lights[5].vector.setZero(); }), HasSubstr("light 5"));
  EXPECT_THAT(refused([](LightStack& s) { s.lights[5].intensity = -1; }), HasSubstr("intensity"));
  EXPECT_THAT(refused([](LightStack& s) {
                s.intensity[2][30 * kBallSide_px + 30] = std::numeric_limits<float>::quiet_NaN();
              }),
              HasSubstr("not finite"));
  EXPECT_THAT(refused([](LightStack& s) {
                for (Light& light : s.lights) light.vector = {0, 0, -1};
              }),
              HasSubstr("no pixel has enough lights"));
  StereoOptions wild;
  wild.dark_share = 1.5;
  EXPECT_THAT(refused(nothing, wild), HasSubstr("stereo.dark_share"));
  wild = {};
  wild.min_lights = 2;
  EXPECT_THAT(refused(nothing, wild), HasSubstr("stereo.min_lights"));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(photometric_stereo(good, {}, alhazen::Run{stop.get_token(), {}}).error().code,
            Code::cancelled);
}

}  // namespace
}  // namespace alhazen
