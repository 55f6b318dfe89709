#include "drivers/sim/lens.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <string>
#include <vector>

#include "drivers/sim/calibrated_rig.h"
#include "drivers/sim/scene.h"
#include "reconstruct/geometry/rig.h"

namespace alhazen::sim {
namespace {

const Lens kLens{2000, 2010, 310, 250, {-0.2, 0.1, 0.001, -0.002, 0.03, 0.01, -0.02, 0.005}};

TEST(Lens, AgreesWithOpenCv) {
  const cv::Mat camera = (cv::Mat_<double>(3, 3) << 2000, 0, 310, 0, 2010, 250, 0, 0, 1);
  const std::vector<double> k(kLens.k.begin(), kLens.k.end());
  for (const Vec3& p :
       {Vec3(0, 0, 600), Vec3(80, -40, 650), Vec3(-110, 90, 500), Vec3(150, 120, 700)}) {
    std::vector<cv::Point2d> pixel;
    cv::projectPoints(std::vector<cv::Point3d>{{p.x(), p.y(), p.z()}}, cv::Vec3d(0, 0, 0),
                      cv::Vec3d(0, 0, 0), camera, k, pixel);
    const Vec2 ours = kLens.project(p);
    EXPECT_NEAR(ours.x(), pixel[0].x, 1e-9);
    EXPECT_NEAR(ours.y(), pixel[0].y, 1e-9);
  }
}

TEST(Lens, FindsThePointThatAPixelSees) {
  for (double y = -0.5; y < 500; y += 83)
    for (double x = -0.5; x < 620; x += 77) {
      const Vec2 plane = kLens.plane_point({x, y});
      const Vec2 back = kLens.project(Vec3(plane.x(), plane.y(), 1));
      EXPECT_NEAR(back.x(), x, 1e-8);
      EXPECT_NEAR(back.y(), y, 1e-8);
      // From anywhere nearby, the same.
      EXPECT_LT((kLens.plane_point({x, y}, plane + Vec2(0.01, -0.02)) - plane).norm(), 1e-12);
    }
}

// The reconstruction's geometry is another implementation: both must see the same rig alike.
TEST(CalibratedRig, IsReadAsTheWorldThatItDescribes) {
  const auto scene =
      Scene::load(std::filesystem::path(ALHAZEN_SOURCE_DIR) / "config/worlds/sphere.toml");
  ASSERT_TRUE(scene) << scene.error().text();
  const auto rig = Rig::parse(calibrated_rig(*scene, {}));
  ASSERT_TRUE(rig) << rig.error().text();
  ASSERT_EQ(rig->cameras.size(), scene->cameras.size());
  for (std::size_t i = 0; i < rig->cameras.size(); ++i)
    for (const Vec3& p : {Vec3(0, 0, 0), Vec3(20, -30, 50), Vec3(-40, 10, 25)}) {
      const auto theirs = rig->cameras[i].project(rig->cameras[i].camera_from_rig * p);
      ASSERT_TRUE(theirs);
      const Vec2 ours = scene->cameras[i].lens.project(scene->cameras[i].camera_from_rig * p);
      EXPECT_LT((*theirs - ours).norm(), 1e-8) << "camera " << i;
    }
  for (std::size_t i = 0; i < rig->displays.size(); ++i) {
    const DisplayTruth& truth = scene->displays[i];
    EXPECT_LT(
        (rig->displays[i].point_mm(7, 9) - (truth.origin_mm + 7 * truth.u_mm + 9 * truth.v_mm))
            .norm(),
        1e-9);
    // The lit side looks at the object.
    EXPECT_GT(rig->displays[i].inward().dot(rig->displays[i].point_mm(900, 500)), 0);
  }
}

TEST(CalibratedRig, ErrsAsStatedAndTheSameForOneSeed) {
  const auto scene =
      Scene::load(std::filesystem::path(ALHAZEN_SOURCE_DIR) / "config/worlds/sphere.toml");
  ASSERT_TRUE(scene);
  const CalibrationError error{0.05, 0.1, 0.02 * 0.01745, 0.005, 3};
  EXPECT_EQ(calibrated_rig(*scene, error), calibrated_rig(*scene, error));
  const auto rig = Rig::parse(calibrated_rig(*scene, error));
  ASSERT_TRUE(rig) << rig.error().text();
  double square_px = 0;
  for (std::size_t i = 0; i < rig->cameras.size(); ++i) {
    const CameraTruth& truth = scene->cameras[i];
    const Vec3 p(5, 5, 25);
    square_px += (*rig->cameras[i].project(rig->cameras[i].camera_from_rig * p) -
                  truth.lens.project(truth.camera_from_rig * p))
                     .squaredNorm();
  }
  const double rms_px = std::sqrt(square_px / 2 / static_cast<double>(rig->cameras.size()));
  EXPECT_GT(rms_px, 0.02);
  EXPECT_LT(rms_px, 0.12);
  EXPECT_NE(calibrated_rig(*scene, error),
            calibrated_rig(*scene, {0.05, 0.1, 0.02 * 0.01745, 0.005, 4}));
}

}  // namespace
}  // namespace alhazen::sim
