#include "reconstruct/geometry/rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <opencv2/calib3d.hpp>
#include <random>

namespace alhazen {
namespace {

using ::testing::HasSubstr;

CameraModel some_camera() {
  CameraModel camera;
  camera.name = "c0";
  camera.width_px = 2048;
  camera.height_px = 1536;
  camera.fx_px = 4300.25;
  camera.fy_px = 4299.5;
  camera.cx_px = 1021.3;
  camera.cy_px = 770.7;
  camera.distortion = {-0.11, 0.07, 0.0004, -0.0007, 0.01, 0.02, -0.01, 0.003};
  camera.camera_from_rig = {
      Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -0.5).normalized()).toRotationMatrix(),
      {10, -20, 650}};
  return camera;
}

Rig some_rig() {
  Rig rig;
  rig.cameras = {some_camera()};
  DisplayModel display;
  display.name = "side";
  display.width_px = 1920;
  display.height_px = 1080;
  display.origin_mm = {300, -250, 400};
  display.u_mm = {0, 0.27, 0};
  display.v_mm = {0, 0, -0.27};
  display.mount = Mount::turntable;
  rig.displays = {display};
  rig.turntable.point_mm = {0.125, -0.3, 0};
  return rig;
}

/// The same camera in the hands of OpenCV: an independent implementation of the model.
Eigen::Vector2d opencv_pixel(const CameraModel& camera, const Eigen::Vector3d& p_camera_mm) {
  const cv::Mat k = (cv::Mat_<double>(3, 3) << camera.fx_px, 0, camera.cx_px, 0, camera.fy_px,
                     camera.cy_px, 0, 0, 1);
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(std::vector<cv::Point3d>{{p_camera_mm.x(), p_camera_mm.y(), p_camera_mm.z()}},
                    cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), k,
                    std::vector<double>(camera.distortion.begin(), camera.distortion.end()),
                    pixels);
  return {pixels[0].x, pixels[0].y};
}

TEST(CameraModel, ProjectsAsOpenCvDoes) {
  const CameraModel camera = some_camera();
  std::mt19937 random(7);
  std::uniform_real_distribution<double> across(-150, 150);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d p(across(random), across(random), 600 + across(random));
    ASSERT_NEAR((*camera.project(p) - opencv_pixel(camera, p)).norm(), 0, 1e-9);
  }
}

TEST(CameraModel, DirectionInvertsProject) {
  const CameraModel camera = some_camera();
  for (double x = 0; x < 2048; x += 127)
    for (double y = 0; y < 1536; y += 101) {
      const Eigen::Vector3d ray = camera.direction({x, y});
      ASSERT_NEAR(ray.norm(), 1, 1e-12);
      ASSERT_NEAR((*camera.project(ray * 500) - Eigen::Vector2d(x, y)).norm(), 0, 1e-9);
    }
}

TEST(CameraModel, SlopeIsTheDerivativeOfProject) {
  const CameraModel camera = some_camera();
  std::mt19937 random(8);
  std::uniform_real_distribution<double> across(-150, 150);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p(across(random), across(random), 600 + across(random));
    const auto seen = camera.project_with_slope(p);
    ASSERT_TRUE(seen);
    ASSERT_NEAR((seen->pixel - *camera.project(p)).norm(), 0, 1e-9);
    constexpr double kStepMm = 1e-3;
    for (int axis = 0; axis < 3; ++axis) {
      const Eigen::Vector3d step = kStepMm * Eigen::Vector3d::Unit(axis);
      const Eigen::Vector2d central =
          (*camera.project(p + step) - *camera.project(p - step)) / (2 * kStepMm);
      ASSERT_NEAR((seen->slope.col(axis) - central).norm(), 0, 1e-7);
    }
  }
  EXPECT_FALSE(camera.project_with_slope({0, 0, -1}));
}

TEST(CameraModel, NothingBehindTheCameraHasAPixel) {
  EXPECT_FALSE(some_camera().project({0, 0, -1}));
  EXPECT_FALSE(some_camera().project({0, 0, 0}));
}

TEST(CameraModel, TheCentreIsWhereEveryRayStarts) {
  const CameraModel camera = some_camera();
  EXPECT_NEAR((camera.camera_from_rig * camera.centre_rig_mm()).norm(), 0, 1e-9);
}

TEST(TableModel, TurnsRightHandedAboutItsAxis) {
  TableModel table;
  table.point_mm = {1, 0, 0};
  const Pose quarter = table.rig_from_object(std::numbers::pi / 2);
  // Counter-clockwise seen from the tip of +z: x goes to y, about the line through (1, 0, 0).
  EXPECT_NEAR((quarter * Eigen::Vector3d(2, 0, 5) - Eigen::Vector3d(1, 1, 5)).norm(), 0, 1e-12);
  EXPECT_NEAR((quarter * Eigen::Vector3d(1, 0, -3) - Eigen::Vector3d(1, 0, -3)).norm(), 0, 1e-12);
}

TEST(DisplayModel, TheLitSideFacesTheViewer) {
  // A screen at x = 300 looked at from the origin: right is -y, down is -z, so inward is +x.
  DisplayModel display;
  display.origin_mm = {300, 100, 100};
  display.u_mm = {0, -0.25, 0};
  display.v_mm = {0, 0, -0.25};
  EXPECT_NEAR((display.inward() - Eigen::Vector3d::UnitX()).norm(), 0, 1e-12);
  EXPECT_NEAR((display.point_mm(4, 8) - Eigen::Vector3d(300, 99, 98)).norm(), 0, 1e-12);
}

TEST(Rig, JsonGivesEveryNumberBack) {
  const Rig rig = some_rig();
  const auto again = Rig::parse(rig.to_json());
  ASSERT_TRUE(again) << again.error().text();
  EXPECT_EQ(again->to_json(), rig.to_json());
  EXPECT_EQ(again->hash(), rig.hash());
  EXPECT_EQ(again->cameras[0].camera_from_rig.rotation, rig.cameras[0].camera_from_rig.rotation);
  EXPECT_EQ(again->displays[0].mount, Mount::turntable);
  ASSERT_NE(again->camera("c0"), nullptr);
  EXPECT_EQ(again->camera("c1"), nullptr);
}

TEST(Rig, NormalMapsNeedNoDisplayButACamera) {
  Rig rig = some_rig();
  rig.displays.clear();
  const auto again = Rig::parse(rig.to_json());
  ASSERT_TRUE(again) << again.error().text();
  EXPECT_TRUE(again->displays.empty());
  rig.cameras.clear();
  const auto blind = Rig::parse(rig.to_json());
  ASSERT_FALSE(blind);
  EXPECT_THAT(blind.error().text(), testing::HasSubstr("rig.cameras"));
}

TEST(Rig, AnyChangeChangesTheHash) {
  Rig rig = some_rig();
  const std::string before = rig.hash();
  rig.turntable.point_mm.x() += 1e-12;
  EXPECT_NE(rig.hash(), before);
}

struct BadRig {
  std::string what;
  std::string from, to;  // a replacement in the text of a good rig
  std::string says;
};

class BadRigs : public ::testing::TestWithParam<BadRig> {};

TEST_P(BadRigs, AreRefusedByName) {
  std::string text = some_rig().to_json();
  const auto at = text.find(GetParam().from);
  ASSERT_NE(at, std::string::npos) << GetParam().from << "\n" << text;
  text.replace(at, GetParam().from.size(), GetParam().to);
  const auto rig = Rig::parse(text);
  ASSERT_FALSE(rig);
  EXPECT_EQ(rig.error().code, Code::invalid);
  EXPECT_THAT(rig.error().what, HasSubstr(GetParam().says));
}

INSTANTIATE_TEST_SUITE_P(
    All, BadRigs,
    ::testing::Values(
        BadRig{"not_json", "{", "[", "rig.json"},
        BadRig{"unknown_key", "\"mount\"", "\"mounted\"", "unknown key 'rig.displays[0].mounted'"},
        BadRig{"wrong_mount", "\"turntable\"", "\"ceiling\"", "\"rig\" or \"turntable\""},
        BadRig{"zero_width", "\"width_px\": 2048", "\"width_px\": 0", "[1, 65535]"},
        BadRig{"fractional_width", "\"width_px\": 2048", "\"width_px\": 2048.5", "[1, 65535]"},
        BadRig{"huge_width", "\"width_px\": 2048", "\"width_px\": 1e300", "[1, 65535]"},
        BadRig{"no_name", "\"name\": \"c0\"", "\"name\": \"\"", "1 to 32 characters"},
        BadRig{"name_climbs", "\"name\": \"c0\"", "\"name\": \"../c0\"", "1 to 32 characters"},
        BadRig{"not_a_number", "4300.25", "null", "rig.cameras[0].K' must be a number"},
        BadRig{"mirrored_focal_length", "4300.25", "-4300.25", "fx and fy above 0"},
        BadRig{"flat_display", "-0.27", "0.0", "not parallel"},
        BadRig{"long_axis", "\"direction\": [\n   0.0,\n   0.0,\n   1.0", "\"direction\": [0, 0, 2",
               "a unit vector"}),
    [](const auto& named) { return named.param.what; });

TEST(Rig, AMirroredCameraPoseIsRefused) {
  Rig rig = some_rig();
  rig.cameras[0].camera_from_rig.rotation.col(0) *= -1;
  const auto parsed = Rig::parse(rig.to_json());
  ASSERT_FALSE(parsed);
  EXPECT_THAT(parsed.error().what, HasSubstr("right-handed"));
}

TEST(Rig, EqualNamesAreRefused) {
  Rig rig = some_rig();
  rig.cameras.push_back(rig.cameras[0]);
  const auto parsed = Rig::parse(rig.to_json());
  ASSERT_FALSE(parsed);
  EXPECT_THAT(parsed.error().what, HasSubstr("'c0' is there twice"));
}

TEST(Rig, AMissingFileIsNamed) {
  const auto rig = Rig::load("/nowhere/rig.json");
  ASSERT_FALSE(rig);
  EXPECT_EQ(rig.error().code, Code::unavailable);
  EXPECT_THAT(rig.error().what, HasSubstr("/nowhere/rig.json"));
}

}  // namespace
}  // namespace alhazen
