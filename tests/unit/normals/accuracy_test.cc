// From normals to meshes, held against the truth: a fast part of the experiments.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numbers>

#include "reconstruct/mesh/clean.h"
#include "reconstruct/normals/normal_map_file.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/surface/normal_integration.h"
#include "tests/experiment/normals_rows.h"
#include "tests/support/nobody.h"
#include "tests/support/views.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;
using testing::HasSubstr;

std::filesystem::path data_folder() {
  const char* told = std::getenv("ALHAZEN_DATA");
  return told != nullptr && *told != '\0'
             ? std::filesystem::path(told)
             : std::filesystem::path(ALHAZEN_SOURCE_DIR) / ".." / "shared" / "data";
}

/// A torus with exact normals, closed.
Mesh torus() {
  constexpr int kAround = 240, kAcross = 96;
  constexpr double kRing_mm = 25, kTube_mm = 10;
  Mesh mesh;
  for (int i = 0; i < kAround; ++i) {
    for (int j = 0; j < kAcross; ++j) {
      const double a = 2 * std::numbers::pi * i / kAround, b = 2 * std::numbers::pi * j / kAcross;
      const Vector3d n(std::cos(a) * std::cos(b), std::sin(a) * std::cos(b), std::sin(b));
      mesh.vertices_mm.push_back(Vector3d(0, 0, 51.2) +
                                 kRing_mm * Vector3d(std::cos(a), std::sin(a), 0) + kTube_mm * n);
      mesh.normals.push_back(n.cast<float>());
      const auto at = [](int u, int v) {
        return static_cast<std::uint32_t>(u % kAround * kAcross + v % kAcross);
      };
      mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return mesh;
}

TEST(NormalMaps, OfATorusGiveATorus) {
  const Mesh truth = torus();
  ASSERT_GT(check_closed(truth).volume_mm3, 0);
  experiment::NormalViews views;
  views.elevations_deg = {-25, 15, 60};
  views.stops = 8;
  views.pixel_mm = 0.8;
  views.level = 6;
  const auto rows =
      experiment::normals_of_mesh("torus", truth, views, Options::for_normal_maps(), {}, kNobody);
  ASSERT_TRUE(rows) << rows.error().text();
  const experiment::Row& row = (*rows)[0];
  EXPECT_TRUE(row["closed"].get<bool>());
  EXPECT_LT(row["median_voxels"].get<double>(), 0.05);
  EXPECT_LT(row["rms_all_mm"].get<double>(), 0.2);
  EXPECT_LT(row["mean_normal_deg"].get<double>(), 0.5);
  EXPECT_GT(row["observed_share"].get<double>(), 0.8);
}

/// Depth of a sphere on a plate from its normals: a step all around that must not bend either.
TEST(NormalIntegration, KeepsTheStepAroundASphere) {
  CameraModel camera;
  camera.name = "c0";
  camera.width_px = camera.height_px = 200;
  camera.fx_px = camera.fy_px = 1000;
  camera.cx_px = camera.cy_px = 99.5;
  const Vector3d centre(0, 0, 400);
  constexpr double kRadius_mm = 20, kPlate_mm = 420;
  NormalMap map;
  map.key = {0, "c0"};
  map.region = {0, 0, 200, 200};
  std::vector<double> truth;
  for (int y = 0; y < 200; ++y) {
    for (int x = 0; x < 200; ++x) {
      const Vector3d d = camera.direction(Eigen::Vector2d(x, y));
      const double along = d.dot(centre);
      const double inside = along * along - centre.squaredNorm() + kRadius_mm * kRadius_mm;
      map.label.push_back(NormalLabel::object);
      if (inside > 0) {
        const Vector3d p = (along - std::sqrt(inside)) * d;
        map.normal.push_back(((p - centre) / kRadius_mm).cast<float>().normalized());
        truth.push_back(p.z());
      } else {
        map.normal.emplace_back(0, 0, -1);
        truth.push_back(kPlate_mm);
      }
    }
  }
  // The plate is flat, and the sphere is one: both by themselves, for how far the step goes no
  // normal says.
  const auto errors_mm = [&](double sharpness) {
    IntegrationOptions options;
    options.sharpness = sharpness;
    const auto found = integrate_normals(map, camera, kPlate_mm, options, kNobody);
    EXPECT_TRUE(found) << found.error().text();
    double plate_worst = 0, sphere_squares = 0, sphere_mean = 0, count = 0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const double error = static_cast<double>(found->depth_mm[i]) - truth[i];
      if (truth[i] == kPlate_mm) {
        plate_worst = std::max(plate_worst, std::abs(error));
      } else if (map.normal[i].z() < -0.3F) {
        sphere_mean += error;
        sphere_squares += error * error;
        ++count;
      }
    }
    sphere_mean /= count;
    return std::pair(plate_worst, std::sqrt(sphere_squares / count - sphere_mean * sphere_mean));
  };
  const auto [plate_mm, sphere_mm] = errors_mm(2);
  const auto [bent_plate_mm, bent_sphere_mm] = errors_mm(0);
  std::printf("plate %.3f mm, sphere %.3f mm; in one piece %.3f and %.3f mm\n", plate_mm, sphere_mm,
              bent_plate_mm, bent_sphere_mm);
  EXPECT_LT(plate_mm, 0.1);
  EXPECT_LT(sphere_mm, 0.3);
  EXPECT_LE(plate_mm, bent_plate_mm);

  EXPECT_FALSE(integrate_normals(map, camera, -1, {}, kNobody));
  EXPECT_FALSE(integrate_normals(map, camera, 400, {.sharpness = -1}, kNobody));
  map.normal.pop_back();
  EXPECT_FALSE(integrate_normals(map, camera, 400, {}, kNobody));
}

class RealStereo : public testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(data_folder() / "ps_uw")) {
      GTEST_SKIP() << "no real pictures: " << data_folder() / "ps_uw"
                   << " is missing (ALHAZEN_DATA)";
    }
  }
};

TEST_F(RealStereo, MatteBallIsNearerToItsOutlineThanPlainLeastSquares) {
  const auto rows = experiment::real_photometric_stereo(data_folder(), {"gray"}, {}, kNobody);
  ASSERT_TRUE(rows) << rows.error().text();
  double plain_deg = 0, ours_deg = 0;
  for (const experiment::Row& row : *rows) {
    if (row["experiment"] == "photometric_stereo gray, plain") plain_deg = row["mean_deg"];
    if (row["experiment"] == "photometric_stereo gray") ours_deg = row["mean_deg"];
  }
  std::printf("matte ball: %.2f degrees, plain least squares %.2f\n", ours_deg, plain_deg);
  EXPECT_GT(plain_deg, 5.0);
  EXPECT_LT(ours_deg, 5.0);
  EXPECT_GT(ours_deg, 0.1);
}

}  // namespace
}  // namespace alhazen
