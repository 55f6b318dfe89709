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

HWY_BEFORE_NAMESPACE();
namespace alhazen::decode {
namespace HWY_NAMESPACE {
#if HWY_TARGET == HWY_SCALAR
// One lane is not worth planes of bits: a processor without vectors runs the reference.
void contrast8(const ContrastRule& rule, const std::uint8_t* white, const std::uint8_t* black,
               std::size_t count, std::uint8_t* contrast_dn, std::uint8_t* threshold,
               std::uint8_t* saturated) {
  scalar_kernels().contrast8(rule, white, black, count, contrast_dn, threshold, saturated);
}
void contrast16(const ContrastRule& rule, const std::uint16_t* white, const std::uint16_t* black,
                std::size_t count, std::uint16_t* contrast_dn, std::uint16_t* threshold,
                std::uint8_t* saturated) {
  scalar_kernels().contrast16(rule, white, black, count, contrast_dn, threshold, saturated);
}
void pair8(const std::uint8_t* pattern, const std::uint8_t* inverse, const std::uint8_t* threshold,
           std::size_t count, std::uint8_t* sign) {
  scalar_kernels().pair8(pattern, inverse, threshold, count, sign);
}
void pair16(const std::uint16_t* pattern, const std::uint16_t* inverse,
            const std::uint16_t* threshold, std::size_t count, std::uint8_t* sign) {
  scalar_kernels().pair16(pattern, inverse, threshold, count, sign);
}
void finish8(const FinalRule& rule, const std::uint8_t* planes, const std::uint8_t* contrast_dn,
             const FinalOut& out) {
  scalar_kernels().finish8(rule, planes, contrast_dn, out);
}
void finish16(const FinalRule& rule, const std::uint8_t* planes, const std::uint16_t* contrast_dn,
              const FinalOut& out) {
  scalar_kernels().finish16(rule, planes, contrast_dn, out);
}
#else
namespace hn = hwy::HWY_NAMESPACE;

using D8 = hn::ScalableTag<std::uint8_t>;
using D16 = hn::ScalableTag<std::uint16_t>;
using D32 = hn::ScalableTag<float>;
using V8 = hn::Vec<D8>;
using V16 = hn::Vec<D16>;
using V32 = hn::Vec<D32>;

/// Lanes of small unsigned integers → lanes of float, four vectors a D8, two a D16.
template <class V>
HWY_INLINE V32 float_of(V half_of_16) {
  const hn::RebindToSigned<D32> di32;
  return hn::ConvertTo(D32(), hn::PromoteTo(di32, half_of_16));
}

/// Unsigned a ≥ b, which Highway has for signed lanes only.
HWY_INLINE hn::Mask<D16> at_least(V16 a, V16 b) { return hn::Eq(hn::Max(a, b), a); }

/// White and black as 16-bit lanes at `pixel`, whatever they are stored in.
HWY_INLINE V16 load_16(const std::uint8_t* list, std::size_t pixel) {
  const hn::Rebind<std::uint8_t, D16> d_half;
  return hn::PromoteTo(D16(), hn::LoadU(d_half, list + pixel));
}
HWY_INLINE V16 load_16(const std::uint16_t* list, std::size_t pixel) {
  return hn::LoadU(D16(), list + pixel);
}
HWY_INLINE void store_16(V16 values, std::uint8_t* list, std::size_t pixel) {
  const hn::Rebind<std::uint8_t, D16> d_half;
  hn::StoreU(hn::TruncateTo(d_half, values), d_half, list + pixel);
}
HWY_INLINE void store_16(V16 values, std::uint16_t* list, std::size_t pixel) {
  hn::StoreU(values, D16(), list + pixel);
}

template <class Dn>
HWY_INLINE void contrast(const ContrastRule& rule, const Dn* white_list, const Dn* black_list,
                         std::size_t count, Dn* contrast_dn, Dn* threshold,
                         std::uint8_t* saturated) {
  const D16 d16;
  const V16 full_scale = hn::Set(d16, rule.full_scale);
  const V16 least = hn::Set(d16, rule.least);
  const V16 noise = hn::Set(d16, rule.noise);
  const V16 modulation = hn::Set(d16, rule.modulation_q16);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d16)) {
    const V16 white = load_16(white_list, i);
    const V16 difference = hn::SaturatedSub(white, load_16(black_list, i));
    const V16 share = hn::Max(hn::MulHigh(difference, modulation), noise);
    store_16(difference, contrast_dn, i);
    // All ones, so that no difference of this format is beyond it.
    store_16(hn::IfThenElse(at_least(difference, least), share, hn::Set(d16, 0xFFFF)), threshold,
             i);
    hn::StoreMaskBits(d16, at_least(white, full_scale), saturated + i / 8);
  }
}

template <class Dn>
HWY_INLINE void pair(const Dn* pattern_list, const Dn* inverse_list, const Dn* threshold_list,
                     std::size_t count, std::uint8_t* sign) {
  const hn::ScalableTag<Dn> d;
  const auto zero = hn::Zero(d);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto pattern = hn::LoadU(d, pattern_list + i);
    const auto inverse = hn::LoadU(d, inverse_list + i);
    const auto threshold = hn::LoadU(d, threshold_list + i);
    const auto difference =
        hn::Or(hn::SaturatedSub(pattern, inverse), hn::SaturatedSub(inverse, pattern));
    const auto is_clear = hn::Gt(difference, threshold);
    const auto weak =
        hn::AverageRound(threshold, hn::AverageRound(hn::AverageRound(threshold, zero), zero));
    const auto next = hn::IfThenElse(is_clear, hn::SaturatedAdd(threshold, threshold), weak);
    hn::StoreMaskBits(d, hn::Gt(pattern, inverse), sign + i / 8);
    hn::StoreMaskBits(d, is_clear, sign + kPlaneBytes + i / 8);
    hn::StoreMaskBits(d, hn::Gt(difference, next), sign + 2 * kPlaneBytes + i / 8);
  }
}

/// The three planes of every bit as codes: bytes of 8 bits each, `high` of bits 8 and above.
struct Codes {
  V8 sign, clear, strong;
};
struct AxisCodes {
  Codes low, high;
};
HWY_INLINE Codes gather(const std::uint8_t* plane, int first_bit, int count) {
  const D8 d8;
  Codes codes{hn::Zero(d8), hn::Zero(d8), hn::Zero(d8)};
  V8 one = hn::Set(d8, static_cast<std::uint8_t>(1U << first_bit));
  for (int i = 0; i < count; ++i, plane += kPlanesPerBit * kPlaneBytes) {
    // Adding instead of or-ing: processors with masks do it in one instruction.
    const auto with_bits = [&](V8 code, const std::uint8_t* bits) {
      return hn::IfThenElse(hn::LoadMaskBits(d8, bits), hn::Add(code, one), code);
    };
    codes.sign = with_bits(codes.sign, plane);
    codes.clear = with_bits(codes.clear, plane + kPlaneBytes);
    codes.strong = with_bits(codes.strong, plane + 2 * kPlaneBytes);
    one = hn::Add(one, one);
  }
  return codes;
}
HWY_INLINE AxisCodes gather(const AxisBits& axis, const std::uint8_t* planes, std::size_t pixel) {
  const std::uint8_t* plane = planes + axis.first_plane * kPlaneBytes + pixel / 8;
  const int low = axis.bits < 8 ? axis.bits : 8;
  const int low_shown = axis.lowest < low ? low - axis.lowest : 0;
  const int high_first = axis.lowest < 8 ? 0 : axis.lowest - 8;
  return {gather(plane, axis.lowest < 8 ? axis.lowest : 0, low_shown),
          gather(plane + static_cast<std::size_t>(low_shown) * kPlanesPerBit * kPlaneBytes,
                 high_first, axis.bits - low - high_first)};
}
/// Two bytes of a code as 16-bit lanes: those of the vector's lower or upper half.
template <int kHalf>
HWY_INLINE V16 join(V8 low, V8 high) {
  const D16 d16;
  const hn::Half<D8> d8_half;
  if constexpr (kHalf == 0) {
    return hn::Or(hn::PromoteTo(d16, hn::LowerHalf(low)),
                  hn::ShiftLeft<8>(hn::PromoteTo(d16, hn::LowerHalf(high))));
  } else {
    return hn::Or(hn::PromoteTo(d16, hn::UpperHalf(d8_half, low)),
                  hn::ShiftLeft<8>(hn::PromoteTo(d16, hn::UpperHalf(d8_half, high))));
  }
}

/// read_place() of the scalar kernels, in 16-bit lanes.
struct Places {
  V16 agrees;  ///< all ones or zero
  V16 bit;
  V16 centre_2;  ///< twice the centre, px
  V16 width_2;   ///< twice the width, px
};
template <int kHalf>
HWY_INLINE Places read_places(const AxisBits& axis, const AxisCodes& codes, V16 coarsest) {
  const D16 d16;
  const V16 zero = hn::Zero(d16);
  const V16 one = hn::Set(d16, 1);
  const V16 shown =
      hn::Set(d16, static_cast<std::uint16_t>((1U << axis.bits) - (1U << axis.lowest)));
  const V16 last = hn::Set(d16, axis.last_px);
  const V16 sign = join<kHalf>(codes.low.sign, codes.high.sign);
  const V16 all_clear = join<kHalf>(codes.low.clear, codes.high.clear);
  const V16 strong = join<kHalf>(codes.low.strong, codes.high.strong);
  // without_side_lobe() of the scalar kernels.
  const V16 but_finest = hn::And(all_clear, hn::Sub(all_clear, one));
  const V16 seeming = hn::Sub(all_clear, but_finest);
  const V16 from_seeming = hn::Sub(zero, seeming);
  const V16 suspect = hn::And(hn::AndNot(all_clear, shown), from_seeming);
  const V16 suspect_below = hn::Sub(suspect, one);
  const auto is_single =
      hn::And(hn::Ne(suspect, zero), hn::Eq(hn::And(suspect, suspect_below), zero));
  const V16 read = hn::And(hn::And(sign, from_seeming), suspect_below);
  const auto is_inverted =
      hn::And(is_single, hn::Eq(read, hn::Xor(hn::ShiftRight<1>(suspect), seeming)));
  const V16 clear = hn::IfThenElse(is_inverted, but_finest, all_clear);

  const V16 finest = hn::And(clear, hn::Sub(zero, clear));
  const V16 coarser = hn::AndNot(hn::Sub(finest, one), shown);
  const V16 next = hn::IfThenElseZero(hn::Eq(hn::And(clear, strong), coarser),
                                      hn::And(hn::ShiftRight<1>(finest), shown));
  const auto has_sign = hn::Ne(hn::And(next, strong), zero);
  const V16 cell = hn::IfThenElse(has_sign, next, finest);
  const V16 below = hn::Sub(cell, one);
  const V16 gray = hn::AndNot(below, sign);
  const V16 unresolved = hn::AndNot(clear, coarser);
  const V16 unresolved_below = hn::Sub(unresolved, one);
  const auto is_neighbour =
      hn::And(hn::Eq(hn::And(unresolved, unresolved_below), zero),
              hn::Eq(hn::And(gray, unresolved_below), hn::ShiftRight<1>(unresolved)));
  V16 binary = gray;
  binary = hn::Xor(binary, hn::ShiftRight<1>(binary));
  binary = hn::Xor(binary, hn::ShiftRight<2>(binary));
  binary = hn::Xor(binary, hn::ShiftRight<4>(binary));
  binary = hn::Xor(binary, hn::ShiftRight<8>(binary));
  const V16 first = hn::AndNot(below, binary);
  const auto resolves = hn::And(hn::Ne(clear, zero), at_least(coarsest, cell));
  const auto fits = hn::Or(hn::Eq(unresolved, zero), is_neighbour);
  const auto agrees = hn::And(hn::And(resolves, fits), at_least(last, first));
  // Nothing is resolved: `below` is all ones, but such a pixel's bit is told by the axis.
  const V16 bit =
      hn::IfThenElse(hn::Eq(clear, zero), hn::Set(d16, static_cast<std::uint16_t>(axis.bits)),
                     hn::PopulationCount(below));
  const auto on_edge = hn::AndNot(has_sign, hn::Ne(next, zero));
  return {hn::VecFromMask(d16, agrees), bit, hn::Add(first, hn::Min(hn::Or(first, below), last)),
          hn::IfThenElse(on_edge, next, hn::Add(cell, cell))};
}

template <class Dn>
HWY_INLINE void finish(const FinalRule& rule, const std::uint8_t* planes, const Dn* contrast_dn,
                       const FinalOut& out) {
  const D8 d8;
  const D16 d16;
  const D32 d32;
  const hn::Half<D8> d8_half;
  const hn::Half<D16> d16_half;
  const hn::RebindToSigned<D32> di32;
  const hn::RebindToSigned<decltype(d16_half)> di16_half;
  const std::size_t lanes_16 = hn::Lanes(d16), lanes_32 = hn::Lanes(d32);
  // Copies: stores of bytes might otherwise change them for all that the compiler knows.
  const AxisBits axis_u = rule.u, axis_v = rule.v;
  const FinalOut to = out;
  const std::uint8_t* saturated = planes + rule.saturated_plane * kPlaneBytes;
  const V16 least = hn::Set(d16, rule.least);
  const V16 coarsest = hn::Set(d16, rule.coarsest);
  // Not hn::NaN(), whose bits are not those of the standard library.
  const V32 nothing = hn::Set(d32, std::numeric_limits<float>::quiet_NaN());
  const V32 half = hn::Set(d32, 0.5F);
  const V32 per_dn = hn::Set(d32, rule.per_dn);
  const V32 noise = hn::Set(d32, rule.noise_cells_dn);
  const V32 cell_sigma = hn::Set(d32, kCellSigma);
  const V32 square_to_sigma = hn::Set(d32, kNoiseSquareToSigma);
  const auto label = [](Label value) { return hn::Set(D8(), static_cast<std::uint8_t>(value)); };
  static_assert(static_cast<int>(Label::none) == 0);
  for (std::size_t i = 0; i < kTile_px; i += hn::Lanes(d8)) {
    const AxisCodes codes_u = gather(axis_u, planes, i);
    const AxisCodes codes_v = gather(axis_v, planes, i);
    const auto part = [&](auto half_index, V16* position, V16* enough, V16* bit_u, V16* bit_v) {
      constexpr int kHalf = decltype(half_index)::value;
      const std::size_t at_16 = i + kHalf * lanes_16;
      const Places u = read_places<kHalf>(axis_u, codes_u, coarsest);
      const Places v = read_places<kHalf>(axis_v, codes_v, coarsest);
      const V16 contrast_16 = load_16(contrast_dn, at_16);
      *enough = hn::VecFromMask(d16, at_least(contrast_16, least));
      *position = hn::And(*enough, hn::And(u.agrees, v.agrees));
      *bit_u = u.bit;
      *bit_v = v.bit;
      const auto quarter = [&](std::size_t at, auto piece) {
        // All ones in 16 bits are −1; widened with their sign they are all ones again.
        const auto is_position = hn::RebindMask(
            d32, hn::MaskFromVec(hn::PromoteTo(di32, hn::BitCast(di16_half, piece(*position)))));
        const V32 contrast_32 = float_of(piece(contrast_16));
        const V32 shift = hn::Div(noise, contrast_32);
        const V32 half_sigma =
            hn::Mul(half, hn::Add(cell_sigma, hn::Mul(hn::Mul(shift, shift), square_to_sigma)));
        const auto half_px = [&](V16 twice) { return hn::Mul(half, float_of(piece(twice))); };
        const auto store = [&](V32 value, float* list) {
          hn::Stream(hn::IfThenElse(is_position, value, nothing), d32, list + at);
        };
        store(half_px(u.centre_2), to.u_px);
        store(half_px(v.centre_2), to.v_px);
        store(hn::Mul(float_of(piece(u.width_2)), half_sigma), to.sigma_u_px);
        store(hn::Mul(float_of(piece(v.width_2)), half_sigma), to.sigma_v_px);
        hn::Stream(hn::Mul(contrast_32, per_dn), d32, to.contrast + at);
      };
      quarter(at_16, [](V16 whole) { return hn::LowerHalf(whole); });
      quarter(at_16 + lanes_32, [&](V16 whole) { return hn::UpperHalf(d16_half, whole); });
    };
    V16 position_0, position_1, enough_0, enough_1, bit_u_0, bit_u_1, bit_v_0, bit_v_1;
    part(std::integral_constant<int, 0>(), &position_0, &enough_0, &bit_u_0, &bit_v_0);
    part(std::integral_constant<int, 1>(), &position_1, &enough_1, &bit_u_1, &bit_v_1);
    const auto bytes = [&](V16 low, V16 high) {
      return hn::Combine(d8, hn::TruncateTo(d8_half, high), hn::TruncateTo(d8_half, low));
    };
    const V8 otherwise =
        hn::IfThenElse(hn::LoadMaskBits(d8, saturated + i / 8), label(Label::saturated),
                       hn::And(bytes(enough_0, enough_1), label(Label::mixed)));
    hn::Stream(hn::IfThenElse(hn::MaskFromVec(bytes(position_0, position_1)), label(Label::mirror),
                              otherwise),
               d8, reinterpret_cast<std::uint8_t*>(to.label) + i);
    hn::Stream(bytes(bit_u_0, bit_u_1), d8, to.bit_u + i);
    hn::Stream(bytes(bit_v_0, bit_v_1), d8, to.bit_v + i);
  }
  hwy::FlushStream();
}

void contrast8(const ContrastRule& rule, const std::uint8_t* white, const std::uint8_t* black,
               std::size_t count, std::uint8_t* contrast_dn, std::uint8_t* threshold,
               std::uint8_t* saturated) {
  contrast(rule, white, black, count, contrast_dn, threshold, saturated);
}
void contrast16(const ContrastRule& rule, const std::uint16_t* white, const std::uint16_t* black,
                std::size_t count, std::uint16_t* contrast_dn, std::uint16_t* threshold,
                std::uint8_t* saturated) {
  contrast(rule, white, black, count, contrast_dn, threshold, saturated);
}
void pair8(const std::uint8_t* pattern, const std::uint8_t* inverse, const std::uint8_t* threshold,
           std::size_t count, std::uint8_t* sign) {
  pair(pattern, inverse, threshold, count, sign);
}
void pair16(const std::uint16_t* pattern, const std::uint16_t* inverse,
            const std::uint16_t* threshold, std::size_t count, std::uint8_t* sign) {
  pair(pattern, inverse, threshold, count, sign);
}
void finish8(const FinalRule& rule, const std::uint8_t* planes, const std::uint8_t* contrast_dn,
             const FinalOut& out) {
  finish(rule, planes, contrast_dn, out);
}
void finish16(const FinalRule& rule, const std::uint8_t* planes, const std::uint16_t* contrast_dn,
              const FinalOut& out) {
  finish(rule, planes, contrast_dn, out);
}
#endif

}  // namespace HWY_NAMESPACE
}  // namespace alhazen::decode
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace alhazen::decode {

HWY_EXPORT(contrast8);
HWY_EXPORT(contrast16);
HWY_EXPORT(pair8);
HWY_EXPORT(pair16);
HWY_EXPORT(finish8);
HWY_EXPORT(finish16);

const Kernels& vector_kernels() {
  // Lambdas: the choice is made by the call.
  static constexpr Kernels kKernels = {
      [](const ContrastRule& rule, const std::uint8_t* white, const std::uint8_t* black,
         std::size_t count, std::uint8_t* contrast_dn, std::uint8_t* threshold,
         std::uint8_t* saturated) {
        HWY_DYNAMIC_DISPATCH(contrast8)
        (rule, white, black, count, contrast_dn, threshold, saturated);
      },
      [](const ContrastRule& rule, const std::uint16_t* white, const std::uint16_t* black,
         std::size_t count, std::uint16_t* contrast_dn, std::uint16_t* threshold,
         std::uint8_t* saturated) {
        HWY_DYNAMIC_DISPATCH(contrast16)
        (rule, white, black, count, contrast_dn, threshold, saturated);
      },
      [](const std::uint8_t* pattern, const std::uint8_t* inverse, const std::uint8_t* threshold,
         std::size_t count, std::uint8_t* sign) {
        HWY_DYNAMIC_DISPATCH(pair8)(pattern, inverse, threshold, count, sign);
      },
      [](const std::uint16_t* pattern, const std::uint16_t* inverse, const std::uint16_t* threshold,
         std::size_t count, std::uint8_t* sign) {
        HWY_DYNAMIC_DISPATCH(pair16)(pattern, inverse, threshold, count, sign);
      },
      [](const FinalRule& rule, const std::uint8_t* planes, const std::uint8_t* contrast_dn,
         const FinalOut& out) {
        HWY_DYNAMIC_DISPATCH(finish8)
        (rule, planes, contrast_dn, out);
      },
      [](const FinalRule& rule, const std::uint8_t* planes, const std::uint16_t* contrast_dn,
         const FinalOut& out) {
        HWY_DYNAMIC_DISPATCH(finish16)
        (rule, planes, contrast_dn, out);
      }};
  return kKernels;
}

}  // namespace alhazen::decode
#endif  // HWY_ONCE
