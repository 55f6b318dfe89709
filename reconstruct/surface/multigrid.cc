#include "reconstruct/surface/multigrid.h"

#include <cmath>

#include "alhazen/check.h"
#include "reconstruct/vote/parallel.h"

namespace alhazen {
namespace {

/// A level of at most this many cells is the coarsest; it is smoothed until it is as good as
/// solved.
constexpr std::size_t kCoarsest = 64;
constexpr int kCoarsestSweeps = 16;
/// Smoothing before and after each coarser correction.
constexpr int kSweeps = 1;

/// b_i − (A x)_i. Differences are taken before sums: what is subtracted are near equals.
template <class Real>
[[nodiscard]] Real residual_at(const GridSystem& system, const std::vector<float>& b,
                               const std::vector<float>& x, std::size_t i) {
  const auto here = static_cast<Real>(x[i]);
  Real sum = static_cast<Real>(b[i]) - static_cast<Real>(system.mass[i]) * here;
  for (std::size_t side = 0; side < 6; ++side) {
    const std::uint32_t j = system.neighbour[i][side];
    if (j == GridSystem::kNone) continue;
    sum += static_cast<Real>(system.weight_to(i, side)) * (static_cast<Real>(x[j]) - here);
  }
  return sum;
}

[[nodiscard]] double dot(const std::vector<float>& a, const std::vector<float>& b) {
  return sum_blocks<1>(a.size(), [&](std::size_t begin, std::size_t end) {
    double sum = 0;
    for (std::size_t i = begin; i < end; ++i) sum += static_cast<double>(a[i]) * b[i];
    return std::array<double, 1>{sum};
  })[0];
}

}  // namespace

Multigrid::Multigrid(GridSystem finest) {
  levels_.push_back(prepared(std::move(finest)));
  while (levels_.back().system.size() > kCoarsest) {
    std::vector<std::uint32_t> parent;
    GridSystem coarse = coarsened(levels_.back().system, parent);
    if (coarse.size() == levels_.back().system.size()) break;
    levels_.back().parent = std::move(parent);
    levels_.push_back(prepared(std::move(coarse)));
    levels_.back().b.resize(levels_.back().system.size());
  }
}

Multigrid::Level Multigrid::prepared(GridSystem system) {
  const std::size_t n = system.size();
  ALHAZEN_CHECK(system.neighbour.size() == n && system.weight.size() == n &&
                system.mass.size() == n);
  Level level;
  level.inverse_diagonal.resize(n);
  level.is_red.resize(n);
  level.x.assign(n, 0.0F);
  for_blocks(n, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      float diagonal = system.mass[i];
      for (std::size_t side = 0; side < 6; ++side) diagonal += system.weight_to(i, side);
      level.inverse_diagonal[i] = diagonal > 0 ? 1 / diagonal : 0;
      const std::array<std::uint16_t, 3>& c = system.cell[i];
      level.is_red[i] = static_cast<std::uint8_t>((c[0] + c[1] + c[2]) & 1);
    }
  });
  level.system = std::move(system);
  return level;
}

GridSystem Multigrid::coarsened(const GridSystem& fine, std::vector<std::uint32_t>& parent) {
  GridSystem coarse;
  parent.resize(fine.size());
  for (std::size_t i = 0; i < fine.size(); ++i) {
    const std::array<std::uint16_t, 3> cell{static_cast<std::uint16_t>(fine.cell[i][0] / 2),
                                            static_cast<std::uint16_t>(fine.cell[i][1] / 2),
                                            static_cast<std::uint16_t>(fine.cell[i][2] / 2)};
    if (coarse.cell.empty() || coarse.cell.back() != cell) {
      coarse.cell.push_back(cell);
      coarse.mass.push_back(0);
    }
    parent[i] = static_cast<std::uint32_t>(coarse.cell.size() - 1);
    coarse.mass.back() += fine.mass[i];
  }
  coarse.neighbour.resize(coarse.size());
  coarse.weight.resize(coarse.size());
  for (std::size_t p = 0; p < coarse.size(); ++p) {
    coarse.neighbour[p].fill(GridSystem::kNone);
    coarse.weight[p].fill(0);
  }
  for (std::size_t i = 0; i < fine.size(); ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::uint32_t j = fine.neighbour[i][2 * axis + 1];
      if (j == GridSystem::kNone || parent[i] == parent[j]) continue;
      coarse.neighbour[parent[i]][2 * axis + 1] = parent[j];
      coarse.neighbour[parent[j]][2 * axis] = parent[i];
      // Area over distance: the fine edges between two parents in parallel, at twice the distance.
      coarse.weight[parent[i]][axis] += 0.5F * fine.weight[i][axis];
    }
  }
  return coarse;
}

void Multigrid::smooth(const Level& level, bool red, const std::vector<float>& b,
                       std::vector<float>& x) {
  // Cells of one colour have neighbours of the other only, so their order does not matter.
  for_blocks(level.system.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if ((level.is_red[i] != 0) != red) continue;
      x[i] += level.inverse_diagonal[i] * residual_at<float>(level.system, b, x, i);
    }
  });
}

void Multigrid::cycle(std::size_t k, const std::vector<float>& b) {
  Level& level = levels_[k];
  std::fill(level.x.begin(), level.x.end(), 0.0F);
  const bool is_coarsest = k + 1 == levels_.size();
  for (int sweep = 0; sweep < (is_coarsest ? kCoarsestSweeps : kSweeps); ++sweep) {
    smooth(level, true, b, level.x);
    smooth(level, false, b, level.x);
  }
  if (!is_coarsest) {
    Level& coarse = levels_[k + 1];
    std::fill(coarse.b.begin(), coarse.b.end(), 0.0F);
    // After the black half sweep the black cells have no residual; children of one parent follow
    // each other, so blocks are cut between parents.
    const std::size_t n = level.system.size();
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      while (begin > 0 && begin < end && level.parent[begin] == level.parent[begin - 1]) ++begin;
      while (end < n && level.parent[end] == level.parent[end - 1]) ++end;
      for (std::size_t i = begin; i < end; ++i) {
        if (level.is_red[i] == 0) continue;
        coarse.b[level.parent[i]] += residual_at<float>(level.system, b, level.x, i);
      }
    });
    cycle(k + 1, coarse.b);
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) level.x[i] += coarse.x[level.parent[i]];
    });
  }
  // The mirror image of the sweeps before: the cycle is symmetric, as conjugate gradients need.
  for (int sweep = 0; sweep < (is_coarsest ? kCoarsestSweeps : kSweeps); ++sweep) {
    smooth(level, false, b, level.x);
    smooth(level, true, b, level.x);
  }
}

double Multigrid::residual(const std::vector<float>& b, const std::vector<float>& x) const {
  const GridSystem& system = levels_[0].system;
  const std::array<double, 2> squares =
      sum_blocks<2>(system.size(), [&](std::size_t begin, std::size_t end) {
        std::array<double, 2> sum{};
        for (std::size_t i = begin; i < end; ++i) {
          const double r = residual_at<double>(system, b, x, i);
          sum[0] += r * r;
          sum[1] += static_cast<double>(b[i]) * b[i];
        }
        return sum;
      });
  return squares[0] > 0 ? std::sqrt(squares[0] / squares[1]) : 0;
}

Result<Multigrid::Solved> Multigrid::solve(const std::vector<float>& b, double tolerance,
                                           int max_iterations, const Run& run,
                                           std::vector<float>& x) {
  const GridSystem& system = levels_[0].system;
  const std::size_t n = system.size();
  ALHAZEN_CHECK(b.size() == n && x.size() == n);
  std::vector<float> r(n), p(n, 0.0F), q(n);
  const std::vector<float> zero(n, 0.0F);
  const std::vector<float>& z = levels_[0].x;
  for_blocks(n, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      r[i] = static_cast<float>(residual_at<double>(system, b, x, i));
  });
  const double bound = tolerance * std::sqrt(dot(b, b));
  Solved solved;
  double rz_before = 0;
  while (solved.iterations < max_iterations && std::sqrt(dot(r, r)) > bound) {
    if (run.stopped()) return Error{Code::cancelled, "the signed distance was stopped"};
    cycle(0, r);
    const double rz = dot(r, z);
    const auto beta = static_cast<float>(solved.iterations == 0 ? 0 : rz / rz_before);
    rz_before = rz;
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) p[i] = z[i] + beta * p[i];
    });
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) q[i] = -residual_at<float>(system, zero, p, i);
    });
    const auto step = static_cast<float>(rz / dot(p, q));
    for_blocks(n, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        x[i] += step * p[i];
        r[i] -= step * q[i];
      }
    });
    ++solved.iterations;
  }
  solved.residual = residual(b, x);
  return solved;
}

}  // namespace alhazen
