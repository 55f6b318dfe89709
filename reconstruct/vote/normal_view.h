#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/normals/normal_map.h"
#include "reconstruct/options.h"
#include "reconstruct/vote/clearance.h"
#include "reconstruct/vote/tiles.h"

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
  Tiles tiles;  ///< of the cells: 1 where one is set

  Clearance clear;  ///< the background; its box is the map's region
  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// Prepares a map for voting.
/// Fails: invalid (camera not of the rig, region outside the sensor, lists of another length, a
/// normal that is not a unit vector).
[[nodiscard]] Result<NormalView> make_normal_view(const NormalMap& map, const Rig& rig,
                                                  const VoteOptions& options);

}  // namespace alhazen
