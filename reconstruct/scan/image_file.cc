#include "reconstruct/scan/image_file.h"

#include <xxhash.h>

#include <array>
#include <cstdio>
#include <cstring>
#include <memory>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "alhazen/caught.h"
#include "reconstruct/scan/limits.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

constexpr std::uint64_t kMaxPictureBytes = (std::uint64_t{1} << 31) - 1;  // OpenCV counts in int
// Frames are written while the rig waits: speed counts more than the last bytes.
constexpr int kPngCompression = 1;

}  // namespace

std::string checksum(const Image& image) {
  const std::span<const std::byte> bytes = image.bytes();
  std::array<char, 17> text{};
  std::snprintf(text.data(), text.size(), "%016llx",
                static_cast<unsigned long long>(XXH3_64bits(bytes.data(), bytes.size())));
  return text.data();
}

Status write_image(const Image& image, const std::filesystem::path& file) {
  if (image.size_px() == 0) return Error{Code::invalid, "an empty picture cannot be stored"};
  std::vector<unsigned char> png;
  ALHAZEN_TRY(caught(Code::internal, "encoding '" + file.string() + "'", [&]() -> Status {
    // OpenCV has no read-only view; imencode() does not write to it.
    const cv::Mat view(image.height(), image.width(),
                       image.format() == PixelFormat::mono8 ? CV_8UC1 : CV_16UC1,
                       const_cast<std::byte*>(image.bytes().data()));
    cv::imencode(".png", view, png, {cv::IMWRITE_PNG_COMPRESSION, kPngCompression});
    return {};
  }));
  return write_file_safely(file, {reinterpret_cast<const char*>(png.data()), png.size()});
}

Result<Image> read_image(const std::filesystem::path& file, int bits) {
  if (bits != 0 && (bits < 8 || bits > 16)) {
    return Error{Code::invalid,
                 "a pixel of " + std::to_string(bits) + " bits; it must be in [8, 16], or 0"};
  }
  const std::string name = std::string("picture '") + file.string() + "'";
  std::string bytes = ALHAZEN_TRY(read_file(file, kMaxPictureBytes));
  if (bytes.empty()) return Error{Code::corrupt, name + " is empty"};
  return caught(Code::corrupt, name, [&]() -> Result<Image> {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8UC1, bytes.data());
    const cv::Mat picture = cv::imdecode(encoded, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
    if (picture.empty() || (picture.depth() != CV_8U && picture.depth() != CV_16U)) {
      return Error{Code::corrupt, name + " is no picture of 8 or 16 bits a pixel"};
    }
    if (picture.cols > limits::kSide_px || picture.rows > limits::kSide_px) {
      return Error{Code::invalid, name + " is larger than 65535 px a side"};
    }
    const bool is_8 = picture.depth() == CV_8U;
    if (is_8 && bits > 8) {
      return Error{Code::invalid, name + " has 8 bits a pixel, not " + std::to_string(bits)};
    }
    const std::size_t row_bytes = static_cast<std::size_t>(picture.cols) * picture.elemSize();
    std::shared_ptr<std::byte[]> pixels(
        new std::byte[row_bytes * static_cast<std::size_t>(picture.rows)]);
    for (int y = 0; y < picture.rows; ++y) {
      std::memcpy(pixels.get() + static_cast<std::size_t>(y) * row_bytes, picture.ptr(y),
                  row_bytes);
    }
    return Image(picture.cols, picture.rows, is_8 ? PixelFormat::mono8 : PixelFormat::mono16,
                 bits != 0 ? bits : (is_8 ? 8 : 16), std::move(pixels));
  });
}

}  // namespace alhazen
