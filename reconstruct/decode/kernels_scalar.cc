#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "reconstruct/decode/kernels.h"
#include "reconstruct/pattern/gray_code.h"

namespace alhazen::decode {
namespace {

void set_bit(std::uint8_t* plane, std::size_t pixel, bool value) {
  const std::uint32_t bit = 1U << (pixel % 8);
  plane[pixel / 8] =
      static_cast<std::uint8_t>(value ? plane[pixel / 8] | bit : plane[pixel / 8] & ~bit);
}

bool get_bit(const std::uint8_t* plane, std::size_t pixel) {
  return ((plane[pixel / 8] >> (pixel % 8)) & 1U) != 0;
}

template <class Dn>
void contrast(const ContrastRule& rule, const Dn* white, const Dn* black, std::size_t tiles,
              std::size_t tile_bytes, Dn* contrast_out, std::uint8_t* saturated) {
  for (std::size_t i = 0; i < tiles * kTile_px; ++i) {
    std::uint8_t* plane = saturated + i / kTile_px * tile_bytes;
    const Dn difference = white[i] > black[i] ? static_cast<Dn>(white[i] - black[i]) : Dn{0};
    contrast_out[i] = difference;
    set_bit(plane, i % kTile_px, white[i] >= rule.full_scale);
    set_bit(plane + kPlaneBytes, i % kTile_px, difference >= rule.least);
  }
}

template <class Dn>
Dn threshold_of(const ContrastRule& rule, Dn contrast) {
  if (contrast < rule.least) return std::numeric_limits<Dn>::max();
  const std::uint32_t share = (std::uint32_t{contrast} * rule.modulation_q16) >> 16;
  return static_cast<Dn>(std::max<std::uint32_t>(share, rule.noise));
}

template <class Dn>
void pairs(const ContrastRule& rule, const Dn* contrast, std::span<const FramePair<Dn>> pairs,
           std::size_t tiles, std::size_t tile_bytes) {
  for (const FramePair<Dn>& pair : pairs) {
    for (std::size_t i = 0; i < tiles * kTile_px; ++i) {
      std::uint8_t* plane = pair.sign + i / kTile_px * tile_bytes;
      const std::size_t pixel = i % kTile_px;
      const Dn threshold = threshold_of(rule, contrast[i]);
      const int difference = std::abs(int{pair.pattern[i]} - int{pair.inverse[i]});
      const bool is_clear = difference > threshold;
      set_bit(plane, pixel, pair.pattern[i] > pair.inverse[i]);
      set_bit(plane + kPlaneBytes, pixel, is_clear);
      set_bit(plane + 2 * kPlaneBytes, pixel,
              difference > (is_clear ? 2 * int{threshold} : weak_threshold(threshold)));
    }
  }
}

/// The place on the display that one axis's bits name.
struct Place {
  bool agrees = false;
  int bit = 0;          ///< the finest resolved one; the number of bits where none is
  float centre_px = 0;  ///< where it agrees
  float width_px = 0;   ///< of the interval that it lies in, where it agrees
};

/// Takes back the finest resolved bit where it came back inverted, AxisBits.
std::uint32_t without_side_lobe(std::uint32_t sign, std::uint32_t clear, std::uint32_t shown) {
  const std::uint32_t finest = clear & (0U - clear);
  const std::uint32_t unresolved = shown & ~clear & ~(finest - 1);
  const bool is_inverted =
      std::has_single_bit(unresolved) &&
      (sign & ~(finest - 1) & (unresolved - 1)) == ((unresolved >> 1) ^ finest);
  return is_inverted ? clear & (clear - 1) : clear;
}

Place read_place(const AxisBits& axis, const std::uint8_t* planes, std::size_t pixel,
                 std::uint32_t coarsest) {
  std::uint32_t sign = 0, clear = 0, strong = 0, shown = 0;
  const std::uint8_t* plane = planes + axis.first_plane * kPlaneBytes;
  for (int bit = axis.lowest; bit < axis.bits; ++bit, plane += kPlanesPerBit * kPlaneBytes) {
    shown |= 1U << bit;
    sign |= static_cast<std::uint32_t>(get_bit(plane, pixel)) << bit;
    clear |= static_cast<std::uint32_t>(get_bit(plane + kPlaneBytes, pixel)) << bit;
    strong |= static_cast<std::uint32_t>(get_bit(plane + 2 * kPlaneBytes, pixel)) << bit;
  }
  clear = without_side_lobe(sign, clear, shown);
  if (clear == 0) return {false, axis.bits, 0, 0};
  const std::uint32_t finest = clear & (0U - clear);
  const std::uint32_t coarser = shown & ~(finest - 1);
  // The next finer bit lies on its edge where all others are strong: AxisBits.
  const std::uint32_t next = (clear & strong) == coarser ? (finest >> 1) & shown : 0;
  const bool has_sign = (next & strong) != 0;
  const std::uint32_t cell = has_sign ? next : finest;

  const std::uint32_t below = cell - 1;
  const std::uint32_t gray = sign & ~below;
  // Any other bit is unresolved only where the pixel lies on its edge. There the finer bits read
  // 10…0 on both sides, so whatever its sign, the cell is one of the two neighbours. Anything else
  // is a mixture of places.
  const std::uint32_t unresolved = coarser & ~clear;
  const bool is_neighbour =
      (unresolved & (unresolved - 1)) == 0 && (gray & (unresolved - 1)) == (unresolved >> 1);
  const std::uint32_t first_px = binary_from_gray(gray) & ~below;
  const std::uint32_t last_px = std::min<std::uint32_t>(first_px | below, axis.last_px);
  Place place;
  place.bit = std::countr_zero(cell);
  place.agrees = (unresolved == 0 || is_neighbour) && first_px <= axis.last_px && cell <= coarsest;
  place.centre_px = 0.5F * static_cast<float>(first_px + last_px);
  // On an edge the cell's centre is that edge, and it is at most a quarter of a finer cell away.
  place.width_px = 0.5F * static_cast<float>(next != 0 && !has_sign ? next : 2 * cell);
  return place;
}

template <class Dn>
void finish(const FinalRule& rule, const std::uint8_t* planes, const Dn* contrast_dn,
            const FinalOut& out) {
  constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
  const auto kNoSigma = std::numeric_limits<Imath::half>::quiet_NaN();
  const std::uint8_t* saturated = planes + rule.saturated_plane * kPlaneBytes;
  for (std::size_t i = 0; i < kTile_px; ++i) {
    const Place u = read_place(rule.u, planes, i, rule.coarsest);
    const Place v = read_place(rule.v, planes, i, rule.coarsest);
    const bool is_enough = get_bit(saturated + kPlaneBytes, i);
    const bool is_position = is_enough && u.agrees && v.agrees;
    const auto contrast_f = static_cast<float>(contrast_dn[i]);
    const float sigma_cells = kCellSigma + rule.noise_square / (contrast_f * contrast_f);
    out.u_px[i] = is_position ? u.centre_px : kNothing;
    out.v_px[i] = is_position ? v.centre_px : kNothing;
    out.sigma_u_px[i] = is_position ? Imath::half(u.width_px * sigma_cells) : kNoSigma;
    out.sigma_v_px[i] = is_position ? Imath::half(v.width_px * sigma_cells) : kNoSigma;
    out.contrast[i] =
        static_cast<std::uint8_t>(std::min(std::nearbyint(contrast_f * rule.to_255), 255.0F));
    out.label[i] = is_position             ? Label::mirror
                   : get_bit(saturated, i) ? Label::saturated
                   : is_enough             ? Label::mixed
                                           : Label::none;
    out.bit_u[i] = static_cast<std::uint8_t>(u.bit);
    out.bit_v[i] = static_cast<std::uint8_t>(v.bit);
  }
}

}  // namespace

const Kernels& scalar_kernels() {
  static constexpr Kernels kKernels = {contrast<std::uint8_t>, contrast<std::uint16_t>,
                                       pairs<std::uint8_t>,    pairs<std::uint16_t>,
                                       finish<std::uint8_t>,   finish<std::uint16_t>};
  return kKernels;
}

}  // namespace alhazen::decode
