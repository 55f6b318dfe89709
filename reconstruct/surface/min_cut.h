#pragma once

#include <vector>

#include "alhazen/result.h"
#include "reconstruct/options.h"
#include "reconstruct/run.h"
#include "reconstruct/surface/indicator.h"
#include "reconstruct/vote/normal_field.h"
#include "reconstruct/vote/octree.h"

namespace alhazen {

/// The inside of the object: minimises E(u) = ∫ g|∇u| − λ ∫ u div(cN) over u: leaves → [0, 1] with
/// g = max(g_min, exp(−β c)). Leaves in free space and leaves at the volume's boundary are outside
/// (u = 0). Lengths in units of the finest leaf's edge, so energies have no unit.
///
/// Each leaf i owns a copy p_if of the flow through each of its faces f = (i, j):
///   y_if = √(A_f / 2A_i) (u_j − u_i) / d_f,   primal  Σ V_i (g_i ‖y_i‖ + f_i u_i),  f = −λ div(cN)
///   ‖p_i‖ ≤ g_i (an exact projection),        dual    Σ min(0, V_i f_i + (Kᵀp)_i)
/// solved by the first-order primal-dual method with diagonal steps until the duality gap is at
/// most options.relative_gap of the surface term Σ V_i g_i ‖y_i‖, or options.max_iterations are
/// spent (not an error: Indicator::gap tells).
///
/// `faces` = octree.faces(); `divergence` = flux_divergence(…). `warm_start`: u from before, on
/// this octree (carry it over with Octree::leaf_in), or null: then coarser octrees are solved
/// first. Fails: invalid (lists of another length, `warm_start` outside [0, 1]), cancelled.
/// Reentrant; uses the caller's TBB arena; the result is the same for any number of threads.
/// Source: Chambolle and Pock, JMIV 2011; diagonal steps: Pock and Chambolle, ICCV 2011; energy:
/// M. Weinmann's thesis, chapter 5, and Weinmann, Osep, Ruiters, Klein, ICCV 2013.
[[nodiscard]] Result<Indicator> min_cut(const Octree& octree, const std::vector<Face>& faces,
                                        const NormalField& field,
                                        const std::vector<float>& divergence,
                                        const SurfaceOptions& options, const Indicator* warm_start,
                                        const Run& run);

}  // namespace alhazen
