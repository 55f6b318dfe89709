#include "reconstruct/exchange/camera_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <random>
#include <sstream>

#include "tests/unit/scan/temporary_folder.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

CameraModel some_camera(const std::string& name, double turn_rad) {
  CameraModel camera;
  camera.name = name;
  camera.width_px = 2048;
  camera.height_px = 1536;
  camera.fx_px = 4300.25;
  camera.fy_px = 4299.5;
  camera.cx_px = 1021.3;
  camera.cy_px = 770.7;
  camera.distortion = {-0.11, 0.07, 0.0004, -0.0007, 0.01, 0.02, -0.01, 0.003};
  camera.camera_from_rig = {
      Eigen::AngleAxisd(turn_rad, Eigen::Vector3d(1, 2, -0.5).normalized()).toRotationMatrix(),
      {10, -20, 650}};
  return camera;
}

cv::Mat matrix_of(const CameraModel& camera) {
  return (cv::Mat_<double>(3, 3) << camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0,
          0, 1);
}

/// A point of the rig frame, projected by OpenCV.
Eigen::Vector2d opencv_pixel(const cv::Mat& k, const std::vector<double>& distortion,
                             const cv::Vec3d& rvec, const cv::Vec3d& tvec,
                             const Eigen::Vector3d& p) {
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(std::vector<cv::Point3d>{{p.x(), p.y(), p.z()}}, rvec, tvec, k, distortion,
                    pixels);
  return {pixels[0].x, pixels[0].y};
}

std::vector<Eigen::Vector3d> some_points() {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> across(-60, 60);
  std::vector<Eigen::Vector3d> points;
  points.reserve(100);
  for (int i = 0; i < 100; ++i) points.emplace_back(across(random), across(random), across(random));
  return points;
}

/// Each of cv::FileStorage's formats, with its own keys, poses and sizes.
class FileStorageFormats : public ::testing::TestWithParam<const char*> {};

TEST_P(FileStorageFormats, AreReadAsOpenCvMeansThem) {
  const TemporaryFolder folder;
  const CameraModel camera = some_camera("left", 0.7);
  const std::string file = (folder.path() / ("left" + std::string(GetParam()))).string();
  const cv::Mat distortion(1, 8, CV_64F, const_cast<double*>(camera.distortion.data()));
  const cv::Vec3d rvec(0.3, -0.2, 1.1), tvec(0.01, -0.02, 0.65);  // metres
  {
    cv::FileStorage out(file, cv::FileStorage::WRITE);
    out.writeComment("a comment: with a colon # and more");
    out << "calibration_time"
        << "Sun Nov 22 10:00:00 2026";
    out << "image_width" << camera.width_px << "image_height" << camera.height_px;
    out << "flags" << 0 << "names" << std::vector<std::string>{"a.png", "b c.png"};
    out << "camera_matrix" << matrix_of(camera) << "distortion_coefficients" << distortion;
    out << "rvec" << cv::Mat(rvec) << "tvec" << cv::Mat(tvec);
    out << "nested"
        << "{"
        << "x" << 1 << "list"
        << "[" << 1 << 2 << "]"
        << "}";
  }
  const auto read = read_cameras(file, 1000);
  ASSERT_TRUE(read) << read.error().text();
  ASSERT_EQ(read->size(), 1U);
  const ForeignCamera& got = read->front();
  EXPECT_EQ(got.model.name, "left");
  EXPECT_TRUE(got.has_size && got.has_pose);
  EXPECT_EQ(got.model.width_px, 2048);
  EXPECT_EQ(got.model.height_px, 1536);
  EXPECT_EQ(got.model.fx_px, camera.fx_px);
  EXPECT_EQ(got.model.distortion, camera.distortion);
  const std::vector<double> d(camera.distortion.begin(), camera.distortion.end());
  for (const Eigen::Vector3d& p : some_points()) {
    const Eigen::Vector2d truth = opencv_pixel(matrix_of(camera), d, rvec, tvec * 1000, p);
    EXPECT_LT((*got.model.project(got.model.camera_from_rig * p) - truth).norm(), 1e-8);
  }
}

INSTANTIATE_TEST_SUITE_P(All, FileStorageFormats, ::testing::Values(".yml", ".xml", ".json"),
                         [](const auto& named) { return std::string(named.param + 1); });

TEST(OpenCvCamera, OtherManners) {
  const auto read = [](const char* text, const char* suffix = "") {
    auto camera = parse_opencv_camera(text, suffix, 1);
    EXPECT_TRUE(camera) << camera.error().text();
    return *camera;
  };
  // ROS's camera_info.
  const ForeignCamera ros = read(
      "image_width: 640\nimage_height: 480\ncamera_name: head\ncamera_matrix:\n  rows: 3\n"
      "  cols: 3\n  data: [500.5, 0.0, 320.25,\n         0.0, 501, 240.5, 0.0, 0.0, 1.0]\n"
      "distortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: "
      "[-0.1, 0.02, 0.001, -0.002, 0]}\n");
  EXPECT_EQ(ros.model.fx_px, 500.5);
  EXPECT_EQ(ros.model.cy_px, 240.5);
  EXPECT_EQ(ros.model.distortion[3], -0.002);
  EXPECT_EQ(ros.model.width_px, 640);
  EXPECT_FALSE(ros.has_pose);
  // Lists in lists, block lists, no size.
  const ForeignCamera lists = read(
      "K:\n- [700, 0, 320]\n- [0, 700, 240]\n- [0, 0, 1]\ndist:\n  - -0.1\n  - .5\n  - 0\n"
      "  - 1e-3\n");
  EXPECT_EQ(lists.model.fy_px, 700);
  EXPECT_EQ(lists.model.distortion[1], 0.5);
  EXPECT_EQ(lists.model.distortion[3], 1e-3);
  EXPECT_FALSE(lists.has_size);
  // ORB-SLAM's settings.
  const ForeignCamera slam = read(
      "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera.fx: 458.654\nCamera.fy: 457.296\n"
      "Camera.cx: 367.215\nCamera.cy: 248.375\nCamera.k1: -0.28\nCamera.k2: 0.07\n"
      "Camera.p1: 0.0002\nCamera.p2: 1.8e-05\nCamera.width: 752\nCamera.height: 480\n");
  EXPECT_EQ(slam.model.cx_px, 367.215);
  EXPECT_EQ(slam.model.distortion[2], 0.0002);
  EXPECT_EQ(slam.model.height_px, 480);
  // Two cameras in one file.
  const char* both =
      "M1: [[1, 0, 2], [0, 3, 4], [0, 0, 1]]\nD1: [0, 0, 0, 0]\nimage_size: [64, 48]\n"
      "M2: [[5, 0, 6], [0, 7, 8], [0, 0, 1]]\nD2: [1, 0, 0, 0]\n";
  EXPECT_EQ(read(both, "1").model.fy_px, 3);
  EXPECT_EQ(read(both, "2").model.cy_px, 8);
  EXPECT_EQ(read(both, "2").model.height_px, 48);
}

TEST(OpenCvCamera, RealFiles) {
  const char* data = std::getenv("ALHAZEN_DATA");
  const fs::path root = data != nullptr ? data : "../shared/data";
  const fs::path left = root / "calib_opencv/left_intrinsics.yml";
  if (!fs::exists(left)) GTEST_SKIP() << left << " is missing";
  const auto single = read_cameras(left.string(), 1);
  ASSERT_TRUE(single) << single.error().text();
  EXPECT_EQ(single->front().model.width_px, 640);
  EXPECT_EQ(single->front().model.fx_px, 535.91573396163199);
  EXPECT_EQ(single->front().model.distortion[4], 0.23839153080878486);
  const fs::path stereo = root / "calib_opencv/intrinsics.yml";
  const auto second = read_cameras("right=" + stereo.string() + "#2", 1);
  ASSERT_TRUE(second) << second.error().text();
  EXPECT_EQ(second->front().model.name, "right");
  EXPECT_EQ(second->front().model.cx_px, 334.55744527912015);
  const fs::path xml = root / "sl_procam/calibration_result.xml";
  const auto procam = read_cameras("camera=" + xml.string(), 1);
  ASSERT_TRUE(procam) << procam.error().text();
  EXPECT_EQ(procam->front().model.fx_px, 3452.3929068729908);
  EXPECT_EQ(procam->front().model.distortion[4], 3.1254596570907323);
}

struct BadFile {
  std::string what, text, says;
  Code code = Code::invalid;
};
class BadFiles : public ::testing::TestWithParam<BadFile> {};

TEST_P(BadFiles, AreRefusedByName) {
  const auto camera = parse_opencv_camera(GetParam().text, "", 1);
  ASSERT_FALSE(camera);
  EXPECT_EQ(camera.error().code, GetParam().code) << camera.error().text();
  EXPECT_THAT(camera.error().text(), HasSubstr(GetParam().says));
}

const char* const kGoodMatrix = "K: [500, 0, 320, 0, 500, 240, 0, 0, 1]\n";
INSTANTIATE_TEST_SUITE_P(
    All, BadFiles,
    ::testing::Values(
        BadFile{"empty", "", "holds nothing"}, BadFile{"list", "- 1\n- 2\n", "keys with values"},
        BadFile{"no_matrix", "D: [0, 0, 0, 0]\n", "key 'camera_matrix' is missing"},
        BadFile{"no_distortion", kGoodMatrix, "key 'distortion_coefficients' is missing"},
        BadFile{"eight_numbers", "camera_matrix: [500, 0, 320, 0, 500, 240, 0, 0]\nD: []\n",
                "key 'camera_matrix' must be [[fx, 0, cx]"},
        BadFile{"negative", "K: [-500, 0, 320, 0, 500, 240, 0, 0, 1]\nD: []\n", "above 0"},
        BadFile{"not_finite", "K: [.nan, 0, 320, 0, 500, 240, 0, 0, 1]\nD: []\n", "finite"},
        BadFile{"infinite", "K: [1e999, 0, 320, 0, 500, 240, 0, 0, 1]\nD: []\n", "finite"},
        BadFile{"skew", "K: [500, 0.5, 320, 0, 500, 240, 0, 0, 1]\nD: []\n", "skew",
                Code::unsupported},
        BadFile{"six_coefficients", std::string(kGoodMatrix) + "D: [0, 0, 0, 0, 0, 0]\n",
                "key 'D' must be 0, 4, 5, 8, 12 or 14"},
        BadFile{"thin_prism",
                std::string(kGoodMatrix) + "D: [0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0]\n",
                "thin prism", Code::unsupported},
        BadFile{"fisheye",
                std::string(kGoodMatrix) + "distortion_model: equidistant\nD: [0,0,0,0]\n",
                "equidistant", Code::unsupported},
        BadFile{"fractional_size", std::string(kGoodMatrix) + "D: []\nimage_size: [640.5, 480]\n",
                "[1, 65535]"},
        BadFile{"size_of_one", std::string(kGoodMatrix) + "D: []\nimage_size: [640]\n",
                "width and height"},
        BadFile{"short_pose", std::string(kGoodMatrix) + "D: []\nrvec: [1, 2]\ntvec: [1, 2, 3]\n",
                "key 'rvec' must be 3 numbers"},
        BadFile{"open_list", "K: [500, 0, 320\n", "does not end"},
        BadFile{"anchor", "K: *other\n", "anchors"},
        BadFile{"no_key", "K: 1\n!!what is this\n", "line 2"},
        BadFile{"deep_flow", "K: " + std::string(100000, '['), "nested deeper"},
        BadFile{"deep_items",
                [] {
                  std::string text;
                  for (std::size_t i = 0; i < 100; ++i) text += std::string(i, ' ') + "a:\n";
                  return text;
                }(),
                "nested deeper"},
        BadFile{"xml_open", "<?xml version=\"1.0\"?><opencv_storage><a>1</a>", "is missing"},
        BadFile{"xml_crossed", "<a><b></a></b>", "the end of another element"},
        BadFile{"xml_twice", "<a><b>1</b><b>2</b></a>", "there twice"},
        BadFile{"xml_doctype", "<!DOCTYPE a><a/>", "without a name"},
        BadFile{"xml_deep",
                [] {
                  std::string text;
                  for (int i = 0; i < 1000; ++i) text += "<a>";
                  return text;
                }(),
                "nested deeper"},
        BadFile{"json", "{\"K\": [1, 2", "JSON"}),
    [](const auto& named) { return named.param.what; });

// COLMAP ------------------------------------------------------------------------------------------

TEST(Colmap, GivesEveryNumberBack) {
  std::vector<ColmapImage> images;
  std::vector<CameraModel> cameras;
  for (const double turn_rad : {0.0, 0.7, 2.0, 3.1}) {
    cameras.push_back(some_camera("c" + std::to_string(cameras.size()), turn_rad));
    images.push_back(
        {cameras.back().name + ".png", cameras.back(), cameras.back().camera_from_rig});
  }
  const ColmapModel model = to_colmap(images);
  const auto read = parse_colmap(model.cameras_txt, model.images_txt, 1);
  ASSERT_TRUE(read) << read.error().text();
  ASSERT_EQ(read->size(), cameras.size());
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const CameraModel& got = (*read)[i].model;
    EXPECT_EQ(got.name, cameras[i].name);
    EXPECT_EQ(got.width_px, cameras[i].width_px);
    EXPECT_EQ(got.fx_px, cameras[i].fx_px);
    EXPECT_NEAR(got.cx_px, cameras[i].cx_px, 1e-12 * 2048);
    EXPECT_EQ(got.distortion, cameras[i].distortion);
    EXPECT_LT((got.camera_from_rig.rotation - cameras[i].camera_from_rig.rotation).norm(), 1e-14);
    EXPECT_EQ(got.camera_from_rig.translation_mm, cameras[i].camera_from_rig.translation_mm);
  }
}

/// The written text, understood from COLMAP's documentation alone and projected by OpenCV.
TEST(Colmap, WrittenCamerasSeeAsOursDo) {
  const CameraModel camera = some_camera("left", 0.7);
  const ColmapModel model =
      to_colmap(std::vector<ColmapImage>{{"left.png", camera, camera.camera_from_rig}});
  std::istringstream cameras(model.cameras_txt), images(model.images_txt);
  std::string line, kind, name;
  std::getline(cameras, line);
  int id = 0, width = 0, height = 0, camera_id = 0;
  std::array<double, 12> p{};
  cameras >> id >> kind >> width >> height;
  for (double& x : p) cameras >> x;
  ASSERT_TRUE(cameras && kind == "FULL_OPENCV" && width == 2048 && height == 1536);
  std::getline(images, line);
  std::getline(images, line);
  double w = 0, x = 0, y = 0, z = 0;
  cv::Vec3d t;
  images >> id >> w >> x >> y >> z >> t[0] >> t[1] >> t[2] >> camera_id >> name;
  ASSERT_TRUE(images && name == "left.png");
  EXPECT_NEAR(w * w + x * x + y * y + z * z, 1, 1e-15);
  const cv::Matx33d turn(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                         2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                         2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y));
  cv::Vec3d rvec;
  cv::Rodrigues(turn, rvec);
  const cv::Mat k = (cv::Mat_<double>(3, 3) << p[0], 0, p[2], 0, p[1], p[3], 0, 0, 1);
  const std::vector<double> d(p.begin() + 4, p.end());
  for (const Eigen::Vector3d& point : some_points()) {
    const Eigen::Vector2d theirs = opencv_pixel(k, d, rvec, t, point);
    const Eigen::Vector2d ours = *camera.project(camera.camera_from_rig * point);
    EXPECT_LT((theirs - ours - Eigen::Vector2d(0.5, 0.5)).norm(), 1e-8);
  }
}

TEST(Colmap, EveryModelOfPinholesIsUnderstood) {
  const auto read = [](const std::string& camera) {
    auto cameras = parse_colmap("# comment\n\n3 " + camera + "\n",
                                "# two lines an image\n7 1 0 0 0 1 2 3 3 far/away/c one.jpg\n"
                                "1 2 3 4.5 6 -1\n",
                                1000);
    EXPECT_TRUE(cameras) << cameras.error().text();
    return cameras->front().model;
  };
  const CameraModel simple = read("SIMPLE_RADIAL 640 480 500 320.5 240.5 -0.1");
  EXPECT_EQ(simple.fx_px, 500);
  EXPECT_EQ(simple.fy_px, 500);
  EXPECT_EQ(simple.cx_px, 320);
  EXPECT_EQ(simple.distortion[0], -0.1);
  EXPECT_EQ(simple.camera_from_rig.translation_mm, Eigen::Vector3d(1000, 2000, 3000));
  EXPECT_EQ(simple.name, "c one");
  EXPECT_EQ(read("PINHOLE 640 480 500 501 320.5 240.5").fy_px, 501);
  EXPECT_EQ(read("SIMPLE_PINHOLE 640 480 500 320.5 240.5").cy_px, 240);
  EXPECT_EQ(read("RADIAL 640 480 500 320.5 240.5 1 2").distortion[1], 2);
  EXPECT_EQ(read("OPENCV 640 480 500 501 320.5 240.5 1 2 3 4").distortion[3], 4);
}

struct BadModel {
  std::string what, cameras, images, says;
  Code code = Code::invalid;
};
class BadModels : public ::testing::TestWithParam<BadModel> {};

TEST_P(BadModels, AreRefusedByLine) {
  const auto cameras = parse_colmap(GetParam().cameras, GetParam().images, 1);
  ASSERT_FALSE(cameras);
  EXPECT_EQ(cameras.error().code, GetParam().code);
  EXPECT_THAT(cameras.error().text(), HasSubstr(GetParam().says));
}

const char* const kGoodCamera = "1 PINHOLE 64 48 50 50 32 24\n";
INSTANTIATE_TEST_SUITE_P(
    All, BadModels,
    ::testing::Values(
        BadModel{"nothing", "", "", "names no image"},
        BadModel{"fisheye", "1 OPENCV_FISHEYE 64 48 1 1 1 1 0 0 0 0\n", "", "OPENCV_FISHEYE",
                 Code::unsupported},
        BadModel{"few_parameters", "1 PINHOLE 64 48 50 50 32\n", "", "cameras.txt line 1: PARAMS"},
        BadModel{"many_parameters", "1 PINHOLE 64 48 50 50 32 24 1\n", "", "has 4 parameters"},
        BadModel{"no_width", "1 PINHOLE 0 48 50 50 32 24\n", "", "WIDTH must be"},
        BadModel{"no_focal_length", "1 PINHOLE 64 48 0 50 32 24\n", "", "above 0"},
        BadModel{"camera_twice", std::string(kGoodCamera) + kGoodCamera, "", "line 2"},
        BadModel{"other_camera", kGoodCamera, "1 1 0 0 0 1 2 3 9 a.png\n\n", "no camera 9"},
        BadModel{"no_rotation", kGoodCamera, "1 0 0 0 0 1 2 3 1 a.png\n\n", "unit quaternion"},
        BadModel{"no_number", kGoodCamera, "1 1 0 0 0 1 2 nan 1 a.png\n\n", "finite"},
        BadModel{"two_poses", kGoodCamera, "1 1 0 0 0 1 2 3 1 a.png\n\n2 1 0 0 0 1 2 3 1 b/a.jpg\n",
                 "images.txt line 3: image 'b/a.jpg' gives the camera 'a' a second pose"}),
    [](const auto& named) { return named.param.what; });

// Into a rig --------------------------------------------------------------------------------------

TEST(RigWithCameras, FilesFillInWhatTheRigLeavesOut) {
  const char* rig_json = R"({
    "cameras": [{"name": "left", "camera_from_rig":
      [[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]}],
    "displays": [{"name": "side", "width_px": 192, "height_px": 108, "origin_mm": [300, -250, 400],
      "u_mm": [0, 0.27, 0], "v_mm": [0, 0, -0.27], "mount": "rig"}],
    "turntable": {"point_mm": [0, 0, 0], "direction": [0, 0, 1]}})";
  ForeignCamera left, right;
  left.model = some_camera("left", 0.7);
  left.has_size = true;
  right.model = some_camera("right", 0.2);
  right.has_size = right.has_pose = true;
  const auto rig = rig_with_cameras(rig_json, std::vector{left, right});
  ASSERT_TRUE(rig) << rig.error().text();
  ASSERT_EQ(rig->cameras.size(), 2U);
  EXPECT_EQ(rig->cameras[0].fx_px, left.model.fx_px);
  EXPECT_EQ(rig->cameras[0].camera_from_rig.translation_mm, Eigen::Vector3d(5, 6, 7));
  EXPECT_EQ(rig->cameras[1].camera_from_rig.rotation, right.model.camera_from_rig.rotation);

  right.has_pose = false;
  const auto nowhere = rig_with_cameras(rig_json, std::vector{left, right});
  ASSERT_FALSE(nowhere);
  EXPECT_THAT(nowhere.error().text(), HasSubstr("rig.cameras[1].camera_from_rig' is missing"));
  left.has_size = false;
  const auto no_size = rig_with_cameras(rig_json, std::vector{left});
  ASSERT_FALSE(no_size);
  EXPECT_THAT(no_size.error().text(), HasSubstr("width_px' is missing"));
  for (const char* text : {"", "[]", "{\"cameras\": 3}", "{\"cameras\": [3]}"})
    EXPECT_FALSE(rig_with_cameras(text, std::vector{left})) << text;
}

TEST(RigWithCameras, FilesOfAnotherPictureSizeAreRefusedNamingBoth) {
  Rig rig;
  rig.cameras = {some_camera("left", 0.7)};
  rig.displays.push_back({"side", 192, 108, {300, -250, 400}});
  ForeignCamera half;
  half.model = some_camera("left", 0.7);
  half.model.width_px = 1024;
  half.model.height_px = 768;
  half.has_size = true;
  half.source = "left.yml";
  const auto refused = rig_with_cameras(rig.to_json(), std::vector{half});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, Code::invalid);
  EXPECT_THAT(refused.error().what,
              HasSubstr("camera 'left' has 2048 x 1536 px, left.yml 1024 x 768 px"));
}

TEST(ReadCameras, NamesWhatItCannotRead) {
  const TemporaryFolder folder;
  EXPECT_EQ(read_cameras((folder.path() / "none.yml").string(), 1).error().code, Code::unavailable);
  EXPECT_EQ(read_cameras(folder.path().string(), 1).error().code, Code::unavailable);
  std::ofstream(folder.path() / "bad.yml") << "K: 3\n";
  const auto bad = read_cameras("x=" + (folder.path() / "bad.yml").string(), 1);
  ASSERT_FALSE(bad);
  EXPECT_THAT(bad.error().text(), HasSubstr("bad.yml"));
}

}  // namespace
}  // namespace alhazen
