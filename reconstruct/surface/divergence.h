#pragma once

#include <vector>

#include "reconstruct/vote/normal_field.h"
#include "reconstruct/vote/octree.h"

namespace alhazen {

/// div(c N) per leaf in 1/mm, by finite volumes: (1/V_i) Σ_f ± A_f φ_f with the flux
/// φ_f = ½ (c_a N_a + c_b N_b)·e_f through each face; nothing flows through the volume's boundary.
/// With N outward it is positive just inside the surface and negative just outside.
///
/// Inputs: `faces` = octree.faces(); field.normal and field.consistency as long as octree.leaves().
/// Source: flux term after Lempitsky and Boykov, CVPR 2007, as M. Weinmann's thesis, chapter 5,
/// uses it. Reentrant; the result does not depend on the number of threads.
[[nodiscard]] std::vector<float> flux_divergence(const Octree& octree,
                                                 const std::vector<Face>& faces,
                                                 const NormalField& field);

}  // namespace alhazen
