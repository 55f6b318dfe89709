#pragma once

#include <span>
#include <string>

#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/report/colouring.h"
#include "reconstruct/report/pictures.h"
#include "reconstruct/report/report.h"

namespace alhazen {

/// One self-contained page (HTML; pictures, scripts and a mesh inside, nothing fetched): the mesh
/// to turn and from six sides, in each colouring; slices of consistency and divergence; light maps;
/// numbers, timings, provenance. Every string of the report is escaped, and no script runs but the
/// program's own.
/// REQUIRES: as scene_of(); `pictures` as draw_pictures() made them of the same.
[[nodiscard]] std::string to_page(const Report& report, const Mesh& mesh,
                                  std::span<const Colouring> colourings, const Pictures& pictures);

}  // namespace alhazen
