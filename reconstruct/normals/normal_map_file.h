#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "alhazen/result.h"
#include "reconstruct/geometry/camera_model.h"
#include "reconstruct/geometry/pose.h"
#include "reconstruct/normals/normal_map.h"

namespace alhazen {

/// The axes in which the numbers of a normal map's file are meant.
enum class NormalAxes : std::uint8_t {
  camera,  ///< OpenCV's camera frame: x right, y down, z forward
  opengl,  ///< x right, y up, z towards the viewer: what renderers and most data sets write
  rig,     ///< the rig frame at this stop
};

/// How a file is to be read.
struct NormalMapFormat {
  NormalAxes axes = NormalAxes::camera;
  /// A picture of the same size, 0 background and white object; empty: the file's own alpha channel
  /// says it, and without one a vector of length below ½ is background.
  std::filesystem::path mask;
  /// Of what made the normals. Range [0, 1].
  double noise_rad = 0;
};

/// Reads a normal map of `camera`: PNG with 8 or 16 bits a channel, red green blue =
/// round((n + 1)/2 · (2^bits − 1)), or OpenEXR with FLOAT or HALF channels R G B (or X Y Z) holding
/// n itself (one part of scan lines, not compressed or RLE, ZIP, PIZ), its data window being the
/// region. Object pixels whose vector is not within 0.8 … 1.25
/// of unit length are labelled unknown; the others are made unit.
/// Hostile input welcome.
/// Fails: unavailable, corrupt (damaged, a number that is not finite), unsupported (other
/// channels),
///        invalid (size is not the camera's, mask of another size, no object pixel; most normals
///        face away from the camera or in from the outline: the message names the axes that are
///        turned).
[[nodiscard]] Result<NormalMap> read_normal_map(const std::filesystem::path& file,
                                                const NormalMapFormat& format,
                                                const CameraModel& camera, NormalMapKey key,
                                                double angle_rad);

/// The same from memory.
[[nodiscard]] Result<NormalMap> parse_normal_map(std::string bytes, const NormalMapFormat& format,
                                                 const CameraModel& camera, NormalMapKey key,
                                                 double angle_rad);

/// Writes a normal map by extension: .exr (FLOAT R G B, A 1 object and 0 background; an unknown
/// pixel is an object's with a zero vector) or .png (16 bits, the same with alpha), in the axes
/// `camera`. Written aside, synced, renamed.
/// Fails: unsupported (extension), invalid (lists of another length), exhausted, unavailable.
[[nodiscard]] Status write_normal_map(const NormalMap& map, const std::filesystem::path& file);

/// Whether the normals can be meant as they are. Fails: invalid, saying which axes are turned:
/// - normals of most object pixels face away from the camera;
/// - along the outline, where the surface turns away, normals must point out of it; if they point
///   in along x or y on average, that axis is mirrored.
[[nodiscard]] Status check_facing(const NormalMap& map, const CameraModel& camera);

}  // namespace alhazen
