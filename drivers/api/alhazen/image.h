#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

#include "alhazen/check.h"
#include "alhazen/clock.h"

namespace alhazen {

/// How one pixel is stored. mono16 is native-endian and holds `Image::bits` significant low bits.
enum class PixelFormat : std::uint8_t { mono8, mono16 };

[[nodiscard]] constexpr std::size_t bytes_per_pixel(PixelFormat format) noexcept {
  return format == PixelFormat::mono8 ? 1 : 2;
}

/// A rectangle of pixels of a larger picture: x right, y down, in px.
struct Region {
  int x = 0, y = 0, width = 0, height = 0;
  friend bool operator==(const Region&, const Region&) = default;
};

/// Shared read-only pixels, rows packed without padding. Reentrant; copies share the pixels.
class Image {
 public:
  Image() = default;
  /// Takes pixels that a driver already owns (its deleter gives the buffer back).
  /// REQUIRES: `pixels` holds width · height · bytes_per_pixel(format) bytes; bits in 8 … 16.
  Image(int width, int height, PixelFormat format, int bits,
        std::shared_ptr<const std::byte[]> pixels)
      : width_(width), height_(height), bits_(bits), format_(format), pixels_(std::move(pixels)) {
    ALHAZEN_CHECK(width >= 0 && height >= 0);
  }
  /// An image copied from `pixels` (row-major).
  template <class Pixel>
  [[nodiscard]] static Image copy(int width, int height, int bits, std::span<const Pixel> pixels) {
    static_assert(sizeof(Pixel) == 1 || sizeof(Pixel) == 2);
    ALHAZEN_CHECK(pixels.size() ==
                  static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    std::shared_ptr<std::byte[]> own(new std::byte[pixels.size_bytes()]);
    std::memcpy(own.get(), pixels.data(), pixels.size_bytes());
    return {width, height, sizeof(Pixel) == 1 ? PixelFormat::mono8 : PixelFormat::mono16, bits,
            own};
  }

  [[nodiscard]] int width() const noexcept { return width_; }
  [[nodiscard]] int height() const noexcept { return height_; }
  /// Significant bits of a pixel: 8, 10, 12 or 16; white is (1 << bits) − 1.
  [[nodiscard]] int bits() const noexcept { return bits_; }
  [[nodiscard]] PixelFormat format() const noexcept { return format_; }
  [[nodiscard]] bool empty() const noexcept { return !pixels_; }
  [[nodiscard]] std::size_t size_px() const noexcept {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  }
  [[nodiscard]] std::span<const std::byte> bytes() const noexcept {
    return {pixels_.get(), size_px() * bytes_per_pixel(format_)};
  }
  /// REQUIRES: format() == mono8.
  [[nodiscard]] std::span<const std::uint8_t> mono8() const {
    ALHAZEN_CHECK(format_ == PixelFormat::mono8);
    return {reinterpret_cast<const std::uint8_t*>(pixels_.get()), size_px()};
  }
  /// REQUIRES: format() == mono16.
  [[nodiscard]] std::span<const std::uint16_t> mono16() const {
    ALHAZEN_CHECK(format_ == PixelFormat::mono16);
    return {reinterpret_cast<const std::uint16_t*>(pixels_.get()), size_px()};
  }

 private:
  int width_ = 0, height_ = 0, bits_ = 8;
  PixelFormat format_ = PixelFormat::mono8;
  std::shared_ptr<const std::byte[]> pixels_;
};

/// What a camera is set to for one frame; everything else is fixed when it is opened.
struct CameraSettings {
  Micros exposure{10'000};
  double gain_db = 0.0;
  Region region;  ///< empty width/height: the whole sensor
  friend bool operator==(const CameraSettings&, const CameraSettings&) = default;
};

/// One picture of one camera: when it was exposed, with what, and the device's own counter.
struct Frame {
  Image image;              ///< the pixels of `settings.region`
  CameraSettings settings;  ///< really in force while it was exposed
  Time exposure_begin, exposure_end;
  std::uint64_t device_counter = 0;  ///< rises by one per exposed frame; equal or lower means stale
};

}  // namespace alhazen
