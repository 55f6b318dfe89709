#pragma once

#include <string>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/report/report.h"

namespace alhazen {

/// One self-contained page (HTML, pictures inside, no script): the mesh from six sides as it is, by
/// its error where there is a comparison, and by what was observed; slices of consistency and
/// divergence; numbers, timings, provenance. Every string of the report is escaped.
/// Fails: internal (a picture could not be encoded), exhausted.
/// REQUIRES: indices within the vertices; comparison.signed_mm empty or one per vertex.
[[nodiscard]] Result<std::string> to_page(const Report& report, const Mesh& mesh);

}  // namespace alhazen
