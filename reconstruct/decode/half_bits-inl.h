// Bits of 16-bit floats on vectors. No guard of the usual kind: read once for every instruction
// set.
#if defined(ALHAZEN_DECODE_HALF_BITS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ALHAZEN_DECODE_HALF_BITS_INL_H_
#undef ALHAZEN_DECODE_HALF_BITS_INL_H_
#else
#define ALHAZEN_DECODE_HALF_BITS_INL_H_
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace alhazen::decode::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr std::uint32_t kHalfBiasBits = (127 - 15) << 10;  // exponents' biases, in a half's bits

/// The nearest half's bits, of two equally near the even one; for numbers from 2^-14 to 65504. Not
/// hn::DemoteTo(), which rounds so only where the processor does it.
template <class V>
HWY_INLINE auto half_bits(V value) {
  const hn::RebindToUnsigned<hn::DFromV<V>> du;
  const auto bits = hn::BitCast(du, value);
  const auto odd = hn::And(hn::ShiftRight<13>(bits), hn::Set(du, 1));
  const auto rounded = hn::ShiftRight<13>(hn::Add(bits, hn::Add(odd, hn::Set(du, 0xFFF))));
  return hn::Sub(rounded, hn::Set(du, kHalfBiasBits));
}

/// The number of a half's bits, for the same numbers.
template <class V>
HWY_INLINE auto from_half_bits(V bits) {
  const hn::DFromV<V> du;
  const hn::RebindToFloat<decltype(du)> d;
  return hn::BitCast(d, hn::ShiftLeft<13>(hn::Add(bits, hn::Set(du, kHalfBiasBits))));
}

}  // namespace alhazen::decode::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
