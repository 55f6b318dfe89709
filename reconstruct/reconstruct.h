#pragma once

#include <memory>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/normals/normal_map.h"
#include "reconstruct/options.h"
#include "reconstruct/refine/refine.h"
#include "reconstruct/run.h"
#include "reconstruct/scan/light_map.h"
#include "reconstruct/stage_time.h"
#include "reconstruct/surface/indicator.h"
#include "reconstruct/vote/normal_field.h"
#include "reconstruct/vote/octree.h"

namespace alhazen {

/// What a reconstruction hands over.
struct Reconstructed {
  Mesh mesh;
  Octree octree;
  NormalField field;
  std::vector<float> divergence;  ///< div(cN) per leaf, 1/mm: positive just inside the surface
  Indicator indicator;
  std::vector<StageTime> times;
  std::vector<std::string> warnings;  ///< what is wrong with rig or light maps: diagnose()
  std::size_t light_maps = 0, normal_maps = 0;
  std::uint64_t hypotheses = 0;  ///< evaluated in all
};

/// A reconstruction that grows while the scan runs: add(light map) as each becomes safe, preview()
/// at any time, finish() once. The result does not depend on the order of arrival, on previews or
/// on the number of threads.
///
/// Thread: thread-bound (the compute lane); its stages use the caller's TBB arena.
class Reconstruction {
 public:
  /// Fails: invalid (options out of range, volume empty).
  [[nodiscard]] static Result<Reconstruction> make(const Rig& rig, const Volume& volume, int level,
                                                   const Options& options);
  Reconstruction(Reconstruction&&) noexcept;
  Reconstruction& operator=(Reconstruction&&) noexcept;
  ~Reconstruction();

  /// Keeps what voting needs of the map (cropped); the map itself may go.
  /// Fails: invalid (camera or display not of the rig, region outside the sensor, lists of the
  /// wrong
  ///        length), conflict (this key came before).
  Status add(const LightMap& map);
  /// The same for a normal map: its normals vote beside the light maps' hypotheses, its background
  /// is free space. Options::for_normal_maps() suits scans that have nothing else.
  /// Fails: as Observations::add().
  Status add(const NormalMap& map);

  /// A coarse mesh of what is known so far. Fails: conflict (no map yet, nothing consistent),
  /// cancelled.
  [[nodiscard]] Result<Mesh> preview(const Run& run);

  /// Fails: invalid (no map, nothing that agrees: no surface), cancelled, exhausted.
  [[nodiscard]] Result<Reconstructed> finish(const Run& run);

  /// Refines the calibration from the light maps that came, at the observed vertices of a mesh that
  /// finish() made of them. To reconstruct with it, add the maps to a Reconstruction with that rig.
  /// Fails: as refine_rig().
  [[nodiscard]] Result<RefinedRig> refine(const Mesh& mesh, const Run& run) const;

 private:
  struct State;
  explicit Reconstruction(std::unique_ptr<State> state) noexcept;
  [[nodiscard]] Result<Reconstructed> make_all(const Run& run);
  std::unique_ptr<State> state_;
};

}  // namespace alhazen
