#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/mesh/clean.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/report/compare.h"
#include "reconstruct/report/light_map_sample.h"
#include "reconstruct/report/slice.h"
#include "reconstruct/run.h"
#include "reconstruct/scan/scan.h"

namespace alhazen {

/// How the scan went.
struct CaptureFigures {
  std::uint64_t frames = 0;      ///< that went into light maps
  std::uint64_t retakes = 0;     ///< frames that had to be taken again
  std::uint64_t bytes = 0;       ///< of the scan directory
  double duration_s = 0;         ///< first to last exposure, on the daemon's time line
  std::vector<StageTime> times;  ///< of the scan's stages; empty where nobody measured them
  std::vector<std::string> warnings;
};

/// What the scan directory itself proves: all but `times` and `warnings`.
/// Fails: as Scan::frame_log(), and unavailable.
[[nodiscard]] Result<CaptureFigures> capture_figures(const Scan& scan);

/// Where a result came from.
struct Provenance {
  std::string scan_id, created_at, object_id, note, operator_name;
  std::string software_version;  ///< that wrote the scan
  std::string rig_hash, coding;
  std::size_t cameras = 0, displays = 0, stops = 0;
  std::size_t light_maps = 0;  ///< that were reconstructed from
  std::size_t normal_maps = 0;
  std::size_t light_maps_planned = 0;
};

/// What the reconstruction computed with.
struct ReconstructionFigures {
  Volume volume;
  int level = 0;  ///< finest leaves that occur
  double voxel_mm = 0;
  std::size_t leaves = 0;
  std::uint64_t hypotheses = 0;
  int cut_iterations = 0;
  double cut_energy = 0, cut_gap = 0;
  std::vector<StageTime> times;
  std::vector<std::string> warnings;
};

struct MeshFigures {
  std::size_t vertices = 0, triangles = 0;
  MeshCheck check;
  double observed_share = 0;  ///< of the area, by triangles whose three vertices are observed
  double observed_area_mm2 = 0;
  std::optional<double> median_consistency;     ///< of the observed vertices, where known
  std::optional<double> median_depth_sigma_mm;  ///< of the observed vertices, where known
  Eigen::Vector3d low_mm = Eigen::Vector3d::Zero(), high_mm = Eigen::Vector3d::Zero();
};

/// The numbers and the origin of a result: report.json is this struct, each key with its unit.
struct Report {
  Provenance provenance;
  CaptureFigures capture;
  ReconstructionFigures reconstruction;
  std::optional<Refinement> refinement;  ///< of the calibration, where it was asked for
  MeshFigures mesh;
  std::optional<Comparison> comparison;    ///< where a reference was given
  std::string reference;                   ///< name of its file, empty where none was given
  std::optional<Slice> slice;              ///< stored beside, as slice.pfm
  std::vector<LightMapSample> light_maps;  ///< to look at; stored in the scan alone

  /// What parse() gives back, but for the pictures' data (slice, light_maps, comparison.signed_mm).
  [[nodiscard]] std::string to_json() const;
  /// Fails: corrupt, naming the key. Hostile input welcome.
  [[nodiscard]] static Result<Report> parse(std::string_view json);
  /// A few lines for a terminal.
  [[nodiscard]] std::string brief() const;
};

/// Gathers the report of a reconstruction. `reference` may be null.
/// Fails: as compare() and light_map_samples().
[[nodiscard]] Result<Report> make_report(const Scan& scan, const Reconstructed& reconstructed,
                                         CaptureFigures capture, const Mesh* reference,
                                         const Run& run);

/// The same for what came from no scan directory.
[[nodiscard]] Result<Report> make_report(Provenance provenance, const Reconstructed& reconstructed,
                                         CaptureFigures capture, const Mesh* reference,
                                         const Run& run);

/// Figures of a mesh. A mesh without `observed` counts as observed everywhere.
/// REQUIRES: indices within the vertices; per-vertex lists empty or of their number.
[[nodiscard]] MeshFigures mesh_figures(const Mesh& mesh);

/// Writes report.json, report.html, the page's pictures as PNG files in the folder pictures and,
/// where there is a slice, slice.pfm into `directory`, each there completely or not at all.
/// Fails: as write_file_safely() and draw_pictures().
/// REQUIRES: report.mesh are the figures of `mesh`.
[[nodiscard]] Status write_report(const Report& report, const Mesh& mesh,
                                  const std::filesystem::path& directory);

/// Reads report.json and slice.pfm of a directory. Fails: unavailable, corrupt.
[[nodiscard]] Result<Report> read_report(const std::filesystem::path& directory);

}  // namespace alhazen
