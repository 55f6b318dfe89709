#pragma once

#include <array>
#include <string>
#include <vector>

#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/report/colour.h"
#include "reconstruct/report/report.h"

namespace alhazen {

/// One way to colour a mesh, for the still pictures and for the view that can be turned.
struct Colouring {
  std::string name;                   ///< "Error"
  std::string file;                   ///< the same as part of a file's name
  std::string explained;              ///< one line
  std::vector<Colour> stops;          ///< colours from share 0 to 1; empty: all is clay
  std::array<std::string, 3> labels;  ///< with units, at 0, ½ and 1 of the stops
  std::vector<float> share;  ///< per vertex 0 … 1; NaN: not observed; empty without stops
  float relief = 1;          ///< how much light models the form, 0 … 1

  [[nodiscard]] Colour of(std::size_t vertex) const {
    if (stops.empty()) return kClay;
    return std::isnan(share[vertex]) ? kUnobserved : at_share(stops, share[vertex]);
  }
};

/// What the mesh and the report know per vertex: the surface as it is; its error where there is a
/// comparison; standard deviation of depth, consistency and coverage where the mesh tells them.
/// REQUIRES: per-vertex lists empty or of the vertices' number, comparison.signed_mm likewise.
[[nodiscard]] std::vector<Colouring> colourings_of(const Report& report, const Mesh& mesh);

/// `file` of every colouring that there can be.
inline constexpr std::array<const char*, 5> kColouringFiles{
    "surface", "error", "standard_deviation", "consistency", "coverage"};

}  // namespace alhazen
