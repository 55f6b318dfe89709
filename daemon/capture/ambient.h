#pragma once

#include <string>

#include "alhazen/image.h"
#include "alhazen/result.h"

namespace alhazen {

/// The level that nine of ten pixels of a picture do not exceed, as a share of full scale: of a
/// black picture, the light of the room. Lamps that the mirror shows are smaller than a tenth.
/// 0 for an empty picture. Reentrant.
[[nodiscard]] double dark_level(const Image& black);

/// From this share of full scale on ambient light is worth a warning: it adds noise and takes away
/// range; from the other on half of the range is lost and a scan is not begun.
inline constexpr double kAmbientWarnShare = 0.1, kAmbientStopShare = 0.5;

/// What to say about a camera's black picture: nothing, a warning, or why not to scan.
/// Fails: conflict (kAmbientStopShare is reached).
[[nodiscard]] Result<std::string> judge_ambient(const std::string& camera, const Image& black);

}  // namespace alhazen
