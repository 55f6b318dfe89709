#pragma once

#include <filesystem>
#include <span>

#include "alhazen/result.h"
#include "reconstruct/surface/indicator.h"
#include "reconstruct/vote/normal_field.h"
#include "reconstruct/vote/octree.h"

namespace alhazen {

/// Writes what voting and cut know of each leaf as VTK's unstructured grid (.vtu: XML, appended
/// base64), which ParaView and VTK open. One voxel cell a leaf, mm, object frame; neighbours of one
/// size share corners. Cell data: normal (3), consistency, support, votes, free_space,
/// no_surface, divergence_per_mm, indicator, level. There completely or not at all.
/// REQUIRES: lists as long as the octree's leaves.
/// Fails: exhausted (no space), unavailable (folder missing or read-only).
/// Source: "VTK XML Formats", docs.vtk.org.
[[nodiscard]] Status write_vtu(const Octree& octree, const NormalField& field,
                               std::span<const float> divergence_per_mm, const Indicator& indicator,
                               const std::filesystem::path& file);

}  // namespace alhazen
