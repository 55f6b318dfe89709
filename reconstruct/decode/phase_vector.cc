// The loop of phase.h on vectors: compiled once for every instruction set, chosen at run time.
#include "reconstruct/decode/phase.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/decode/phase_vector.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

#include "reconstruct/decode/half_bits-inl.h"

HWY_BEFORE_NAMESPACE();
namespace alhazen::decode {
namespace HWY_NAMESPACE {
#if HWY_TARGET == HWY_SCALAR
const PhaseKernels& phase_kernels() { return scalar_phase_kernels(); }
#else
namespace hn = hwy::HWY_NAMESPACE;
namespace {

using D32 = hn::ScalableTag<float>;
using DI32 = hn::RebindToSigned<D32>;
using DU32 = hn::RebindToUnsigned<D32>;
using V32 = hn::Vec<D32>;
using VU32 = hn::Vec<DU32>;

HWY_INLINE V32 turns_of(V32 y, V32 x) {
  const D32 d;
  const V32 a = hn::Abs(x), b = hn::Abs(y);
  const V32 ratio = hn::Div(hn::Min(a, b), hn::Max(hn::Max(a, b), hn::Set(d, 1e-30F)));
  const V32 square = hn::Mul(ratio, ratio);
  V32 sum = hn::Set(d, kAtanTurns[8]);
  for (int i = 7; i >= 0; --i) sum = hn::Add(hn::Mul(sum, square), hn::Set(d, kAtanTurns[i]));
  V32 turns = hn::Mul(sum, ratio);
  turns = hn::IfThenElse(hn::Gt(b, a), hn::Sub(hn::Set(d, 0.25F), turns), turns);
  turns = hn::IfThenElse(hn::Lt(x, hn::Zero(d)), hn::Sub(hn::Set(d, 0.5F), turns), turns);
  return hn::CopySign(turns, y);
}

template <class Dn>
void refine(const PhaseRule& rule, std::span<const Dn* const> steps, const Dn* contrast_dn,
            const PhaseOut& out) {
  const D32 d;
  const DI32 di32;
  const DU32 du32;
  const hn::Rebind<Dn, D32> d_dn;
  const hn::Rebind<std::uint8_t, D32> d_label;
  const hn::Rebind<std::uint16_t, D32> d_half;
  static_assert(sizeof(Imath::half) == sizeof(std::uint16_t) && sizeof(Label) == 1);
  auto* sigma_list = reinterpret_cast<std::uint16_t*>(out.sigma_px);
  auto* label_list = reinterpret_cast<std::uint8_t*>(out.label);
  const auto load = [&](const Dn* list) {
    return hn::ConvertTo(d, hn::PromoteTo(di32, hn::LoadU(d_dn, list)));
  };
  const V32 period = hn::Set(d, rule.period_px);
  for (std::size_t i = 0; i < kTile_px; i += hn::Lanes(d)) {
    const auto labels = hn::PromoteTo(du32, hn::LoadU(d_label, label_list + i));
    const auto is_mirror = hn::Eq(labels, hn::Set(du32, static_cast<std::uint32_t>(Label::mirror)));
    if (hn::AllFalse(du32, is_mirror)) continue;
    V32 cosine = hn::Zero(d), sine = hn::Zero(d);
    for (std::size_t k = 0; k < steps.size(); ++k) {
      const V32 dn = load(steps[k] + i);
      cosine = hn::Add(cosine, hn::Mul(dn, hn::Set(d, rule.cosines[k])));
      sine = hn::Add(sine, hn::Mul(dn, hn::Set(d, rule.sines[k])));
    }
    const V32 amplitude = hn::Sqrt(hn::Add(hn::Mul(cosine, cosine), hn::Mul(sine, sine)));
    const V32 least = hn::Mul(load(contrast_dn + i), hn::Set(d, rule.min_modulation));
    const auto counts =
        hn::And(hn::RebindMask(d, is_mirror), hn::Ge(hn::Add(amplitude, amplitude), least));
    const V32 old_px = hn::LoadU(d, out.position_px + i);
    const VU32 old_half = hn::PromoteTo(du32, hn::LoadU(d_half, sigma_list + i));
    const V32 old_sigma = from_half_bits(old_half);
    const V32 off = hn::Sub(turns_of(sine, cosine), hn::Div(old_px, period));
    const V32 error_px = hn::Mul(hn::Sub(off, hn::Round(off)), period);
    const V32 sigma = hn::Div(hn::Set(d, rule.noise_px_dn), amplitude);
    const V32 allowed = hn::Add(hn::Mul(hn::Set(d, kPhaseSigmas), old_sigma),
                                hn::Mul(hn::Set(d, kPhaseShare), period));
    const auto agrees = hn::And(counts, hn::Le(hn::Abs(error_px), allowed));
    const V32 old2 = hn::Mul(old_sigma, old_sigma), new2 = hn::Mul(sigma, sigma);
    const auto replaces = hn::Le(hn::Mul(sigma, hn::Set(d, kPhaseReplaces)), old_sigma);
    const V32 share = hn::IfThenElse(replaces, hn::Set(d, 1), hn::Div(old2, hn::Add(old2, new2)));
    hn::StoreU(hn::IfThenElse(agrees, hn::Add(old_px, hn::Mul(error_px, share)), old_px), d,
               out.position_px + i);
    const V32 new_sigma = hn::Max(hn::Mul(sigma, hn::Sqrt(share)), hn::Set(d, kLeastSigma_px));
    hn::StoreU(hn::TruncateTo(d_half, hn::IfThenElse(hn::RebindMask(du32, agrees),
                                                     half_bits(new_sigma), old_half)),
               d_half, sigma_list + i);
    const auto disagrees = hn::RebindMask(du32, hn::AndNot(agrees, counts));
    hn::StoreU(hn::TruncateTo(
                   d_label,
                   hn::IfThenElse(disagrees,
                                  hn::Set(du32, static_cast<std::uint32_t>(Label::mixed)), labels)),
               d_label, label_list + i);
  }
}

}  // namespace

const PhaseKernels& phase_kernels() {
  static constexpr PhaseKernels kKernels = {refine<std::uint8_t>, refine<std::uint16_t>};
  return kKernels;
}
#endif

}  // namespace HWY_NAMESPACE
}  // namespace alhazen::decode
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace alhazen::decode {

HWY_EXPORT(phase_kernels);

const PhaseKernels& vector_phase_kernels() { return HWY_DYNAMIC_DISPATCH(phase_kernels)(); }

}  // namespace alhazen::decode
#endif  // HWY_ONCE
