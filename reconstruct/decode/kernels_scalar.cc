#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "reconstruct/decode/kernels.h"
#include "reconstruct/pattern/gray_code.h"

namespace alhazen::decode {
namespace {

void set_bit(std::uint8_t* plane, std::size_t pixel, bool value) {
  const auto bit = static_cast<std::uint8_t>(1U << (pixel % 8));
  plane[pixel / 8] = static_cast<std::uint8_t>(
      value ? plane[pixel / 8] | bit : plane[pixel / 8] & static_cast<std::uint8_t>(~bit));
}

bool get_bit(const std::uint8_t* plane, std::size_t pixel) {
  return ((plane[pixel / 8] >> (pixel % 8)) & 1U) != 0;
}

template <class Dn>
void contrast(const ContrastRule& rule, const Dn* white, const Dn* black, std::size_t count,
              float* contrast_out, Dn* threshold, std::uint8_t* saturated) {
  for (std::size_t i = 0; i < count; ++i) {
    const int difference = int{white[i]} - int{black[i]};
    contrast_out[i] = static_cast<float>(difference) * rule.per_dn;
    const std::uint32_t share =
        (static_cast<std::uint32_t>(std::max(difference, 0)) * rule.modulation_q16) >> 16;
    threshold[i] = difference < rule.least
                       ? std::numeric_limits<Dn>::max()
                       : static_cast<Dn>(std::max<std::uint32_t>(share, rule.noise));
    set_bit(saturated, i, white[i] >= rule.full_scale);
  }
}

template <class Dn>
void pair(const Dn* pattern, const Dn* inverse, const Dn* threshold, std::size_t count,
          std::uint8_t* sign, std::uint8_t* resolved) {
  for (std::size_t i = 0; i < count; ++i) {
    set_bit(sign, i, pattern[i] > inverse[i]);
    set_bit(resolved, i, std::abs(int{pattern[i]} - int{inverse[i]}) > threshold[i]);
  }
}

/// The cell of the display that one axis's bits name.
struct Cell {
  bool agrees = false;
  int bit = 0;          ///< the finest resolved one; the number of bits where none is
  float centre_px = 0;  ///< where it agrees
};

Cell read_cell(const AxisPlanes& axis, std::size_t pixel, std::uint32_t coarsest) {
  std::uint32_t sign = 0, resolved = 0;
  for (int bit = 0; bit < axis.bits; ++bit) {
    const auto i = static_cast<std::size_t>(bit);
    if (axis.sign[i] == nullptr) continue;
    sign |= static_cast<std::uint32_t>(get_bit(axis.sign[i], pixel)) << bit;
    resolved |= static_cast<std::uint32_t>(get_bit(axis.resolved[i], pixel)) << bit;
  }
  if (resolved == 0) return {false, axis.bits, 0};
  Cell cell;
  cell.bit = std::countr_zero(resolved);
  const std::uint32_t below = (1U << cell.bit) - 1;
  const std::uint32_t gray = sign & ~below;
  // A bit above the finest resolved one has no contrast only where the pixel lies on its edge.
  // There the finer bits read 10…0 on both sides, so whatever its sign, the cell is one of the two
  // neighbours. Anything else is a mixture of places.
  const std::uint32_t unresolved = ~resolved & ~below & ((1U << axis.bits) - 1);
  const bool on_edge =
      std::has_single_bit(unresolved) && (gray & (unresolved - 1)) == (unresolved >> 1);
  const std::uint32_t first_px = binary_from_gray(gray) & ~below;
  cell.agrees =
      (unresolved == 0 || on_edge) && first_px <= axis.last_px && (1U << cell.bit) <= coarsest;
  const std::uint32_t last_px = std::min<std::uint32_t>(first_px | below, axis.last_px);
  cell.centre_px = 0.5F * static_cast<float>(first_px + last_px);
  return cell;
}

void finish(const Final& state, std::size_t begin, std::size_t count, const FinalOut& out) {
  constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t pixel = begin + i;
    const Cell u = read_cell(state.u, pixel, state.coarsest);
    const Cell v = read_cell(state.v, pixel, state.coarsest);
    const bool has_contrast = state.contrast[pixel] >= state.least_contrast;
    const bool is_position = has_contrast && u.agrees && v.agrees;
    const float shift = state.noise / state.contrast[pixel];
    const float sigma_cells = std::sqrt(kCellVariance + shift * shift);
    out.u_px[i] = is_position ? u.centre_px : kNothing;
    out.v_px[i] = is_position ? v.centre_px : kNothing;
    out.sigma_u_px[i] = is_position ? static_cast<float>(1U << u.bit) * sigma_cells : kNothing;
    out.sigma_v_px[i] = is_position ? static_cast<float>(1U << v.bit) * sigma_cells : kNothing;
    out.label[i] = is_position                       ? Label::mirror
                   : get_bit(state.saturated, pixel) ? Label::saturated
                   : has_contrast                    ? Label::mixed
                                                     : Label::none;
    out.bit_u[i] = static_cast<std::uint8_t>(u.bit);
    out.bit_v[i] = static_cast<std::uint8_t>(v.bit);
  }
}

}  // namespace

const Kernels& scalar_kernels() {
  static constexpr Kernels kKernels = {contrast<std::uint8_t>, contrast<std::uint16_t>,
                                       pair<std::uint8_t>, pair<std::uint16_t>, finish};
  return kKernels;
}

}  // namespace alhazen::decode
