#include "reconstruct/normals/normal_map_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <string>

namespace alhazen {
namespace {

using testing::HasSubstr;

constexpr int kSide_px = 64;
constexpr double kRadius_px = 25;

CameraModel far_camera() {
  CameraModel camera;
  camera.name = "c0";
  camera.width_px = camera.height_px = kSide_px;
  camera.fx_px = camera.fy_px = 5000;
  camera.cx_px = camera.cy_px = (kSide_px - 1) / 2.0;
  return camera;
}

/// A sphere seen from far away.
NormalMap sphere_map() {
  NormalMap map;
  map.key = {3, "c0"};
  map.angle_rad = 0.5;
  map.region = {0, 0, kSide_px, kSide_px};
  for (int y = 0; y < kSide_px; ++y) {
    for (int x = 0; x < kSide_px; ++x) {
      const double u = (x - (kSide_px - 1) / 2.0) / kRadius_px;
      const double v = (y - (kSide_px - 1) / 2.0) / kRadius_px;
      const double inside = 1 - u * u - v * v;
      map.label.push_back(inside > 0 ? NormalLabel::object : NormalLabel::background);
      map.normal.emplace_back(Eigen::Vector3f::Zero());
      if (inside > 0) map.normal.back() = Eigen::Vector3d(u, v, -std::sqrt(inside)).cast<float>();
    }
  }
  map.label[20 * kSide_px + 30] = NormalLabel::unknown;
  map.normal[20 * kSide_px + 30].setZero();
  return map;
}

class NormalMapFile : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("alhazen_normals_" + std::to_string(getpid()) + "_" +
               testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] Result<NormalMap> read(const std::string& name,
                                       const NormalMapFormat& format = {}) const {
    return read_normal_map(folder_ / name, format, far_camera(), {3, "c0"}, 0.5);
  }
  void write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
  }
  [[nodiscard]] std::string bytes_of(const std::string& name) const {
    std::ifstream stream(folder_ / name, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  /// The map as others write it: 8 bits, x right, y up, z to the viewer; no alpha.
  void write_opengl_png(const NormalMap& map, const std::string& name, int mirrored_axis) const {
    cv::Mat picture(kSide_px, kSide_px, CV_8UC3, cv::Scalar(0, 0, 0));
    for (std::size_t i = 0; i < map.size_px(); ++i) {
      if (map.label[i] != NormalLabel::object) continue;
      Eigen::Vector3f n = map.normal[i];
      n.y() *= -1;
      n.z() *= -1;
      if (mirrored_axis >= 0) n[mirrored_axis] *= -1;
      auto& pixel =
          picture.at<cv::Vec3b>(static_cast<int>(i) / kSide_px, static_cast<int>(i) % kSide_px);
      for (int k = 0; k < 3; ++k) {
        pixel[2 - k] = static_cast<std::uint8_t>(std::lround((n[k] + 1) / 2 * 255));
      }
    }
    cv::imwrite((folder_ / name).string(), picture);
  }

  std::filesystem::path folder_;
};

double worst_rad(const NormalMap& a, const NormalMap& b) {
  double worst = 0;
  for (std::size_t i = 0; i < a.size_px(); ++i) {
    if (a.label[i] == NormalLabel::object && b.label[i] == NormalLabel::object) {
      worst = std::max(worst, static_cast<double>((a.normal[i] - b.normal[i]).norm()));
    }
  }
  return worst;
}

TEST_F(NormalMapFile, ComesBackFromExrExactlyAndFromPngWithin16Bits) {
  const NormalMap map = sphere_map();
  for (const auto& [name, most_rad] : {std::pair{"a.exr", 1e-6}, std::pair{"a.png", 3e-5}}) {
    ASSERT_TRUE(write_normal_map(map, folder_ / name));
    const auto again = read(name);
    ASSERT_TRUE(again) << again.error().text();
    EXPECT_EQ(again->label, map.label);
    EXPECT_EQ(again->region, map.region);
    EXPECT_EQ(again->key, map.key);
    EXPECT_LT(worst_rad(*again, map), most_rad) << name;
  }
  EXPECT_GT(read("a.png")->noise_rad, 0) << "rounding is noise";
}

TEST_F(NormalMapFile, UnderstandsOpenGlAxesAndMasks) {
  const NormalMap map = sphere_map();
  write_opengl_png(map, "gl.png", -1);
  NormalMapFormat format;
  format.axes = NormalAxes::opengl;
  const auto read_back = read("gl.png", format);
  ASSERT_TRUE(read_back) << read_back.error().text();
  EXPECT_LT(worst_rad(*read_back, map), 0.012) << "8 bits";
  EXPECT_EQ(read_back->label[0], NormalLabel::background) << "black is no vector";

  cv::Mat mask(kSide_px, kSide_px, CV_8UC1, cv::Scalar(0));
  mask(cv::Rect(16, 16, 32, 32)) = 255;
  cv::imwrite((folder_ / "mask.png").string(), mask);
  format.mask = folder_ / "mask.png";
  const auto masked = read("gl.png", format);
  ASSERT_TRUE(masked) << masked.error().text();
  EXPECT_EQ(std::count(masked->label.begin(), masked->label.end(), NormalLabel::object),
            32 * 32 - 1);
}

TEST_F(NormalMapFile, TurnsNormalsOfTheRigFrame) {
  CameraModel camera = far_camera();
  camera.camera_from_rig.rotation << 0, 1, 0, 0, 0, -1, -1, 0, 0;
  NormalMap map = sphere_map();
  NormalMap in_rig = map;
  for (Eigen::Vector3f& n : in_rig.normal) {
    n = camera.camera_from_rig.rotation.cast<float>().transpose() * n;
  }
  ASSERT_TRUE(write_normal_map(in_rig, folder_ / "rig.exr"));
  NormalMapFormat format;
  format.axes = NormalAxes::rig;
  const auto again = read_normal_map(folder_ / "rig.exr", format, camera, {3, "c0"}, 0.5);
  ASSERT_TRUE(again) << again.error().text();
  EXPECT_LT(worst_rad(*again, map), 1e-6);
}

TEST_F(NormalMapFile, NamesTheAxisThatIsTurned) {
  const NormalMap map = sphere_map();
  NormalMapFormat format;
  format.axes = NormalAxes::opengl;
  for (const auto& [axis, name] : {std::pair{0, "x is mirrored"}, std::pair{1, "y is mirrored"},
                                   std::pair{2, "z is turned"}}) {
    write_opengl_png(map, "odd.png", axis);
    const auto odd = read("odd.png", format);
    ASSERT_FALSE(odd);
    EXPECT_EQ(odd.error().code, Code::invalid);
    EXPECT_THAT(odd.error().text(), HasSubstr(name));
    EXPECT_THAT(odd.error().text(), HasSubstr("odd.png"));
  }
  // Both at once: a file of the other convention.
  write_opengl_png(map, "gl.png", -1);
  const auto other = read("gl.png");
  ASSERT_FALSE(other);
  EXPECT_THAT(other.error().text(), HasSubstr("y is mirrored"));
  EXPECT_THAT(other.error().text(), HasSubstr("z is turned"));
}

TEST_F(NormalMapFile, RefusesDamagedFiles) {
  const NormalMap map = sphere_map();
  for (const char* name : {"a.exr", "a.png"}) {
    ASSERT_TRUE(write_normal_map(map, folder_ / name));
    const std::string whole = bytes_of(name);
    for (const double share : {0.0, 0.01, 0.1, 0.5, 0.9, 0.99}) {
      write(name,
            whole.substr(0, static_cast<std::size_t>(share * static_cast<double>(whole.size()))));
      const auto cut = read(name);
      EXPECT_FALSE(cut) << name << " cut to " << share;
    }
    std::string wild = whole;
    for (std::size_t i = 8; i < wild.size(); i += 7) wild[i] = static_cast<char>(wild[i] ^ 0x5a);
    write(name, wild);
    EXPECT_FALSE(read(name));
  }
  write("a.png", "no picture at all");
  EXPECT_EQ(read("a.png").error().code, Code::unsupported);
  EXPECT_EQ(read("missing.png").error().code, Code::unavailable);
}

TEST_F(NormalMapFile, RefusesWhatIsNoNormalMap) {
  NormalMap map = sphere_map();
  map.normal[32 * kSide_px + 32].x() = std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE(write_normal_map(map, folder_ / "nan.exr"));
  const auto nan = read("nan.exr");
  ASSERT_FALSE(nan);
  EXPECT_EQ(nan.error().code, Code::corrupt);
  EXPECT_THAT(nan.error().text(), HasSubstr("not finite"));

  cv::imwrite((folder_ / "grey.png").string(), cv::Mat(kSide_px, kSide_px, CV_8UC1, cv::Scalar(9)));
  EXPECT_EQ(read("grey.png").error().code, Code::unsupported);
  cv::imwrite((folder_ / "large.png").string(),
              cv::Mat(kSide_px + 1, kSide_px, CV_8UC3, cv::Scalar(0, 0, 0)));
  EXPECT_THAT(read("large.png").error().text(), HasSubstr("not within the sensor"));
  cv::imwrite((folder_ / "black.png").string(),
              cv::Mat(kSide_px, kSide_px, CV_8UC3, cv::Scalar(0, 0, 0)));
  EXPECT_THAT(read("black.png").error().text(), HasSubstr("no pixel holds a unit vector"));

  ASSERT_TRUE(write_normal_map(sphere_map(), folder_ / "good.exr"));
  cv::imwrite((folder_ / "mask.png").string(), cv::Mat(10, 10, CV_8UC1, cv::Scalar(255)));
  NormalMapFormat format;
  format.mask = folder_ / "mask.png";
  EXPECT_THAT(read("good.exr", format).error().text(), HasSubstr("mask"));
  format.mask.clear();
  format.noise_rad = 2;
  EXPECT_EQ(read("good.exr", format).error().code, Code::invalid);
}

}  // namespace
}  // namespace alhazen
