#pragma once

#include <filesystem>
#include <string>

#include "alhazen/image.h"
#include "alhazen/result.h"

namespace alhazen {

/// XXH3-64 of the pixels' bytes, 16 hex digits: what FrameRecord::checksum holds.
[[nodiscard]] std::string checksum(const Image& image);

/// Writes a picture as PNG (values as they are, 16 bit for mono16), aside and renamed.
/// Fails: exhausted, unavailable, invalid (an empty picture).
Status write_image(const Image& image, const std::filesystem::path& file);

/// Reads a picture of any format OpenCV knows; colours become grey. `bits`: significant bits of a
/// pixel, which files do not tell: 8 … 16, or 0 for all that the file's pixels have (8 or 16).
/// Fails: unavailable, corrupt, invalid (bits, or larger than 65535 px a side).
[[nodiscard]] Result<Image> read_image(const std::filesystem::path& file, int bits = 0);

}  // namespace alhazen
