#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/run.h"

namespace alhazen {

/// A symmetric positive definite system on cells of a grid of which only some exist:
///   (A x)_i = mass_i x_i + Σ_neighbours weight_ij (x_i − x_j)
/// Cells in Morton order, so that the eight of one parent follow each other.
struct GridSystem {
  static constexpr std::uint32_t kNone = 0xffffffffU;
  std::vector<std::array<std::uint16_t, 3>> cell;       ///< position on the grid
  std::vector<std::array<std::uint32_t, 6>> neighbour;  ///< -x +x -y +y -z +z; kNone: no such cell
  std::vector<std::array<float, 3>> weight;  ///< towards +x, +y, +z; ignored where there is no cell
  std::vector<float> mass;                   ///< ≥ 0, somewhere positive in each connected part

  [[nodiscard]] std::size_t size() const noexcept { return cell.size(); }
  /// The weight towards neighbour `side` of cell i; 0 where there is none.
  [[nodiscard]] float weight_to(std::size_t i, std::size_t side) const {
    const std::uint32_t j = neighbour[i][side];
    if (j == kNone) return 0;
    return side % 2 == 1 ? weight[i][side / 2] : weight[j][side / 2];
  }
};

/// Conjugate gradients preconditioned by one symmetric multigrid cycle: red-black Gauss-Seidel on
/// each level, parents of eight cells as the next level, with the weights that the same equation
/// has on cells of twice the size. Vectors are float, sums double. Reentrant apart from solve();
/// uses the caller's TBB arena; the same result for any number of threads.
/// Source: Briggs, Henson, McCormick, A Multigrid Tutorial, 2000; cell-centred coarsening: Mohr and
/// Wienands, Computing and Visualization in Science 2004.
class Multigrid {
 public:
  explicit Multigrid(GridSystem finest);

  struct Solved {
    int iterations = 0;
    double residual = 0;  ///< ‖b − A x‖ / ‖b‖, recomputed in double
  };
  /// Improves `x` until the residual is at most `tolerance` or `max_iterations` are spent.
  /// Fails: cancelled. REQUIRES: lists as long as the system.
  [[nodiscard]] Result<Solved> solve(const std::vector<float>& b, double tolerance,
                                     int max_iterations, const Run& run, std::vector<float>& x);
  /// ‖b − A x‖ / ‖b‖ in double; 0 where b and x are zero.
  [[nodiscard]] double residual(const std::vector<float>& b, const std::vector<float>& x) const;

 private:
  struct Level {
    GridSystem system;
    std::vector<float> inverse_diagonal;
    std::vector<std::uint8_t> is_red;
    std::vector<std::uint32_t> parent;  ///< in the next level; empty on the coarsest
    std::vector<float> x, b;            ///< of the cycle; b only below the finest
  };
  [[nodiscard]] static Level prepared(GridSystem system);
  [[nodiscard]] static GridSystem coarsened(const GridSystem& fine,
                                            std::vector<std::uint32_t>& parent);
  static void smooth(const Level& level, bool red, const std::vector<float>& b,
                     std::vector<float>& x);
  /// levels_[k].x ← an approximate solution for b.
  void cycle(std::size_t k, const std::vector<float>& b);

  std::vector<Level> levels_;
};

}  // namespace alhazen
