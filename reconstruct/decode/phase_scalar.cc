#include <algorithm>
#include <cmath>

#include "reconstruct/decode/phase.h"

namespace alhazen::decode {
namespace {

/// atan2(y, x) / 2π, in (−½, ½].
float turns_of(float y, float x) {
  const float a = std::abs(x), b = std::abs(y);
  const float least = std::min(a, b), most = std::max(std::max(a, b), 1e-30F);
  const float ratio = least / most, square = ratio * ratio;
  float sum = kAtanTurns[8];
  for (int i = 7; i >= 0; --i) sum = sum * square + kAtanTurns[i];
  float turns = sum * ratio;
  if (b > a) turns = 0.25F - turns;
  if (x < 0) turns = 0.5F - turns;
  return std::copysign(turns, y);
}

template <class Dn>
void refine(const PhaseRule& rule, std::span<const Dn* const> steps, const Dn* contrast_dn,
            const PhaseOut& out) {
  for (std::size_t i = 0; i < kTile_px; ++i) {
    if (out.label[i] != Label::mirror) continue;
    float cosine = 0, sine = 0;
    for (std::size_t k = 0; k < steps.size(); ++k) {
      const auto dn = static_cast<float>(steps[k][i]);
      cosine = cosine + dn * rule.cosines[k];
      sine = sine + dn * rule.sines[k];
    }
    const float amplitude = std::sqrt(cosine * cosine + sine * sine);
    const auto contrast = static_cast<float>(contrast_dn[i]);
    if (!(amplitude + amplitude >= contrast * rule.min_modulation)) continue;
    const float old_px = out.position_px[i], old_sigma = out.sigma_px[i];
    const float off = turns_of(sine, cosine) - old_px / rule.period_px;  // periods
    const float error_px = (off - std::nearbyint(off)) * rule.period_px;
    const float sigma = rule.noise_px_dn / amplitude;
    if (!(std::abs(error_px) <= kPhaseSigmas * old_sigma + kPhaseShare * rule.period_px)) {
      out.label[i] = Label::mixed;
      continue;
    }
    const float old2 = old_sigma * old_sigma, new2 = sigma * sigma;
    const bool replaces = sigma * kPhaseReplaces <= old_sigma;
    const float share = replaces ? 1.0F : old2 / (old2 + new2);
    out.position_px[i] = old_px + error_px * share;
    out.sigma_px[i] = Imath::half(std::max(sigma * std::sqrt(share), kLeastSigma_px));
  }
}

}  // namespace

const PhaseKernels& scalar_phase_kernels() {
  static constexpr PhaseKernels kKernels = {refine<std::uint8_t>, refine<std::uint16_t>};
  return kKernels;
}

}  // namespace alhazen::decode
