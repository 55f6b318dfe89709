#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/normals/normal_map.h"
#include "reconstruct/options.h"

namespace alhazen {

/// One camera at one stop: what its maps have in common.
struct View {
  std::size_t camera = 0;
  Pose camera_from_object;
  Eigen::Vector3d eye_object_mm;
  std::size_t begin = 0, end = 0;  ///< its light maps
};

/// What voting keeps of one normal map: normals turned into the object frame, cropped to the
/// object, and how far each pixel is from the object.
struct NormalView {
  NormalMapKey key;
  double angle_rad = 0;
  View view;
  float noise_rad = 0;

  /// The box of sensor pixels that holds all normals; (x, y, z) triples row by row, and one byte
  /// per *cell* (the square between four pixels, named by the top left one): 1 where all four have
  /// a normal and turn by less than VoteOptions::normal_jump_rad from each other.
  Region box;
  std::vector<float> normal;
  std::vector<std::uint8_t> cells;
  /// One byte per kTilePx × kTilePx cells, row by row: 1 if any of them is set.
  std::vector<std::uint8_t> tiles;

  /// The region of the map, and per pixel the chessboard distance to the nearest pixel that is not
  /// background, at most 255.
  Region clear_box;
  std::vector<std::uint8_t> clear_px;

  static constexpr int kTilePx = 16;
  /// Whether any cell of [x0, x1] × [y0, y1] (sensor pixels) may be set.
  [[nodiscard]] bool may_see(double x0, double y0, double x1, double y1) const;
  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// Prepares a map for voting.
/// Fails: invalid (camera not of the rig, region outside the sensor, lists of another length, a
/// normal that is not a unit vector).
[[nodiscard]] Result<NormalView> make_normal_view(const NormalMap& map, const Rig& rig,
                                                  const VoteOptions& options);

}  // namespace alhazen
