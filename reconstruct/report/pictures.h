#pragma once

#include <filesystem>
#include <map>
#include <span>
#include <string>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/report/colouring.h"
#include "reconstruct/report/report.h"

namespace alhazen {

/// A picture as PNG.
struct StillPicture {
  std::string file;   ///< to keep
  std::string small;  ///< for a page that shows many of them; empty: the same as `file`
};

/// Pictures by what they show: "error_front", "slice_divergence", "light_map_000_left_c1_u".
using Pictures = std::map<std::string, StillPicture>;

/// The mesh from six sides in each colouring, the slices, the light maps' places along u and v.
/// Fails: internal (a picture could not be encoded), exhausted.
/// REQUIRES: indices within the vertices; report.mesh are the figures of `mesh`.
[[nodiscard]] Result<Pictures> draw_pictures(const Report& report, const Mesh& mesh,
                                             std::span<const Colouring> colourings);

/// Writes each as NAME.png into `folder`, which is made where it is missing, and removes pictures
/// of such names that an earlier report left there. Fails: as write_file_safely().
[[nodiscard]] Status write_pictures(const Pictures& pictures, const std::filesystem::path& folder);

/// Names of pictures. `view` is that of a ViewDirection, `axis` u or v.
[[nodiscard]] std::string view_name(const std::string& colouring_file, const char* view);
[[nodiscard]] std::string light_map_picture_name(const StackKey& key, char axis);

/// How wide the pictures of six sides are on the object.
[[nodiscard]] double views_extent_mm(const Report& report);
/// What the ends of the divergence's colours stand for, 1/mm.
[[nodiscard]] double divergence_limit_per_mm(const Slice& slice);

}  // namespace alhazen
