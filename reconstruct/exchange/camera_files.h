#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/rig.h"

namespace alhazen {

/// What a camera file of other software says of one camera. Pixel centres are integers, as
/// everywhere here, whatever the file's own custom. Reentrant.
struct ForeignCamera {
  CameraModel model;      ///< of it only what the flags tell, K and distortion are always there
  bool has_size = false;  ///< width and height
  bool has_pose = false;  ///< camera_from_rig
  std::string source;     ///< the file, for messages
};

/// One camera as OpenCV's tools and those after their manner store it: cv::FileStorage's YAML, XML
/// or JSON and ROS's camera_info. Case, '_' and '-' of keys do not matter:
///   camera_matrix | K | M | mtx | intrinsic_matrix …   3×3, skew 0; or fx fy cx cy, bare or as
///                                                      Camera.fx …
///   distortion_coefficients | dist_coeffs | D …        0, 4, 5 or 8 numbers (12 and 14 where what
///                                                      is beyond is 0); or k1 k2 p1 p2 k3 …
///   image_width, image_height | image_size | …         width before height
///   camera_from_rig (4×4) | rvec, tvec                 the pose as solvePnP gives it
/// `suffix`: ends the keys in files of several cameras: "1" reads M1 and D1.
/// `unit_mm`: of the file's lengths.
/// Fails: invalid, naming the key; unsupported (fisheye, thin prism, skew).
[[nodiscard]] Result<ForeignCamera> parse_opencv_camera(std::string_view text,
                                                        std::string_view suffix, double unit_mm);

/// The cameras of a COLMAP model in text form: one for each image, named by the image's file
/// without folder and extension; its world is the rig frame in units of `unit_mm`. COLMAP's pixel
/// centres are at ½. Source: "Output Format", colmap.github.io.
/// Fails: invalid, naming file and line; unsupported (camera models with a fisheye or a prism).
[[nodiscard]] Result<std::vector<ForeignCamera>> parse_colmap(std::string_view cameras_txt,
                                                              std::string_view images_txt,
                                                              double unit_mm);

/// Reads camera files: a folder with COLMAP's cameras.txt and images.txt, or a file of OpenCV's
/// kind, "[NAME=]FILE[#SUFFIX]"; without NAME the camera is called as the file.
/// Fails: as the above, and unavailable.
[[nodiscard]] Result<std::vector<ForeignCamera>> read_cameras(const std::string& source,
                                                              double unit_mm);

/// The rig of a rig.json whose cameras' K, distortion, size and pose may be left out there as far
/// as `cameras` say them; cameras that it does not name are added.
/// Fails: invalid where both say a size and the two differ, naming both; else as Rig::parse().
[[nodiscard]] Result<Rig> rig_with_cameras(std::string_view rig_json,
                                           std::span<const ForeignCamera> cameras);

/// A camera of a COLMAP model to be written: one image.
struct ColmapImage {
  std::string name;  ///< the picture's file
  CameraModel camera;
  Pose camera_from_world;
};
/// The three files of a COLMAP model in text form: cameras.txt, images.txt and a points3D.txt
/// without points. Lengths in mm. Images of one camera name share a camera.
struct ColmapModel {
  std::string cameras_txt, images_txt, points3d_txt;
};
[[nodiscard]] ColmapModel to_colmap(std::span<const ColmapImage> images);

}  // namespace alhazen
