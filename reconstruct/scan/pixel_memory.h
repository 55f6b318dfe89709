#pragma once

#include <cstddef>

namespace alhazen {

/// Alignment of what take_pixels() gives: for any vector unit.
inline constexpr std::size_t kPixelAlignment = 64;

/// Memory for lists as long as a sensor has pixels; what is in it is undefined. Blocks that were
/// given back are kept: a scan decodes map after map of the same size, and the system clears each
/// page of new memory when it is first touched, which takes longer than decoding into it. What is
/// kept and what is in use are together never more than was once in use at once, and kMostKeptBytes
/// are kept at most; the oldest go first. Thread-safe. Throws std::bad_alloc.
[[nodiscard]] void* take_pixels(std::size_t bytes);
/// `block` came from take_pixels(bytes).
void give_pixels(void* block, std::size_t bytes) noexcept;

/// What decoding needs for four cameras of 2048² pixels, or one of 4096².
inline constexpr std::size_t kMostKeptBytes = std::size_t{640} << 20;
/// Smaller ones are left to the standard library, which does not give them back to the system.
inline constexpr std::size_t kLeastKeptBytes = std::size_t{128} << 10;

/// How much is kept at this moment.
[[nodiscard]] std::size_t kept_pixel_bytes();

}  // namespace alhazen
