#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/normals/normal_map_file.h"
#include "reconstruct/normals/photometric_stereo.h"

namespace alhazen {

/// A line of VIEWS.csv: a file with a normal map, and how it was taken.
struct ViewEntry {
  std::filesystem::path file;  ///< as written; relative to the table's folder, like format.mask
  NormalMapKey key;
  double angle_rad = 0;
  NormalMapFormat format;
  int line = 0;
};

/// A line of LIGHTS.csv: a picture, and the light by which it was taken.
struct LightEntry {
  std::filesystem::path file;  ///< as written; relative to the table's folder
  Light light;                 ///< camera frame
  int line = 0;
};

/// Read the text of the tables; their formats are described in reconstruct/README.md. Hostile input
/// welcome. Fails: invalid, naming line, column and allowed range; a view that is there twice.
[[nodiscard]] Result<std::vector<ViewEntry>> parse_views(std::string_view csv);
[[nodiscard]] Result<std::vector<LightEntry>> parse_lights(std::string_view csv);

}  // namespace alhazen
