#pragma once

#include <cstddef>
#include <cstdint>

/// What files may say, whatever format they have: far beyond any rig, and small enough that a
/// hostile file stays small.
namespace alhazen::limits {

constexpr std::size_t kNameBytes = 64;
constexpr int kSide_px = 65'535;
constexpr std::int64_t kExposure_us = 3'600'000'000;
/// How much of a wrong value a message repeats.
constexpr std::size_t kShownBytes = 60;

}  // namespace alhazen::limits
