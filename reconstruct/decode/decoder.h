#pragma once

#include <memory>
#include <span>
#include <vector>

#include "alhazen/image.h"
#include "alhazen/pattern.h"
#include "alhazen/result.h"
#include "reconstruct/scan/light_map.h"

namespace alhazen {

/// Tunables of decoding.
struct DecodeOptions {
  /// A pixel carries a position only where white − black is at least this share of full scale.
  /// Unit 1, range (0, 1).
  double min_contrast = 0.02;
  /// A bit is resolved where |pattern − inverse| ≥ min_modulation · (white − black): below it the
  /// footprint of the pixel on the display covers both values. Unit 1, range (0, 1).
  double min_modulation = 0.25;
};

/// Folds the frames of one stack (camera × display × stop) into a light map as they arrive; no
/// frame is kept. Thread-bound. Memory: a few bytes per pixel, independent of the number of
/// patterns.
class Decoder {
 public:
  /// `sequence`: every pattern that will come, in any order of arrival.
  /// Fails: invalid (options out of range, a pattern without its inverse, no white or black),
  /// unsupported (phase, for now).
  [[nodiscard]] static Result<Decoder> make(const DecodeOptions& options, const StackKey& key,
                                            double angle_rad, const Region& region, int bits,
                                            int display_width_px, int display_height_px,
                                            std::span<const Pattern> sequence);
  Decoder(Decoder&&) noexcept;
  Decoder& operator=(Decoder&&) noexcept;
  ~Decoder();

  /// Fails: invalid (size, format or bits differ; pattern not of the sequence), conflict (seen
  /// already).
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
