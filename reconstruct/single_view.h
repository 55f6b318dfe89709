#pragma once

#include "alhazen/result.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/normals/normal_map.h"
#include "reconstruct/options.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/run.h"

namespace alhazen {

/// A mesh from one normal map alone. One view has no parallax, so nothing can vote: depth comes
/// from integrate_normals(), its scale so that the median lies at the depth of the volume's centre.
/// From there it is the way of every reconstruction: the octree follows the surface, signed
/// distance from normals and depths, contour. Sides along the outline and a flat back close it,
/// unobserved.
///
/// Fails: as integrate_normals() and Reconstruction::make(); invalid (camera not of the rig, the
/// surface does not meet the volume), cancelled. Reentrant; uses the caller's TBB arena; the result
/// does not depend on the number of threads.
[[nodiscard]] Result<Reconstructed> reconstruct_single_view(const Rig& rig, const NormalMap& map,
                                                            const Volume& volume, int level,
                                                            const Options& options, const Run& run);

}  // namespace alhazen
