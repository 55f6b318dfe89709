#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "reconstruct/decode/kernels.h"

namespace alhazen::decode {

inline constexpr int kMinPhaseSteps = 3, kMaxPhaseSteps = 64;

/// How the steps of one period sharpen a position that is known to a part of that period.
///
/// Step k shows ½ + ½ cos 2π(u / P − k / N) in linear light, so Iₖ = A + B cos(φ − 2πk / N), and
/// B cos φ = 2/N Σ Iₖ cos(2πk / N), B sin φ likewise (Bruning et al., Applied Optics 13, 1974). The
/// footprint of a pixel, a box of width F, leaves of the display's modulation sinc(F / P): a period
/// below 1.5 footprints is not believed, for below the footprint itself it comes back inverted.
struct PhaseRule {
  float period_px = 64;
  int steps = 5;
  /// 2/N cos(2πk / N) and 2/N sin(2πk / N).
  float cosines[kMaxPhaseSteps] = {}, sines[kMaxPhaseSteps] = {};
  /// Least 2B / (white − black).
  float min_modulation = 0;
  /// Standard deviation of the position · B, px · DN.
  float noise_px_dn = 0;
};

/// The positions of one axis in one tile, and what they are worth.
struct PhaseOut {
  float* position_px;
  Imath::half* sigma_px;
  Label* label;
};

/// A mirror pixel's position and the new one may differ by so many standard deviations of the old
/// one and this share of the period; where they differ by more, several places shine into the
/// pixel.
inline constexpr float kPhaseSigmas = 4, kPhaseShare = 1.0F / 16;
/// A new position replaces the old one where its standard deviation is this many times smaller, for
/// Gray code errs by its cells and not at random; otherwise both are averaged by their variances.
inline constexpr float kPhaseReplaces = 8;

/// No position is said to be better than this: noise is not all that is wrong with it.
inline constexpr float kLeastSigma_px = 0.01F;

/// Sharpens one tile. Pixels that are not Label::mirror, or whose modulation is too small, stay as
/// they are; where the positions contradict each other the label becomes mixed. Reentrant.
struct PhaseKernels {
  void (*refine8)(const PhaseRule& rule, std::span<const std::uint8_t* const> steps,
                  const std::uint8_t* contrast, const PhaseOut& out);
  void (*refine16)(const PhaseRule& rule, std::span<const std::uint16_t* const> steps,
                   const std::uint16_t* contrast, const PhaseOut& out);
};

/// One pixel after the other: the reference. The vectors agree with it bit for bit.
[[nodiscard]] const PhaseKernels& scalar_phase_kernels();
/// With the best vector unit of this processor, chosen at run time.
[[nodiscard]] const PhaseKernels& vector_phase_kernels();

/// atan(x) / 2π for x in [0, 1] is x Σ kAtanTurns[i] x²ⁱ, to 4e-9 (Abramowitz and Stegun 1964,
/// 4.4.49, divided by 2π).
inline constexpr float kAtanTurns[9] = {static_cast<float>(0.15915494309189535),
                                        static_cast<float>(0.15915494309189535 * -0.3333314528),
                                        static_cast<float>(0.15915494309189535 * 0.1999355085),
                                        static_cast<float>(0.15915494309189535 * -0.1420889944),
                                        static_cast<float>(0.15915494309189535 * 0.1065626393),
                                        static_cast<float>(0.15915494309189535 * -0.0752896400),
                                        static_cast<float>(0.15915494309189535 * 0.0429096138),
                                        static_cast<float>(0.15915494309189535 * -0.0161657367),
                                        static_cast<float>(0.15915494309189535 * 0.0028662257)};

}  // namespace alhazen::decode
