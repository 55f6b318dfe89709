#include "reconstruct/surface/divergence.h"

#include <algorithm>

#include "alhazen/check.h"

namespace alhazen {

std::vector<float> flux_divergence(const Octree& octree, const std::vector<Face>& faces,
                                   const NormalField& field) {
  ALHAZEN_CHECK(field.normal.size() == octree.size());
  ALHAZEN_CHECK(field.consistency.size() == octree.size());
  // One pass in the order of the faces: cheap beside the faces' own making, and the sum of a leaf
  // has one order whatever the number of threads.
  std::vector<double> outflow_mm2(octree.size(), 0.0);
  const std::vector<Leaf>& leaves = octree.leaves();
  for (const Face& face : faces) {
    const double flux =
        0.5 * (static_cast<double>(field.consistency[face.a]) * field.normal[face.a][face.axis] +
               static_cast<double>(field.consistency[face.b]) * field.normal[face.b][face.axis]);
    const std::size_t finer = leaves[face.a].level >= leaves[face.b].level ? face.a : face.b;
    const double edge_mm = octree.edge_mm(finer);
    outflow_mm2[face.a] += flux * edge_mm * edge_mm;
    outflow_mm2[face.b] -= flux * edge_mm * edge_mm;
  }
  std::vector<float> divergence(octree.size());
  for (std::size_t i = 0; i < octree.size(); ++i) {
    const double edge_mm = octree.edge_mm(i);
    divergence[i] = static_cast<float>(outflow_mm2[i] / (edge_mm * edge_mm * edge_mm));
  }
  return divergence;
}

}  // namespace alhazen
