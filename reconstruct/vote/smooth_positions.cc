#include "reconstruct/vote/smooth_positions.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace alhazen {
namespace {

/// A position this many of its neighbours' usual distances from their median is wrong, or so many
/// standard deviations.
constexpr float kWrongSteps = 1.5F, kWrongSigmas = 6;
/// A code is coarse whose standard deviation is above this share of the change from one pixel to
/// the next: phases have a hundredth or less, Gray code limited by blur a tenth.
constexpr float kCoarseShare = 0.03F;
/// The mean error of a box-shaped pixel, f''/24, and of bilinear look-up, f''/12, an axis.
constexpr double kBias = 1.0 / 24 + 1.0 / 12;

/// Weights of the quadratic that fits a window of (2r + 1)² pixels best: of its value in the middle
/// less kBias times its Laplacian. Both are α + β(x² + y²) by symmetry; α and β follow from what
/// they make of 1 and of x².
template <int kReach>
class Window {
 public:
  Window() {
    constexpr double side = kSide;
    double s2 = 0, s4 = 0;
    for (int x = -kReach; x <= kReach; ++x) {
      s2 += x * x;
      s4 += x * x * x * x;
    }
    const double spread = side * s4 + s2 * s2 - 2 * s2 * s2;
    // Value: Σ w = 1, Σ w x² = 0. Laplacian: Σ w = 0, Σ w x² = 2.
    const double value = -s2 / (side * spread), laplacian = 2 / spread;
    const double slope = value - kBias * laplacian;
    const double base =
        1 / (side * side) - 2 * s2 / side * value + kBias * 2 * s2 / side * laplacian;
    for (int y = -kReach; y <= kReach; ++y) {
      for (int x = -kReach; x <= kReach; ++x) {
        weights_[index(x, y)] = static_cast<float>(base + slope * (x * x + y * y));
      }
    }
  }
  [[nodiscard]] float at(int x, int y) const { return weights_[index(x, y)]; }

 private:
  static constexpr std::size_t kSide = std::size_t{2} * kReach + 1;
  static std::size_t index(int x, int y) {
    return static_cast<std::size_t>(y + kReach) * kSide + static_cast<std::size_t>(x + kReach);
  }
  std::array<float, kSide * kSide> weights_;
};

class Smoother {
 public:
  Smoother(Positions& positions, const float (&jump_px)[2]) : p_(positions) {
    jump_px_[0] = jump_px[0];
    jump_px_[1] = jump_px[1];
    sigma_px_[0] = p_.sigma_u_px;
    sigma_px_[1] = p_.sigma_v_px;
  }

  void run() {
    repair();
    find_whole();
    const bool is_coarse = is_coarse_along(0) || is_coarse_along(1);
    // What is read must not have been written.
    const std::vector<float> from = p_.uv_px;
    static const Window<1> narrow;
    static const Window<2> wide;
    for (int y = 1; y + 1 < p_.height; ++y) {
      for (int x = 1; x + 1 < p_.width; ++x) {
        if (is_coarse && is_whole<2>(x, y)) {
          fit(wide, x, y, from);
        } else if (is_whole<1>(x, y)) {
          fit(narrow, x, y, from);
        }
      }
    }
  }

 private:
  [[nodiscard]] std::size_t pixel(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(p_.width) +
           static_cast<std::size_t>(x);
  }
  [[nodiscard]] float value(int x, int y, std::size_t axis) const {
    return p_.uv_px[2 * pixel(x, y) + axis];
  }

  /// Sides first, then corners.
  static constexpr int kAround[8][2] = {{-1, 0},  {1, 0},  {0, -1}, {0, 1},
                                        {-1, -1}, {1, -1}, {-1, 1}, {1, 1}};

  [[nodiscard]] bool is_surrounded(int x, int y) const {
    return p_.is_valid[pixel(x, y)] != 0 &&
           std::all_of(std::begin(kAround), std::end(kAround), [&](const auto& step) {
             return p_.is_valid[pixel(x + step[0], y + step[1])];
           });
  }

  [[nodiscard]] bool is_wrong(int x, int y) const {
    for (std::size_t axis = 0; axis < 2; ++axis) {
      std::array<float, 8> around;
      for (std::size_t k = 0; k < 8; ++k)
        around[k] = value(x + kAround[k][0], y + kAround[k][1], axis);
      const float middle = median(around);
      const float off = std::abs(value(x, y, axis) - middle);
      for (float& v : around) v = std::abs(v - middle);
      if (off > kWrongSteps * median(around) + kWrongSigmas * sigma_px_[axis] + 1) return true;
    }
    return false;
  }
  static float median(std::array<float, 8> list) {
    std::nth_element(list.begin(), list.begin() + 4, list.end());
    const float upper = list[4];
    return 0.5F * (upper + *std::max_element(list.begin(), list.begin() + 4));
  }

  void repair() {
    std::vector<std::size_t> wrong;
    std::vector<std::uint8_t> is_bad(p_.is_valid.size(), 0);
    for (int y = 1; y + 1 < p_.height; ++y) {
      for (int x = 1; x + 1 < p_.width; ++x) {
        if (!is_surrounded(x, y) || !is_wrong(x, y)) continue;
        is_bad[pixel(x, y)] = 1;
        wrong.push_back(pixel(x, y));
      }
    }
    for (const std::size_t i : wrong) {
      const int x = static_cast<int>(i % static_cast<std::size_t>(p_.width));
      const int y = static_cast<int>(i / static_cast<std::size_t>(p_.width));
      const bool is_alone = std::none_of(
          std::begin(kAround), std::end(kAround),
          [&](const auto& step) { return is_bad[pixel(x + step[0], y + step[1])] != 0; });
      if (!is_alone) {
        p_.is_valid[i] = 0;
        continue;
      }
      for (std::size_t axis = 0; axis < 2; ++axis) {
        float sides = 0, corners = 0;
        for (std::size_t k = 0; k < 8; ++k) {
          (k < 4 ? sides : corners) += value(x + kAround[k][0], y + kAround[k][1], axis);
        }
        p_.uv_px[2 * i + axis] = 0.5F * sides - 0.25F * corners;
      }
    }
  }

  /// Which cells (the square between a pixel and its right and lower neighbours) are whole.
  void find_whole() {
    cells_.assign(p_.is_valid.size(), 0);
    for (int y = 0; y + 1 < p_.height; ++y) {
      for (int x = 0; x + 1 < p_.width; ++x) {
        const std::size_t a = pixel(x, y), c = pixel(x, y + 1);
        if (!p_.is_valid[a] || !p_.is_valid[a + 1] || !p_.is_valid[c] || !p_.is_valid[c + 1])
          continue;
        bool is_torn = false;
        for (std::size_t axis = 0; axis < 2; ++axis) {
          const auto [low, high] =
              std::minmax({p_.uv_px[2 * a + axis], p_.uv_px[2 * (a + 1) + axis],
                           p_.uv_px[2 * c + axis], p_.uv_px[2 * (c + 1) + axis]});
          is_torn = is_torn || high - low > jump_px_[axis];
        }
        cells_[a] = is_torn ? 0 : 1;
      }
    }
  }

  template <int kReach>
  [[nodiscard]] bool is_whole(int x, int y) const {
    if (x < kReach || y < kReach || x + kReach >= p_.width || y + kReach >= p_.height) return false;
    for (int j = -kReach; j < kReach; ++j) {
      for (int i = -kReach; i < kReach; ++i) {
        if (cells_[pixel(x + i, y + j)] == 0) return false;
      }
    }
    return true;
  }

  [[nodiscard]] bool is_coarse_along(std::size_t axis) const {
    std::vector<float> steps;
    for (std::size_t i = 0; i + 1 < cells_.size(); i += 7) {
      if (cells_[i] == 0) continue;
      const std::size_t below = i + static_cast<std::size_t>(p_.width);
      steps.push_back(std::max(std::abs(p_.uv_px[2 * (i + 1) + axis] - p_.uv_px[2 * i + axis]),
                               std::abs(p_.uv_px[2 * below + axis] - p_.uv_px[2 * i + axis])));
    }
    if (steps.empty()) return false;
    const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    return sigma_px_[axis] > kCoarseShare * *middle;
  }

  template <int kReach>
  void fit(const Window<kReach>& window, int x, int y, const std::vector<float>& from) {
    float u = 0, v = 0;
    for (int j = -kReach; j <= kReach; ++j) {
      for (int i = -kReach; i <= kReach; ++i) {
        const float weight = window.at(i, j);
        const std::size_t at = 2 * pixel(x + i, y + j);
        u += weight * from[at];
        v += weight * from[at + 1];
      }
    }
    p_.uv_px[2 * pixel(x, y)] = u;
    p_.uv_px[2 * pixel(x, y) + 1] = v;
  }

  Positions& p_;
  float jump_px_[2], sigma_px_[2];
  std::vector<std::uint8_t> cells_;
};

}  // namespace

void smooth_positions(Positions& positions, float jump_u_px, float jump_v_px) {
  Smoother(positions, {jump_u_px, jump_v_px}).run();
}

}  // namespace alhazen
