#pragma once

#include <nlohmann/json.hpp>
#include <string_view>

#include "alhazen/result.h"

namespace alhazen {

/// The tree that a calibration file of others holds, whatever it is written in: YAML as
/// cv::FileStorage and ROS write it (blocks by indentation, [] and {} over several lines; tags are
/// passed over, anchors and block scalars not understood), XML as cv::FileStorage writes it, or
/// JSON (with // comments, as cv::FileStorage writes them). Scalars become numbers where they are
/// some; several words of XML become a list. For .cc files only: it brings all of nlohmann-json.
/// Hostile input welcome. Reentrant. Fails: invalid, naming the line; nested deeper than 32 is one
/// of the reasons.
[[nodiscard]] Result<nlohmann::json> parse_document(std::string_view text);

}  // namespace alhazen
