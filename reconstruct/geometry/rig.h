#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/camera_model.h"
#include "reconstruct/geometry/display_model.h"
#include "reconstruct/geometry/table_model.h"

namespace alhazen {

/// The devices together with their calibrated geometry. Lengths are millimetres, here and in the
/// file. The format of rig.json is described in reconstruct/README.md. Reentrant.
struct Rig {
  std::vector<CameraModel> cameras;
  std::vector<DisplayModel> displays;
  TableModel turntable;

  [[nodiscard]] const CameraModel* camera(std::string_view name) const;
  [[nodiscard]] const DisplayModel* display(std::string_view name) const;

  /// Reads the text of a rig.json. Hostile input welcome.
  /// Fails: invalid, naming the key and what it must be: rotations orthonormal to 1e-6 and
  ///        right-handed, names unique, sizes 1 … 65535, everything finite.
  [[nodiscard]] static Result<Rig> parse(std::string_view json);
  /// Fails: as parse(), and unavailable where the file cannot be read.
  [[nodiscard]] static Result<Rig> load(const std::filesystem::path& file);
  /// The same rig as JSON; parse(to_json()) gives every number back exactly.
  [[nodiscard]] std::string to_json() const;
  /// 16 hex digits over to_json(): which calibration a result was computed with.
  [[nodiscard]] std::string hash() const;
};

}  // namespace alhazen
