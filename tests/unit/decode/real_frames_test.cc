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

// What the photographs must give inside the chessboard's hull, against a homography fitted to every
// position there.
constexpr std::size_t kLeastPositions = 90'000;
constexpr double kMostRms_px = 0.30;  // per axis; 1 / √12 = 0.289 is what whole pixels allow
constexpr double kMostError_px = 5.0;
// On the whole picture: pixels that OpenCV and we both resolve to single display pixels. A bound
// far below what is found only keeps the comparison from becoming empty.
constexpr std::size_t kLeastCompared = 500'000;
// OpenCV calls a pixel's bit an error where |pattern − inverse| is less; this is its default.
constexpr std::size_t kOpenCvWhiteThreshold = 5;

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
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(map_.region.width) +
           static_cast<std::size_t>(x);
  }
  /// Resolved to one pixel of the display. Any other position is the centre of a cell of
  /// 2^bit_u × 2^bit_v of them: known to lie in it, not to be that pixel.
  [[nodiscard]] bool is_single(std::size_t i) const {
    return map_.is_position(i) && map_.bit_u[i] == 0 && map_.bit_v[i] == 0;
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
        const std::size_t i = index(x, y);
        if (!map_.is_position(i) || !is_on_board(x, y)) continue;
        if (is_finest_only && !is_single(i)) continue;
        camera.emplace_back(static_cast<float>(x), static_cast<float>(y));
        display.emplace_back(map_.u_px[i], map_.v_px[i]);
      }
    }
    ASSERT_GE(camera.size(), kLeastPositions);
    const Fit fit = fit_homography(camera, display);
    EXPECT_LE(fit.rms_u_px, kMostRms_px);
    EXPECT_LE(fit.rms_v_px, kMostRms_px);
    EXPECT_LE(fit.max_px, kMostError_px);
    RecordProperty(is_finest_only ? "finest_count" : "count", static_cast<int>(fit.count));
    std::printf("in the hull, %s: %zu pixels, RMS %.4f, %.4f px, largest %.2f px\n",
                is_finest_only ? "decoded to bit 0" : "decoded", fit.count, fit.rms_u_px,
                fit.rms_v_px, fit.max_px);
  }
}

/// OpenCV reads all bits or none, so it calls single display pixels valid. Valid for us is the
/// same: resolved to bit 0 on both axes. There both must be equal, everywhere on the picture; where
/// we stop at a coarser cell, it must hold OpenCV's pixel.
TEST_F(RealFrames, EqualOpenCvWhereverBothAreValid) {
  const auto opencv =
      cv::structured_light::GrayCodePattern::create(kDisplayWidth_px, kDisplayHeight_px);
  opencv->setWhiteThreshold(kOpenCvWhiteThreshold);
  std::vector<cv::Mat> pictures;  // getProjPixel() takes no white and black, and knows no mask
  pictures.reserve(kWhite);
  for (int number = 0; number < kWhite; ++number) pictures.push_back(picture(number));
  std::size_t decoded = 0, single = 0, by_opencv = 0, both = 0, equal = 0, cells = 0, holding = 0;
  for (int y = 0; y < map_.region.height; ++y) {
    for (int x = 0; x < map_.region.width; ++x) {
      const std::size_t i = index(x, y);
      cv::Point theirs;
      const bool is_theirs = !opencv->getProjPixel(pictures, x, y, theirs);  // true: an error
      by_opencv += is_theirs ? 1U : 0U;
      decoded += map_.is_position(i) ? 1U : 0U;
      single += is_single(i) ? 1U : 0U;
      if (!is_theirs || !map_.is_position(i)) continue;
      const float off_u_px = std::abs(map_.u_px[i] - static_cast<float>(theirs.x));
      const float off_v_px = std::abs(map_.v_px[i] - static_cast<float>(theirs.y));
      if (is_single(i)) {
        ++both;
        equal += off_u_px == 0 && off_v_px == 0 ? 1U : 0U;
      } else {
        ++cells;
        holding += off_u_px <= 0.5F * static_cast<float>((1 << map_.bit_u[i]) - 1) &&
                           off_v_px <= 0.5F * static_cast<float>((1 << map_.bit_v[i]) - 1)
                       ? 1U
                       : 0U;
      }
    }
  }
  EXPECT_GE(both, kLeastCompared);
  EXPECT_EQ(equal, both);
  EXPECT_GT(cells, 0U);
  EXPECT_EQ(holding, cells);
  std::printf("on the picture: decoded %zu, to bit 0 %zu; by OpenCV %zu\n", decoded, single,
              by_opencv);
  std::printf("both valid (bit 0, and OpenCV): %zu, equal: %zu\n", both, equal);
  std::printf("coarser cells where OpenCV is valid: %zu, holding its pixel: %zu\n", cells, holding);
}

}  // namespace
}  // namespace alhazen
