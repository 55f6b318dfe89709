#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/options.h"
#include "reconstruct/run.h"
#include "tests/experiment/experiment.h"

/// Experiments with other sources of normals than light maps. Each answers rows of a table: one
/// JSON object with figures with units in their keys, bounds they are held against as must_… and
/// aim_….
namespace alhazen::experiment {

using Rows = std::vector<Row>;

/// How a mesh is seen for normals_of_mesh().
struct NormalViews {
  std::vector<double> elevations_deg;  ///< of cameras
  int stops = 15;                      ///< of the turntable, evenly spread
  double pixel_mm = 0.15;              ///< on the object
  int level = 9;
  double noise_rad = 0;  ///< added to the normals, and told to voting
};

/// A mesh scaled to `height_mm`, standing on the plate of the default volume, with smooth normals.
/// `y_is_up`: turned so that the file's y is z. Fails: as read_mesh().
[[nodiscard]] Result<Mesh> standing_mesh(const std::filesystem::path& file, double height_mm,
                                         bool y_is_up);

/// Normal maps of a mesh from all around, reconstructed and compared with it.
[[nodiscard]] Result<Rows> normals_of_mesh(const std::string& name, const Mesh& mesh,
                                           const NormalViews& views, const Options& options,
                                           const std::filesystem::path& out, const Run& run);

/// The Happy Buddha from 75 normal maps. `data`: ALHAZEN_DATA; `out`: folder for the mesh, or
/// empty. Fails: unavailable (no data).
[[nodiscard]] Result<Rows> buddha_normals(const std::filesystem::path& data,
                                          const std::filesystem::path& out, const Run& run);

/// Photometric stereo on `sets` of ps_uw, which are "gray" (the matte ball), "buddha", "cat" and
/// "horse": against the true normals of the ball, else its residual.
[[nodiscard]] Result<Rows> real_photometric_stereo(const std::filesystem::path& data,
                                                   const std::vector<std::string>& sets,
                                                   const std::filesystem::path& out,
                                                   const Run& run);

/// A simulated clay mask with painted, glossy parts under 198 lights, seen by 11 cameras from
/// `stops` stops (2: 22 views, 24: 264).
[[nodiscard]] Result<Rows> clay_mask(int stops, const std::filesystem::path& out, const Run& run);

/// Objects of DiLiGenT: their true normals integrated, against their true depth.
[[nodiscard]] Result<Rows> diligent_depths(const std::filesystem::path& data, const Run& run);

}  // namespace alhazen::experiment
