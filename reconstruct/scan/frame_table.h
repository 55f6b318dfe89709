#pragma once

#include <filesystem>
#include <string_view>
#include <vector>

#include "alhazen/image.h"
#include "alhazen/pattern.h"
#include "alhazen/result.h"
#include "reconstruct/scan/light_map.h"

namespace alhazen {

/// A picture that somebody took, and what was shown meanwhile: a line of frames.csv.
struct TableFrame {
  std::filesystem::path file;  ///< as written; relative to the table's folder
  StackKey key;
  double angle_rad = 0;
  Micros exposure{0};
  Pattern pattern;
  int line = 0;  ///< of the table, from 1
};

/// Reads the text of a frames.csv: how pictures taken by other software enter. The format is
/// described in reconstruct/README.md. Hostile input welcome.
/// Fails: invalid, naming line, column and allowed range; among them a stack that has the same
///        pattern twice, or two angles.
[[nodiscard]] Result<std::vector<TableFrame>> parse_frame_table(std::string_view csv);

/// The frames of one stack, white and black first, patterns next to their inverses: the order in
/// which a Decoder keeps the fewest.
struct TableStack {
  StackKey key;
  double angle_rad = 0;
  std::vector<TableFrame> frames;
};
/// Sorted by key.
[[nodiscard]] std::vector<TableStack> stacks_of(std::vector<TableFrame> frames);

}  // namespace alhazen
