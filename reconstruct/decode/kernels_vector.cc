// The loops of kernels.h on vectors: compiled once for every instruction set that x86 and Arm
// processors of these years have, chosen at run time.
#include "reconstruct/decode/kernels.h"

#include <limits>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/decode/kernels_vector.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include "reconstruct/decode/half_bits-inl.h"

HWY_BEFORE_NAMESPACE();
namespace alhazen::decode {
namespace HWY_NAMESPACE {
#if HWY_TARGET == HWY_SCALAR
// One lane is not worth planes of bits: a processor without vectors runs the reference.
const Kernels& kernels() { return scalar_kernels(); }
#else
namespace hn = hwy::HWY_NAMESPACE;

using D8 = hn::ScalableTag<std::uint8_t>;
using D16 = hn::ScalableTag<std::uint16_t>;
using D32 = hn::ScalableTag<float>;
using V8 = hn::Vec<D8>;
using V16 = hn::Vec<D16>;
using V32 = hn::Vec<D32>;

/// Unsigned a ≥ b, which Highway has for signed lanes only.
template <class V>
HWY_INLINE auto at_least(V a, V b) {
  return hn::Eq(hn::Max(a, b), a);
}

template <class Dn>
void contrast(const ContrastRule& rule, const Dn* white_list, const Dn* black_list,
              std::size_t tiles, std::size_t tile_bytes, Dn* contrast_dn, std::uint8_t* saturated) {
  const hn::ScalableTag<Dn> d;
  const auto full_scale = hn::Set(d, static_cast<Dn>(rule.full_scale));
  const auto least = hn::Set(d, static_cast<Dn>(rule.least));
  for (std::size_t i = 0; i < tiles * kTile_px; i += hn::Lanes(d)) {
    const auto white = hn::LoadU(d, white_list + i);
    const auto difference = hn::SaturatedSub(white, hn::LoadU(d, black_list + i));
    hn::Stream(difference, d, contrast_dn + i);
    std::uint8_t* plane = saturated + i / kTile_px * tile_bytes + i % kTile_px / 8;
    hn::StoreMaskBits(d, at_least(white, full_scale), plane);
    hn::StoreMaskBits(d, at_least(difference, least), plane + kPlaneBytes);
  }
}

/// One tile's thresholds.
template <class Dn>
HWY_INLINE void write_thresholds(const ContrastRule& rule, const Dn* contrast_dn, Dn* thresholds) {
  const D16 d16;
  const V16 least = hn::Set(d16, rule.least);
  const V16 noise = hn::Set(d16, rule.noise);
  const V16 modulation = hn::Set(d16, rule.modulation_q16);
  const V16 never = hn::Set(d16, std::numeric_limits<Dn>::max());
  const hn::Rebind<Dn, D16> d_dn;
  for (std::size_t i = 0; i < kTile_px; i += hn::Lanes(d16)) {
    V16 contrast_16;
    if constexpr (sizeof(Dn) == 1) {
      contrast_16 = hn::PromoteTo(d16, hn::Load(d_dn, contrast_dn + i));
    } else {
      contrast_16 = hn::Load(d_dn, contrast_dn + i);
    }
    const V16 share = hn::Max(hn::MulHigh(contrast_16, modulation), noise);
    const V16 threshold = hn::IfThenElse(at_least(contrast_16, least), share, never);
    if constexpr (sizeof(Dn) == 1) {
      hn::Store(hn::TruncateTo(d_dn, threshold), d_dn, thresholds + i);
    } else {
      hn::Store(threshold, d_dn, thresholds + i);
    }
  }
}

/// One tile of a pair into `planes`, its three in a row.
template <class Dn>
HWY_INLINE void write_planes(const Dn* pattern_list, const Dn* inverse_list,
                             const Dn* threshold_list, std::uint8_t* planes) {
  const hn::ScalableTag<Dn> d;
  const auto zero = hn::Zero(d);
  for (std::size_t i = 0; i < kTile_px; i += hn::Lanes(d)) {
    const auto pattern = hn::LoadU(d, pattern_list + i);
    const auto inverse = hn::LoadU(d, inverse_list + i);
    const auto threshold = hn::Load(d, threshold_list + i);
    const auto difference =
        hn::Or(hn::SaturatedSub(pattern, inverse), hn::SaturatedSub(inverse, pattern));
    const auto is_clear = hn::Gt(difference, threshold);
    const auto weak =
        hn::AverageRound(threshold, hn::AverageRound(hn::AverageRound(threshold, zero), zero));
    const auto next = hn::IfThenElse(is_clear, hn::SaturatedAdd(threshold, threshold), weak);
    hn::StoreMaskBits(d, hn::Gt(pattern, inverse), planes + i / 8);
    hn::StoreMaskBits(d, is_clear, planes + kPlaneBytes + i / 8);
    hn::StoreMaskBits(d, hn::Gt(difference, next), planes + 2 * kPlaneBytes + i / 8);
  }
}

template <class Dn>
void pairs(const ContrastRule& rule, const Dn* contrast_dn, std::span<const FramePair<Dn> > list,
           std::size_t tiles, std::size_t tile_bytes) {
  const D8 d8;
  constexpr std::size_t kPairBytes = kPlanesPerBit * kPlaneBytes;
  alignas(kOutAlignment) Dn thresholds[kTile_px];
  alignas(kOutAlignment) std::uint8_t planes[kMaxPairsAtOnce * kPairBytes];
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    const std::size_t first = tile * kTile_px;
    write_thresholds(rule, contrast_dn + first, thresholds);
    for (std::size_t k = 0; k < list.size(); ++k) {
      write_planes(list[k].pattern + first, list[k].inverse + first, thresholds,
                   planes + k * kPairBytes);
    }
    // Past the caches: they would fetch what is about to be overwritten.
    for (std::size_t k = 0; k < list.size(); ++k) {
      for (std::size_t i = 0; i < kPairBytes; i += hn::Lanes(d8)) {
        hn::Stream(hn::Load(d8, planes + k * kPairBytes + i), d8,
                   list[k].sign + tile * tile_bytes + i);
      }
    }
  }
}

/// Finishing works on as many pixels at a time as a vector has bits, one bit each: the logic of
/// read_place() of the scalar kernels, bit by bit of the code instead of pixel by pixel.
constexpr std::size_t kBlockBytes = HWY_MAX_BYTES;
struct alignas(HWY_MAX_BYTES) BlockPlane {
  std::uint8_t bytes[kBlockBytes];
};
HWY_INLINE V8 load(const BlockPlane& plane) { return hn::Load(D8(), plane.bytes); }
HWY_INLINE void store(V8 bits, BlockPlane& plane) { hn::Store(bits, D8(), plane.bytes); }

/// Bit by bit, which Highway's own choice is not on every processor.
HWY_INLINE V8 select(V8 which, V8 yes, V8 no) {
  return hn::OrAnd(hn::AndNot(which, no), which, yes);
}

/// What one axis says of a block of pixels: planes of its numbers, the lowest bit first.
constexpr int kBitPlanes = 4;  // kMaxBits is less than 2^4
struct AxisPlanes {
  BlockPlane agrees;
  BlockPlane on_edge;                 ///< of the next finer bit, and too near to tell its side
  BlockPlane bit[kBitPlanes];         ///< the finest resolved; the number of bits where none is
  BlockPlane centre_2[kMaxBits + 1];  ///< twice the centre, px
};

/// `planes`: of the tile, from the block's first byte on.
HWY_INLINE void read_axis(const AxisBits& axis, const std::uint8_t* planes, unsigned coarsest,
                          AxisPlanes& out) {
  const D8 d8;
  const V8 zero = hn::Zero(d8);
  const V8 ones = hn::Not(zero);
  const auto plane = [&](int bit, std::size_t which) {
    return hn::LoadU(
        d8, planes + (axis.first_plane +
                      static_cast<std::size_t>(bit - axis.lowest) * kPlanesPerBit + which) *
                         kPlaneBytes);
  };
  const auto sign_of = [&](int bit) { return plane(bit, 0); };
  const auto clear_of = [&](int bit) { return plane(bit, 1); };
  const auto strong_of = [&](int bit) { return plane(bit, 2); };

  // without_side_lobe(): from fine to coarse, is every bit from the finest resolved one on as it
  // would be were the next one the suspect (`fits`), were it farther up (`fits_so_far`)?
  V8 inverted = zero;
  {
    V8 any = zero, one = zero, several = zero, fits = zero, fits_so_far = zero;
    for (int bit = axis.lowest; bit < axis.bits; ++bit) {
      const V8 sign = sign_of(bit), clear = clear_of(bit);
      const V8 suspect = hn::AndNot(clear, any);
      const V8 finest = hn::AndNot(any, clear);
      several = hn::OrAnd(several, one, suspect);
      one = hn::Or(one, suspect);
      inverted = hn::OrAnd(inverted, suspect, fits);
      fits = select(finest, hn::Not(sign), hn::And(sign, fits_so_far));
      fits_so_far = select(finest, sign, hn::AndNot(sign, fits_so_far));
      any = hn::Or(any, clear);
    }
    inverted = hn::AndNot(several, inverted);
  }

  BlockPlane finest_of[kMaxBits + 1], unresolved_of[kMaxBits + 1];
  V8 any = zero, one = zero, several = zero, not_strong = zero, has_sign = zero;
  {
    V8 any_seeming = zero, strong_below = zero;
    for (int bit = axis.lowest; bit < axis.bits; ++bit) {
      const V8 seeming = clear_of(bit), strong = strong_of(bit);
      const V8 clear = hn::AndNot(hn::AndNot(any_seeming, inverted), seeming);
      const V8 finest = hn::AndNot(any, clear);
      const V8 unresolved = hn::AndNot(clear, any);
      any_seeming = hn::Or(any_seeming, seeming);
      several = hn::OrAnd(several, one, unresolved);
      one = hn::Or(one, unresolved);
      any = hn::Or(any, clear);
      not_strong = hn::Or(not_strong, hn::AndNot(hn::And(clear, strong), any));
      has_sign = hn::OrAnd(has_sign, finest, strong_below);
      strong_below = strong;
      store(finest, finest_of[bit]);
      store(unresolved, unresolved_of[bit]);
    }
    store(zero, finest_of[axis.bits]);
    has_sign = hn::AndNot(not_strong, has_sign);
    const V8 has_next = hn::AndNot(load(finest_of[axis.lowest]), hn::AndNot(not_strong, any));
    store(hn::AndNot(has_sign, has_next), out.on_edge);
  }

  // From coarse to fine: the cell's first and last position, and whether they are beyond the
  // display.
  BlockPlane first_of[kMaxBits], last_of[kMaxBits];
  V8 over = zero;
  {
    V8 within = any, binary = zero, mixed = several, unresolved_above = zero, seen = zero;
    V8 first_less = zero, first_more = zero, last_less = zero;
    V8 index[kBitPlanes] = {zero, zero, zero, zero};
    for (int bit = axis.bits - 1; bit >= 0; --bit) {
      const bool is_limit = ((axis.last_px >> bit) & 1) != 0;
      V8 first = zero, cell = zero;
      if (bit >= axis.lowest) {
        const V8 gray = hn::And(sign_of(bit), within);
        binary = hn::Xor(binary, gray);
        first = hn::And(binary, within);
        mixed = hn::OrAnd(mixed, seen, hn::Xor(gray, unresolved_above));
        unresolved_above = load(unresolved_of[bit]);
        seen = hn::Or(seen, unresolved_above);
        cell = select(has_sign, load(finest_of[bit + 1]), load(finest_of[bit]));
        for (int k = 0; k < kBitPlanes; ++k) {
          if (((bit >> k) & 1) != 0) index[k] = hn::Or(index[k], cell);
        }
        if ((1U << bit) > coarsest) mixed = hn::Or(mixed, cell);
      }
      const V8 last = hn::Or(first, hn::Not(within));
      if (is_limit) {
        first_less = hn::Or(first_less, hn::AndNot(first, hn::Not(first_more)));
        last_less = hn::Or(last_less, hn::AndNot(last, hn::Not(over)));
      } else {
        first_more = hn::Or(first_more, hn::AndNot(first_less, first));
        over = hn::Or(over, hn::AndNot(last_less, last));
      }
      store(first, first_of[bit]);
      store(last, last_of[bit]);
      within = hn::AndNot(cell, within);
    }
    store(hn::AndNot(hn::Or(mixed, first_more), any), out.agrees);
    for (int k = 0; k < kBitPlanes; ++k) {
      const V8 none = ((axis.bits >> k) & 1) != 0 ? hn::AndNot(any, ones) : zero;
      store(hn::Or(index[k], none), out.bit[k]);
    }
  }

  // The sum of both, the last one no farther than the display.
  V8 carry = zero;
  for (int bit = 0; bit < axis.bits; ++bit) {
    const V8 first = load(first_of[bit]);
    V8 last = load(last_of[bit]);
    last = ((axis.last_px >> bit) & 1) != 0 ? hn::Or(last, over) : hn::AndNot(over, last);
    const V8 differ = hn::Xor(first, last);
    store(hn::Xor(differ, carry), out.centre_2[bit]);
    carry = select(differ, carry, first);
  }
  store(carry, out.centre_2[axis.bits]);
}

/// Bytes from planes of their bits.
HWY_INLINE V8 gather(const BlockPlane* planes, int count, std::size_t byte) {
  const D8 d8;
  V8 code = hn::Zero(d8);
  V8 one = hn::Set(d8, 1);
  for (int i = 0; i < count; ++i) {
    // Adding instead of or-ing: processors with masks do it in one instruction.
    code = hn::IfThenElse(hn::LoadMaskBits(d8, planes[i].bytes + byte), hn::Add(code, one), code);
    one = hn::Add(one, one);
  }
  return code;
}

/// One axis of a block, a number a pixel.
struct AxisNumbers {
  alignas(HWY_MAX_BYTES) std::uint16_t centre_2[8 * kBlockBytes];
  /// Of twice the width of the interval that the pixel lies in, a power of two, px.
  alignas(HWY_MAX_BYTES) std::uint8_t exponent[8 * kBlockBytes];
};
HWY_INLINE void write_numbers(const AxisBits& axis, const AxisPlanes& planes, std::size_t count,
                              AxisNumbers& numbers, std::uint8_t* bit_list) {
  const D8 d8;
  const D16 d16;
  const hn::Half<D8> d8_half;
  const V8 one = hn::Set(d8, 1);
  const int low_count = axis.bits + 1 < 8 ? axis.bits + 1 : 8;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d8)) {
    const V8 low = gather(planes.centre_2, low_count, i / 8);
    const V8 high = gather(planes.centre_2 + 8, axis.bits + 1 - low_count, i / 8);
    const auto join = [&](auto low_half, auto high_half) {
      return hn::Or(hn::PromoteTo(d16, low_half), hn::ShiftLeft<8>(hn::PromoteTo(d16, high_half)));
    };
    hn::Store(join(hn::LowerHalf(low), hn::LowerHalf(high)), d16, numbers.centre_2 + i);
    hn::Store(join(hn::UpperHalf(d8_half, low), hn::UpperHalf(d8_half, high)), d16,
              numbers.centre_2 + i + hn::Lanes(d16));
    const V8 bit = gather(planes.bit, kBitPlanes, i / 8);
    hn::Stream(bit, d8, bit_list + i);
    const auto on_edge = hn::LoadMaskBits(d8, planes.on_edge.bytes + i / 8);
    hn::Store(hn::IfThenElse(on_edge, hn::Sub(bit, one), hn::Add(bit, one)), d8,
              numbers.exponent + i);
  }
}

/// A vector of floats' mask from a plane; fewer than eight lanes are a part of a byte.
HWY_INLINE hn::Mask<D32> mask_32(const std::uint8_t* plane, std::size_t pixel) {
  const auto bits = static_cast<std::uint8_t>(plane[pixel / 8] >> (pixel % 8));
  return hn::LoadMaskBits(D32(), hn::MaxLanes(D32()) < 8 ? &bits : plane + pixel / 8);
}

template <class Dn>
void finish(const FinalRule& rule, const std::uint8_t* planes, const Dn* contrast_dn,
            const FinalOut& out) {
  const D8 d8;
  const D32 d32;
  const hn::RebindToSigned<D32> di32;
  const hn::RebindToUnsigned<D32> du32;
  const hn::Rebind<std::uint8_t, D32> d8_32;
  const hn::Rebind<std::uint16_t, D32> d16_32;
  // Copies: stores of bytes might otherwise change them for all that the compiler knows.
  const AxisBits axis_u = rule.u, axis_v = rule.v;
  const FinalOut to = out;
  // Not hn::NaN(), whose bits are not those of the standard library.
  const V32 nothing = hn::Set(d32, std::numeric_limits<float>::quiet_NaN());
  const auto no_sigma = hn::Set(du32, std::numeric_limits<Imath::half>::quiet_NaN().bits());
  const auto most = hn::Set(di32, 255);
  const V32 half = hn::Set(d32, 0.5F);
  const V32 to_255 = hn::Set(d32, rule.to_255);
  const V32 noise = hn::Set(d32, 0.5F * rule.noise_square);
  const V32 cell_sigma = hn::Set(d32, 0.5F * kCellSigma);
  const auto of = [](const auto* list, std::size_t i) {
    using T = std::remove_cv_t<std::remove_pointer_t<decltype(list)> >;
    return hn::PromoteTo(hn::RebindToSigned<D32>(), hn::Load(hn::Rebind<T, D32>(), list + i));
  };
  // A position's bit of the label, one that others have too, and their own.
  static_assert(static_cast<int>(Label::none) == 0 && static_cast<int>(Label::mirror) == 1 &&
                static_cast<int>(Label::mixed) == 3 && static_cast<int>(Label::saturated) == 4);
  const std::size_t block_px = 8 * hn::Lanes(d8);
  for (std::size_t first = 0; first < kTile_px; first += block_px) {
    AxisPlanes planes_u, planes_v;
    read_axis(axis_u, planes + first / 8, rule.coarsest, planes_u);
    read_axis(axis_v, planes + first / 8, rule.coarsest, planes_v);
    const std::uint8_t* saturated_plane = planes + rule.saturated_plane * kPlaneBytes + first / 8;
    const V8 saturated = hn::LoadU(d8, saturated_plane);
    const V8 enough = hn::LoadU(d8, saturated_plane + kPlaneBytes);
    const V8 position = hn::And(enough, hn::And(load(planes_u.agrees), load(planes_v.agrees)));
    const V8 mixed = hn::AndNot(hn::Or(position, saturated), enough);
    BlockPlane label[3];
    store(hn::Or(position, mixed), label[0]);
    store(mixed, label[1]);
    store(hn::AndNot(position, saturated), label[2]);
    BlockPlane is_position;
    store(position, is_position);

    AxisNumbers u, v;
    write_numbers(axis_u, planes_u, block_px, u, to.bit_u + first);
    write_numbers(axis_v, planes_v, block_px, v, to.bit_v + first);
    for (std::size_t i = 0; i < block_px; i += hn::Lanes(d8)) {
      hn::Stream(gather(label, 3, i / 8), d8,
                 reinterpret_cast<std::uint8_t*>(to.label) + first + i);
    }
    alignas(HWY_MAX_BYTES) std::uint16_t sigma_u[8 * kBlockBytes], sigma_v[8 * kBlockBytes];
    alignas(HWY_MAX_BYTES) std::uint8_t contrast_255[8 * kBlockBytes];
    for (std::size_t i = 0; i < block_px; i += hn::Lanes(d32)) {
      const auto mask = mask_32(is_position.bytes, i);
      const V32 contrast_32 = hn::ConvertTo(d32, of(contrast_dn + first, i));
      if constexpr (sizeof(Dn) > 1) {
        const auto whole = hn::Min(hn::NearestInt(hn::Mul(contrast_32, to_255)), most);
        hn::Store(hn::TruncateTo(d8_32, hn::BitCast(du32, whole)), d8_32, contrast_255 + i);
      }
      const V32 half_sigma = hn::Add(cell_sigma, hn::Div(noise, hn::Mul(contrast_32, contrast_32)));
      const auto place = [&](const AxisNumbers& axis, float* centre, std::uint16_t* sigma) {
        const V32 centre_px = hn::Mul(half, hn::ConvertTo(d32, of(axis.centre_2, i)));
        hn::Stream(hn::IfThenElse(mask, centre_px, nothing), d32, centre + first + i);
        // Times a power of two.
        const V32 sigma_px = hn::BitCast(
            d32, hn::Add(hn::BitCast(di32, half_sigma), hn::ShiftLeft<23>(of(axis.exponent, i))));
        hn::Store(hn::TruncateTo(d16_32, hn::IfThenElse(hn::RebindMask(du32, mask),
                                                        half_bits(sigma_px), no_sigma)),
                  d16_32, sigma + i);
      };
      place(u, to.u_px, sigma_u);
      place(v, to.v_px, sigma_v);
    }
    const auto stream = [&](const auto* from, auto* list) {
      using T = std::remove_cvref_t<decltype(*from)>;
      const hn::ScalableTag<T> d;
      for (std::size_t i = 0; i < block_px; i += hn::Lanes(d)) {
        hn::Stream(hn::Load(d, from + i), d, reinterpret_cast<T*>(list) + first + i);
      }
    };
    stream(sigma_u, to.sigma_u_px);
    stream(sigma_v, to.sigma_v_px);
    if constexpr (sizeof(Dn) == 1) {
      stream(contrast_dn + first, to.contrast);
    } else {
      stream(contrast_255, to.contrast);
    }
  }
}

const Kernels& kernels() {
  static constexpr Kernels kKernels = {contrast<std::uint8_t>, contrast<std::uint16_t>,
                                       pairs<std::uint8_t>,    pairs<std::uint16_t>,
                                       finish<std::uint8_t>,   finish<std::uint16_t>};
  return kKernels;
}
#endif

}  // namespace HWY_NAMESPACE
}  // namespace alhazen::decode
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace alhazen::decode {

HWY_EXPORT(kernels);

const Kernels& vector_kernels() { return HWY_DYNAMIC_DISPATCH(kernels)(); }

}  // namespace alhazen::decode
#endif  // HWY_ONCE
