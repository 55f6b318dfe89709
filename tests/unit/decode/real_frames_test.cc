// Photographs of a projector's Gray code on a chessboard that nobody of this project took. The
// board is flat, so camera and projector see each other through a homography.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/structured_light.hpp>
#include <string>
#include <vector>

#include "reconstruct/decode/decoder.h"
#include "reconstruct/pattern/sequence.h"
#include "reconstruct/scan/image_file.h"

namespace alhazen {
namespace {

constexpr int kDisplayWidth_px = 1024, kDisplayHeight_px = 768, kBits = 10;
constexpr int kWhite = 40, kBlack = 41, kFrames = 42;

std::filesystem::path data_folder() {
  const char* told = std::getenv("ALHAZEN_DATA");
  return told != nullptr && *told != '\0'
             ? std::filesystem::path(told)
             : std::filesystem::path(ALHAZEN_SOURCE_DIR) / ".." / "shared" / "data";
}

/// Numbered as their authors shot them: columns and rows from the most significant bit, each
/// pattern before its inverse, then white and black.
Pattern pattern_of(int number) {
  if (number == kWhite) return {.kind = PatternKind::white};
  if (number == kBlack) return {.kind = PatternKind::black};
  return {.kind = PatternKind::gray,
          .axis = number < 2 * kBits ? Axis::u : Axis::v,
          .bit = kBits - 1 - number % (2 * kBits) / 2,
          .inverted = number % 2 == 1};
}

class RealFrames : public testing::Test {
 protected:
  void SetUp() override {
    const std::filesystem::path folder = data_folder() / "sl_procam" / "capture_0";
    if (!std::filesystem::exists(folder)) {
      GTEST_SKIP() << "no real photographs: " << folder << " is missing (ALHAZEN_DATA)";
    }
    for (int number = 0; number < kFrames; ++number) {
      const std::string name =
          "graycode_" + std::string(number < 10 ? "0" : "") + std::to_string(number) + ".png";
      images_.push_back(*read_image(folder / name));
      sequence_.push_back(pattern_of(number));
    }
    // As they were shot: white and black last.
    const Region region{0, 0, images_[0].width(), images_[0].height()};
    Decoder decoder = *Decoder::make({}, {0, "projector", "camera"}, 0, region, 8, kDisplayWidth_px,
                                     kDisplayHeight_px, sequence_);
    for (std::size_t i = 0; i < images_.size(); ++i) {
      ASSERT_TRUE(decoder.add(sequence_[i], images_[i]));
    }
    map_ = *std::move(decoder).finish();

    std::vector<cv::Point2f> corners;
    ASSERT_TRUE(cv::findChessboardCorners(picture(kWhite), {9, 7}, corners));
    cv::convexHull(corners, hull_);
  }

  [[nodiscard]] cv::Mat picture(int number) const {
    const Image& image = images_[static_cast<std::size_t>(number)];
    return {image.height(), image.width(), CV_8UC1, const_cast<std::byte*>(image.bytes().data())};
  }
  [[nodiscard]] bool is_on_board(int x, int y) const {
    return cv::pointPolygonTest(hull_, {static_cast<float>(x), static_cast<float>(y)}, false) >= 0;
  }

  std::vector<Image> images_;
  std::vector<Pattern> sequence_;
  LightMap map_;
  std::vector<cv::Point2f> hull_;
};

struct Fit {
  std::size_t count = 0;
  double rms_u_px = 0, rms_v_px = 0, max_px = 0;
};

/// Residuals of plain least squares (findHomography's method 0) over every point: no point is
/// left out of the fit or of the figures.
Fit fit_homography(const std::vector<cv::Point2f>& camera,
                   const std::vector<cv::Point2f>& display) {
  std::vector<cv::Point2f> fitted;
  cv::perspectiveTransform(camera, fitted, cv::findHomography(camera, display, 0));
  Fit fit{.count = camera.size()};
  for (std::size_t i = 0; i < camera.size(); ++i) {
    const double du = display[i].x - fitted[i].x, dv = display[i].y - fitted[i].y;
    fit.rms_u_px += du * du;
    fit.rms_v_px += dv * dv;
    fit.max_px = std::max({fit.max_px, std::abs(du), std::abs(dv)});
  }
  fit.rms_u_px = std::sqrt(fit.rms_u_px / static_cast<double>(fit.count));
  fit.rms_v_px = std::sqrt(fit.rms_v_px / static_cast<double>(fit.count));
  return fit;
}

TEST_F(RealFrames, LieOnAHomography) {
  for (const bool is_finest_only : {false, true}) {
    std::vector<cv::Point2f> camera, display;
    for (int y = 0; y < map_.region.height; ++y) {
      for (int x = 0; x < map_.region.width; ++x) {
        const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(map_.region.width) +
                       static_cast<std::size_t>(x);
        if (!map_.is_position(i) || !is_on_board(x, y)) continue;
        if (is_finest_only && (map_.bit_u[i] != 0 || map_.bit_v[i] != 0)) continue;
        camera.emplace_back(static_cast<float>(x), static_cast<float>(y));
        display.emplace_back(map_.u_px[i], map_.v_px[i]);
      }
    }
    ASSERT_GE(camera.size(), 90'000U);
    const Fit fit = fit_homography(camera, display);
    EXPECT_LE(fit.rms_u_px, 0.30);
    EXPECT_LE(fit.rms_v_px, 0.30);
    EXPECT_LE(fit.max_px, 5.0);
    RecordProperty(is_finest_only ? "finest_count" : "count", static_cast<int>(fit.count));
    std::printf("%s: %zu pixels, RMS %.4f, %.4f px, largest %.2f px\n",
                is_finest_only ? "resolved to bit 0" : "all positions", fit.count, fit.rms_u_px,
                fit.rms_v_px, fit.max_px);
  }
}

TEST_F(RealFrames, AgreeWithOpenCvWhereverBothDecode) {
  const auto opencv =
      cv::structured_light::GrayCodePattern::create(kDisplayWidth_px, kDisplayHeight_px);
  std::vector<cv::Mat> pictures;
  pictures.reserve(kWhite);
  for (int number = 0; number < kWhite; ++number) pictures.push_back(picture(number));
  std::size_t equal = 0, inside_cell = 0;
  for (int y = 0; y < map_.region.height; ++y) {
    for (int x = 0; x < map_.region.width; ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(map_.region.width) +
                     static_cast<std::size_t>(x);
      cv::Point position;  // getProjPixel() is true where a bit is too weak for it
      if (!map_.is_position(i) || opencv->getProjPixel(pictures, x, y, position)) continue;
      // OpenCV always reads all bits; ours may stop at a cell of several pixels, on which then
      // OpenCV's position lies.
      const float half_u_px = 0.5F * static_cast<float>((1 << map_.bit_u[i]) - 1);
      const float half_v_px = 0.5F * static_cast<float>((1 << map_.bit_v[i]) - 1);
      ASSERT_LE(std::abs(map_.u_px[i] - static_cast<float>(position.x)), half_u_px)
          << x << " " << y;
      ASSERT_LE(std::abs(map_.v_px[i] - static_cast<float>(position.y)), half_v_px)
          << x << " " << y;
      ++(half_u_px == 0 && half_v_px == 0 ? equal : inside_cell);
    }
  }
  EXPECT_GE(equal, 85'000U);
  std::printf("equal to OpenCV: %zu, in a coarser cell that holds OpenCV's: %zu\n", equal,
              inside_cell);
}

}  // namespace
}  // namespace alhazen
