#pragma once

#include <memory>
#include <span>

#include "alhazen/image.h"
#include "alhazen/pattern.h"
#include "alhazen/result.h"
#include "reconstruct/scan/light_map.h"

namespace alhazen {

/// Tunables of decoding.
struct DecodeOptions {
  /// A pixel carries a position only where white − black is at least this share of full scale.
  /// Unit 1, range (0, 1).
  double min_contrast = 0.08;
  /// A bit is resolved where |pattern − inverse| > min_modulation · (white − black): below it the
  /// footprint of the pixel on the display covers both values. At ¼ the finest bit that a footprint
  /// F resolves is F / 3.2 wide. Unit 1, range (0, 1).
  double min_modulation = 0.25;
  /// Standard deviation of |pattern − inverse| by the camera's noise, as a share of full scale. No
  /// bit is resolved within three of them. Unit 1, range [0, 0.1]. 0.004 is one of 255.
  double noise = 0.004;
  /// A pixel that resolves no bit as fine as this carries no position: what scatters light from
  /// the whole display resolves its coarsest bits. 0 = finest, range [0, 13].
  int max_bit = 6;
  /// A phase counts where its amplitude is at least this share of (white − black) / 2: a period
  /// shorter than 1.5 footprints of the pixel is not believed. Unit 1, range [0.25, 1).
  double min_phase_modulation = 0.4;

  /// Fails: invalid, naming option and range.
  [[nodiscard]] Status is_valid() const;
};

/// Folds the frames of one stack (camera × display × stop) into a light map as they arrive.
/// Thread-bound.
///
/// Memory: per pixel 1 or 2 bytes of contrast, two bits, and three bits a pattern pair. Pairs are
/// folded four at a time, for each time reads the contrast again; so up to eight frames are held,
/// and all that come before white and black. So show white and black first, and each pattern next
/// to its inverse. Once all of these are there they become positions, which the periods of the
/// phases then sharpen, the longest first: frames are held until their period's turn has come and
/// all its steps are there.
/// The result does not depend on the order of arrival.
/// Labels: mirror   every bit from the coarsest down to the finest resolved one agrees, and so does
///                  every period that is resolved; where phases follow, one of them is
///         mixed    contrast, but no such agreement, nothing resolved, or a code beyond the display
///         saturated  as none or mixed, and white is at full scale: a shorter exposure may help
///         none     no contrast
/// Source: Gray code with inverse patterns compared pixel by pixel, decoded to the finest bit with
///         contrast (M. Weinmann's thesis, chapter 5, and Weinmann, Osep, Ruiters, Klein, ICCV
///         2013); phase shift in steps (Bruning et al., Applied Optics 13, 1974).
class Decoder {
 public:
  /// `sequence`: every pattern that will come: white, black, and on both axes every bit from the
  /// most significant down, each with its inverse; the finest may be left out. On an axis phases
  /// may follow: every step of one or several periods, the longest at least four cells of the
  /// finest bit, each of the others at least an eighth of the one before. Fails: invalid (options
  /// out of range, an empty region, a pattern without its inverse, no white or black, a bit missing
  /// above another, a step missing, periods too far apart).
  [[nodiscard]] static Result<Decoder> make(const DecodeOptions& options, const StackKey& key,
                                            double angle_rad, const Region& region, int bits,
                                            int display_width_px, int display_height_px,
                                            std::span<const Pattern> sequence);
  Decoder(Decoder&&) noexcept;
  Decoder& operator=(Decoder&&) noexcept;
  ~Decoder();

  /// Fails: invalid (size, format or bits differ; pattern not of the sequence), conflict (seen
  /// already). After a failure the decoder is as before.
  Status add(const Pattern& pattern, const Image& image);
  [[nodiscard]] bool complete() const noexcept;
  /// Fails: conflict (patterns are missing; names the first).
  [[nodiscard]] Result<LightMap> finish() &&;

 private:
  struct State;
  explicit Decoder(std::unique_ptr<State> state) noexcept;
  std::unique_ptr<State> state_;
};

}  // namespace alhazen
