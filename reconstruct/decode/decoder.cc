#include "reconstruct/decode/decoder.h"

#include <hwy/cache_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "reconstruct/decode/kernels.h"
#include "reconstruct/decode/phase.h"
#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

using decode::kMaxBits;
using decode::kMaxPairsAtOnce;
using decode::kNoiseSquareToSigma;
using decode::kPlaneBytes;
using decode::kPlanesPerBit;
using decode::kTile_px;

// Differences within so many standard deviations of noise are not believed.
constexpr double kNoiseSigmas = 3;
// A resolved bit's edge is a ramp of at most 3.2 cells of that bit, where a difference rises by
// twice the contrast (method: the finest bit that survives a footprint F is F / 3.2 pixels wide);
// so noise moves the edge by 3.2 / 2 cells · noise / contrast.
constexpr double kNoiseToCells = 1.6;
std::string text_of(const Pattern& pattern) {
  switch (pattern.kind) {
    case PatternKind::white:
      return "white";
    case PatternKind::black:
      return "black";
    case PatternKind::gray:
      return std::string(pattern.inverted ? "inverse of " : "") + "gray bit " +
             std::to_string(pattern.bit) + " of " + (pattern.axis == Axis::u ? "u" : "v");
    case PatternKind::phase:
      return "phase step " + std::to_string(pattern.step) + " of " + std::to_string(pattern.steps) +
             " of period " + std::to_string(pattern.period_px) + " px of " +
             (pattern.axis == Axis::u ? "u" : "v");
  }
  return "unknown pattern";
}

Status in_range(const char* name, double value, double lowest, double highest) {
  if (value >= lowest && value <= highest) return {};
  return Error{Code::invalid, "decode option " + std::string(name) + " is " +
                                  std::to_string(value) + "; it must be in [" +
                                  std::to_string(lowest) + ", " + std::to_string(highest) + "]"};
}

/// Two frames that are compared with each other, and where the result goes.
struct Pair {
  std::optional<Image> first, second;  ///< white and black, or pattern and inverse
  std::size_t plane = 0;               ///< where its bits go in every tile, for patterns
  bool folded = false;

  [[nodiscard]] bool is_ready() const noexcept { return first && second; }
  void set_folded() {
    first.reset();
    second.reset();
    folded = true;
  }
};

/// The steps of one period on one axis.
struct Period {
  Axis axis = Axis::u;
  decode::PhaseRule rule;
  std::vector<std::optional<Image>> frames;  ///< by step
  bool folded = false;

  [[nodiscard]] bool is_ready() const noexcept {
    return std::ranges::all_of(frames, [](const auto& frame) { return frame.has_value(); });
  }
};

int period_of(const Period& period) { return static_cast<int>(period.rule.period_px); }

}  // namespace

Status DecodeOptions::is_valid() const {
  constexpr double kLeast = 1e-6;
  ALHAZEN_TRY(in_range("min_contrast", min_contrast, kLeast, 1 - kLeast));
  ALHAZEN_TRY(in_range("min_modulation", min_modulation, kLeast, 1 - kLeast));
  ALHAZEN_TRY(in_range("noise", noise, 0, 0.1));
  ALHAZEN_TRY(in_range("min_phase_modulation", min_phase_modulation, 0.25, 1 - kLeast));
  return in_range("max_bit", max_bit, 0, kMaxBits - 1);
}

struct Decoder::State {
  LightMap map;  ///< what is known from the start; finish() adds the lists
  int bits = 0;
  decode::ContrastRule contrast_rule;
  decode::FinalRule final_rule;
  std::vector<Pattern> sequence;

  std::optional<PixelFormat> format;  ///< of the first frame
  std::size_t tiles = 0;
  Pair contrast_pair;
  std::array<std::array<std::optional<Pair>, kMaxBits>, 2> gray_pairs;  ///< by axis and bit
  PixelList<std::byte> contrast;  ///< of tiles · kTile_px pixels in the frames' format
  std::size_t tile_planes = 0;
  PixelList<std::uint8_t> planes;  ///< tiles · tile_planes · kPlaneBytes
  bool has_positions = false;      ///< Gray code is over: `map` has its lists
  std::vector<Period> periods;     ///< by axis, the longest first

  [[nodiscard]] Pair* pair_of(const Pattern& pattern);
  [[nodiscard]] Period* period_of(const Pattern& pattern);
  /// Where a pattern's frame is kept until it is folded; nullptr: it was.
  [[nodiscard]] std::optional<Image>* place_of(const Pattern& pattern);
  [[nodiscard]] Status check(const Pattern& pattern, const Image& image) const;
  /// From `sequence`, once the bits of the axes are known.
  [[nodiscard]] Status add_periods(const DecodeOptions& options);
  void fold_contrast();
  template <class Dn, class Kernel>
  void fold_contrast_as(const Kernel& kernel);
  /// Folds the pairs that are there, but only as many together as can be, or the last ones.
  void fold_pairs();
  template <class Dn, class Kernel>
  void fold_as(std::span<Pair* const> ready, const Kernel& kernel);
  [[nodiscard]] bool is_gray_folded() const;
  /// Planes and contrast become positions.
  void make_positions();
  void fold_periods();
  template <class Dn, class Kernel>
  void fold_period_as(const Period& period, const Kernel& kernel);
  /// Takes the positions from mixed pixels, from those that no phase has sharpened, and from those
  /// beyond the display.
  void drop_unsharpened();
  [[nodiscard]] std::size_t tile_bytes() const noexcept { return tile_planes * kPlaneBytes; }
  [[nodiscard]] std::uint8_t* planes_of(std::size_t tile) {
    return planes.data() + tile * tile_bytes();
  }
};

Pair* Decoder::State::pair_of(const Pattern& pattern) {
  if (pattern.kind != PatternKind::gray) return &contrast_pair;
  auto& pair =
      gray_pairs[static_cast<std::size_t>(pattern.axis)][static_cast<std::size_t>(pattern.bit)];
  return pair ? &*pair : nullptr;
}

Period* Decoder::State::period_of(const Pattern& pattern) {
  const auto found = std::ranges::find_if(periods, [&](const Period& period) {
    return period.axis == pattern.axis && alhazen::period_of(period) == pattern.period_px;
  });
  return &*found;
}

std::optional<Image>* Decoder::State::place_of(const Pattern& pattern) {
  if (pattern.kind == PatternKind::phase) {
    Period& period = *period_of(pattern);
    return period.folded ? nullptr : &period.frames[static_cast<std::size_t>(pattern.step)];
  }
  Pair& pair = *pair_of(pattern);
  const bool is_first = pattern.kind == PatternKind::white ||
                        (pattern.kind == PatternKind::gray && !pattern.inverted);
  return pair.folded ? nullptr : is_first ? &pair.first : &pair.second;
}

bool Decoder::State::is_gray_folded() const {
  return contrast_pair.folded && std::ranges::all_of(gray_pairs, [](const auto& axis) {
           return std::ranges::all_of(
               axis, [](const std::optional<Pair>& pair) { return !pair || pair->folded; });
         });
}

Status Decoder::State::check(const Pattern& pattern, const Image& image) const {
  if (std::ranges::find(sequence, pattern) == sequence.end()) {
    return Error{Code::invalid, text_of(pattern) + " is not of the sequence"};
  }
  if (image.width() != map.region.width || image.height() != map.region.height) {
    return Error{Code::invalid, "a frame of " + std::to_string(image.width()) + " x " +
                                    std::to_string(image.height()) + " px; it must have " +
                                    std::to_string(map.region.width) + " x " +
                                    std::to_string(map.region.height) + " px"};
  }
  if (image.bits() != bits || (format && image.format() != *format) ||
      (image.format() == PixelFormat::mono8 && bits > 8)) {
    return Error{Code::invalid, "a frame of " + std::to_string(image.bits()) + " bits in " +
                                    (image.format() == PixelFormat::mono8 ? "8" : "16") +
                                    "; all frames must have " + std::to_string(bits) +
                                    " bits in the same format"};
  }
  return {};
}

/// The pixels of the last tile of a frame, padded.
template <class Dn>
std::array<Dn, kTile_px> last_tile(const Dn* frame, std::size_t size_px) {
  std::array<Dn, kTile_px> tile{};
  const std::size_t rest_px = size_px % kTile_px;
  std::copy_n(frame + size_px - rest_px, rest_px, tile.begin());
  return tile;
}

template <class Dn>
const Dn* pixels_of(const Image& image) {
  return reinterpret_cast<const Dn*>(image.bytes().data());
}

template <class Dn, class Kernel>
void Decoder::State::fold_contrast_as(const Kernel& kernel) {
  const auto* white = pixels_of<Dn>(*contrast_pair.first);
  const auto* black = pixels_of<Dn>(*contrast_pair.second);
  auto* difference = reinterpret_cast<Dn*>(contrast.data());
  const std::size_t whole = map.size_px() / kTile_px;
  const auto planes_from = [&](std::size_t tile) {
    return planes_of(tile) + final_rule.saturated_plane * kPlaneBytes;
  };
  kernel(contrast_rule, white, black, whole, tile_bytes(), difference, planes_from(0));
  if (whole == tiles) return;
  const auto last_white = last_tile(white, map.size_px());
  const auto last_black = last_tile(black, map.size_px());
  kernel(contrast_rule, last_white.data(), last_black.data(), 1, tile_bytes(),
         difference + whole * kTile_px, planes_from(whole));
}

template <class Dn, class Kernel>
void Decoder::State::fold_as(std::span<Pair* const> ready, const Kernel& kernel) {
  ALHAZEN_CHECK(ready.size() <= kMaxPairsAtOnce);
  const auto* difference = reinterpret_cast<const Dn*>(contrast.data());
  const std::size_t whole = map.size_px() / kTile_px;
  std::array<decode::FramePair<Dn>, kMaxPairsAtOnce> list;
  for (std::size_t k = 0; k < ready.size(); ++k) {
    list[k] = {pixels_of<Dn>(*ready[k]->first), pixels_of<Dn>(*ready[k]->second),
               planes_of(0) + ready[k]->plane * kPlaneBytes};
  }
  kernel(contrast_rule, difference, std::span(list).first(ready.size()), whole, tile_bytes());
  if (whole == tiles) return;
  for (std::size_t k = 0; k < ready.size(); ++k) {
    const auto pattern = last_tile(list[k].pattern, map.size_px());
    const auto inverse = last_tile(list[k].inverse, map.size_px());
    const decode::FramePair<Dn> last{pattern.data(), inverse.data(),
                                     planes_of(whole) + ready[k]->plane * kPlaneBytes};
    kernel(contrast_rule, difference + whole * kTile_px, std::span(&last, 1), 1, tile_bytes());
  }
}

Status Decoder::State::add_periods(const DecodeOptions& options) {
  for (const Pattern& pattern : sequence) {
    if (pattern.kind != PatternKind::phase) continue;
    if (pattern.period_px < 2 || pattern.period_px > kMaxDisplaySide_px ||
        pattern.steps < decode::kMinPhaseSteps || pattern.steps > decode::kMaxPhaseSteps ||
        pattern.step < 0 || pattern.step >= pattern.steps) {
      return Error{Code::invalid, text_of(pattern) +
                                      " cannot be decoded: periods must be in [2, 16384] px, steps "
                                      "in [3, 64], the step below them"};
    }
    Period period;
    period.axis = pattern.axis;
    period.rule.period_px = static_cast<float>(pattern.period_px);
    period.rule.steps = pattern.steps;
    const auto same = std::ranges::find_if(periods, [&](const Period& other) {
      return other.axis == period.axis && alhazen::period_of(other) == pattern.period_px;
    });
    if (same == periods.end()) {
      periods.push_back(std::move(period));
    } else if (same->rule.steps != pattern.steps) {
      return Error{Code::invalid, text_of(pattern) + " does not belong to " +
                                      std::to_string(same->rule.steps) + " steps of that period"};
    }
  }
  std::ranges::sort(periods, [](const Period& a, const Period& b) {
    return std::pair(a.axis, -a.rule.period_px) < std::pair(b.axis, -b.rule.period_px);
  });
  const double full_scale = static_cast<double>((1 << bits) - 1);
  const Period* before = nullptr;
  for (Period& period : periods) {
    const decode::AxisBits& axis = period.axis == Axis::u ? final_rule.u : final_rule.v;
    const bool is_longest = before == nullptr || before->axis != period.axis;
    const auto period_px = static_cast<double>(period.rule.period_px);
    const double least_px =
        is_longest ? 4.0 * (1 << axis.lowest) : static_cast<double>(before->rule.period_px) / 8;
    if (period_px < least_px) {
      return Error{Code::invalid, "period " + std::to_string(alhazen::period_of(period)) +
                                      " px cannot be told from the next one by what comes before "
                                      "it; it must be at least " +
                                      std::to_string(static_cast<int>(least_px)) + " px"};
    }
    before = &period;
    const int steps = period.rule.steps;
    for (int k = 0; k < steps; ++k) {
      const bool is_there = std::ranges::any_of(sequence, [&](const Pattern& pattern) {
        return pattern.kind == PatternKind::phase && pattern.axis == period.axis &&
               pattern.period_px == alhazen::period_of(period) && pattern.step == k;
      });
      if (!is_there) {
        return Error{Code::invalid, text_of({.kind = PatternKind::phase,
                                             .axis = period.axis,
                                             .period_px = alhazen::period_of(period),
                                             .step = k,
                                             .steps = steps}) +
                                        " is missing in the sequence"};
      }
      const double angle_rad = 2 * std::numbers::pi * k / steps;
      period.rule.cosines[k] = static_cast<float>(2.0 / steps * std::cos(angle_rad));
      period.rule.sines[k] = static_cast<float>(2.0 / steps * std::sin(angle_rad));
    }
    period.frames.resize(static_cast<std::size_t>(steps));
    period.rule.min_modulation = static_cast<float>(options.min_phase_modulation);
    // A frame's noise is that of a difference by √2; rounding to whole numbers adds its own.
    const double noise_dn =
        std::hypot(full_scale * options.noise / std::numbers::sqrt2, 1 / std::sqrt(12.0));
    period.rule.noise_px_dn =
        static_cast<float>(period_px / (2 * std::numbers::pi) * std::sqrt(2.0 / steps) * noise_dn);
  }
  return {};
}

void Decoder::State::fold_contrast() {
  if (contrast_pair.folded || !contrast_pair.is_ready()) return;
  const decode::Kernels& kernels = decode::vector_kernels();
  contrast.resize(tiles * kTile_px * bytes_per_pixel(*format));
  planes.resize(tiles * tile_bytes());
  if (*format == PixelFormat::mono8) {
    fold_contrast_as<std::uint8_t>(kernels.contrast8);
  } else {
    fold_contrast_as<std::uint16_t>(kernels.contrast16);
  }
  contrast_pair.set_folded();
}

void Decoder::State::fold_pairs() {
  if (!contrast_pair.folded) return;
  std::vector<Pair*> ready;
  bool is_last = true;
  for (auto& axis : gray_pairs) {
    for (std::optional<Pair>& pair : axis) {
      if (!pair || pair->folded) continue;
      if (pair->is_ready()) {
        ready.push_back(&*pair);
      } else {
        is_last = false;
      }
    }
  }
  const decode::Kernels& kernels = decode::vector_kernels();
  for (std::size_t done = 0; done < ready.size(); done += kMaxPairsAtOnce) {
    const std::size_t count = std::min(kMaxPairsAtOnce, ready.size() - done);
    if (count < kMaxPairsAtOnce && !is_last) break;
    const std::span<Pair* const> some(ready.data() + done, count);
    if (*format == PixelFormat::mono8) {
      fold_as<std::uint8_t>(some, kernels.pairs8);
    } else {
      fold_as<std::uint16_t>(some, kernels.pairs16);
    }
    for (Pair* pair : some) pair->set_folded();
  }
  hwy::FlushStream();
}

void Decoder::State::make_positions() {
  map.resize_lists();
  // Whole tiles go straight to their place, the last one here first.
  struct alignas(decode::kOutAlignment) Tile {
    std::array<float, kTile_px> u, v;
    std::array<Imath::half, kTile_px> sigma_u, sigma_v;
    std::array<std::uint8_t, kTile_px> contrast, bit_u, bit_v;
    std::array<Label, kTile_px> label;
  };
  const auto last = std::make_unique<Tile>();
  const decode::Kernels& kernels = decode::vector_kernels();
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    const std::size_t first_px = tile * kTile_px;
    const bool is_whole = first_px + kTile_px <= map.size_px();
    const auto place = [&](auto& list, auto& spare) {
      return is_whole ? list.data() + first_px : spare.data();
    };
    const decode::FinalOut out = {place(map.u_px, last->u),
                                  place(map.v_px, last->v),
                                  place(map.sigma_u_px, last->sigma_u),
                                  place(map.sigma_v_px, last->sigma_v),
                                  place(map.contrast, last->contrast),
                                  place(map.label, last->label),
                                  place(map.bit_u, last->bit_u),
                                  place(map.bit_v, last->bit_v)};
    const std::byte* differences = contrast.data() + first_px * bytes_per_pixel(*format);
    if (*format == PixelFormat::mono8) {
      kernels.finish8(final_rule, planes_of(tile),
                      reinterpret_cast<const std::uint8_t*>(differences), out);
    } else {
      kernels.finish16(final_rule, planes_of(tile),
                       reinterpret_cast<const std::uint16_t*>(differences), out);
    }
    if (is_whole) continue;
    const auto copy = [&](const auto& from, auto& to) {
      std::copy_n(from.begin(), map.size_px() - first_px,
                  to.begin() + static_cast<std::ptrdiff_t>(first_px));
    };
    copy(last->u, map.u_px);
    copy(last->v, map.v_px);
    copy(last->sigma_u, map.sigma_u_px);
    copy(last->sigma_v, map.sigma_v_px);
    copy(last->contrast, map.contrast);
    copy(last->label, map.label);
    copy(last->bit_u, map.bit_u);
    copy(last->bit_v, map.bit_v);
  }
  hwy::FlushStream();
  planes = {};
  if (periods.empty()) contrast = {};
  has_positions = true;
}

template <class Dn, class Kernel>
void Decoder::State::fold_period_as(const Period& period, const Kernel& kernel) {
  const auto* difference = reinterpret_cast<const Dn*>(contrast.data());
  PixelList<float>& position = period.axis == Axis::u ? map.u_px : map.v_px;
  PixelList<Imath::half>& sigma = period.axis == Axis::u ? map.sigma_u_px : map.sigma_v_px;
  const std::size_t whole = map.size_px() / kTile_px;
  std::vector<const Dn*> steps(period.frames.size());
  for (std::size_t tile = 0; tile < whole; ++tile) {
    const std::size_t first = tile * kTile_px;
    for (std::size_t k = 0; k < steps.size(); ++k) {
      steps[k] = pixels_of<Dn>(*period.frames[k]) + first;
    }
    kernel(period.rule, steps, difference + first,
           {position.data() + first, sigma.data() + first, map.label.data() + first});
  }
  if (whole == tiles) return;
  // The last, padded; its other pixels are no mirror.
  const std::size_t first = whole * kTile_px, rest = map.size_px() - first;
  std::vector<std::array<Dn, kTile_px>> last;
  last.reserve(steps.size());
  for (std::size_t k = 0; k < steps.size(); ++k) {
    last.push_back(last_tile(pixels_of<Dn>(*period.frames[k]), map.size_px()));
    steps[k] = last[k].data();
  }
  std::array<float, kTile_px> positions{};
  std::array<Imath::half, kTile_px> sigmas{};
  std::array<Label, kTile_px> labels{};
  std::copy_n(position.data() + first, rest, positions.begin());
  std::copy_n(sigma.data() + first, rest, sigmas.begin());
  std::copy_n(map.label.data() + first, rest, labels.begin());
  kernel(period.rule, steps, difference + first, {positions.data(), sigmas.data(), labels.data()});
  std::copy_n(positions.begin(), rest, position.data() + first);
  std::copy_n(sigmas.begin(), rest, sigma.data() + first);
  std::copy_n(labels.begin(), rest, map.label.data() + first);
}

void Decoder::State::fold_periods() {
  if (periods.empty() || !is_gray_folded()) return;
  if (!has_positions) make_positions();
  const decode::PhaseKernels& kernels = decode::vector_phase_kernels();
  // In their order, for a period sharpens what the one before it left.
  for (Period& period : periods) {
    if (period.folded) continue;
    if (!period.is_ready()) return;
    if (*format == PixelFormat::mono8) {
      fold_period_as<std::uint8_t>(period, kernels.refine8);
    } else {
      fold_period_as<std::uint16_t>(period, kernels.refine16);
    }
    period.frames.clear();
    period.folded = true;
  }
}

void Decoder::State::drop_unsharpened() {
  constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
  constexpr auto kNoSigma = std::numeric_limits<Imath::half>::quiet_NaN();
  // Half of what Gray code's finest cell alone gives.
  const auto most = [&](Axis axis, const decode::AxisBits& axis_bits) {
    const bool has_phases =
        std::ranges::any_of(periods, [&](const Period& period) { return period.axis == axis; });
    return has_phases ? 0.5F * decode::kCellSigma * static_cast<float>(1 << axis_bits.lowest)
                      : std::numeric_limits<float>::infinity();
  };
  const float most_u = most(Axis::u, final_rule.u), most_v = most(Axis::v, final_rule.v);
  // What lies beyond the display's edge is a pixel that sees the edge: no whole period is in it.
  const auto is_within = [](float position_px, const decode::AxisBits& axis_bits) {
    return position_px >= -0.5F && position_px <= static_cast<float>(axis_bits.last_px) + 0.5F;
  };
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    if (map.label[i] == Label::mirror &&
        !(map.sigma_u_px[i] <= most_u && map.sigma_v_px[i] <= most_v &&
          is_within(map.u_px[i], final_rule.u) && is_within(map.v_px[i], final_rule.v))) {
      map.label[i] = Label::mixed;
    }
    if (map.label[i] == Label::mirror) continue;
    map.u_px[i] = map.v_px[i] = kNothing;
    map.sigma_u_px[i] = map.sigma_v_px[i] = kNoSigma;
  }
}

Decoder::Decoder(std::unique_ptr<State> state) noexcept : state_(std::move(state)) {}
Decoder::Decoder(Decoder&&) noexcept = default;
Decoder& Decoder::operator=(Decoder&&) noexcept = default;
Decoder::~Decoder() = default;

Result<Decoder> Decoder::make(const DecodeOptions& options, const StackKey& key, double angle_rad,
                              const Region& region, int bits, int display_width_px,
                              int display_height_px, std::span<const Pattern> sequence) {
  ALHAZEN_TRY(options.is_valid());
  if (region.width < 1 || region.height < 1 || region.width > 65'535 || region.height > 65'535) {
    return Error{Code::invalid, "a region of " + std::to_string(region.width) + " x " +
                                    std::to_string(region.height) +
                                    " px; its sides must be in [1, 65535] px"};
  }
  if (bits < 8 || bits > 16) {
    return Error{Code::invalid,
                 "frames of " + std::to_string(bits) + " bits a pixel; it must be in [8, 16]"};
  }
  // Judges the display's size, and names every pattern that may come.
  const std::vector<Pattern> all =
      ALHAZEN_TRY(make_sequence(Coding::gray, display_width_px, display_height_px));
  auto state = std::make_unique<State>();
  state->map.key = key;
  state->map.angle_rad = angle_rad;
  state->map.region = region;
  state->bits = bits;
  state->tiles = (state->map.size_px() + kTile_px - 1) / kTile_px;
  state->sequence.assign(sequence.begin(), sequence.end());

  for (auto i = sequence.begin(); i != sequence.end(); ++i) {
    if (i->kind != PatternKind::phase && std::find(all.begin(), all.end(), *i) == all.end()) {
      return Error{Code::invalid, text_of(*i) + " does not exist on a display of " +
                                      std::to_string(display_width_px) + " x " +
                                      std::to_string(display_height_px) + " px"};
    }
    if (std::find(sequence.begin(), i, *i) != i) {
      return Error{Code::invalid, text_of(*i) + " is in the sequence twice"};
    }
  }
  for (auto i = all.begin(); i != all.end(); ++i) {
    if (std::ranges::find(sequence, *i) != sequence.end()) {
      if (i->kind == PatternKind::gray) {
        state->gray_pairs[static_cast<std::size_t>(i->axis)][static_cast<std::size_t>(i->bit)]
            .emplace();
      }
      continue;
    }
    // Missing is right only with its partner and everything finer on the axis.
    const bool finer_is_there = std::ranges::any_of(sequence, [&](const Pattern& other) {
      return other.kind == PatternKind::gray && other.axis == i->axis && other.bit <= i->bit;
    });
    const bool is_coarsest =
        i->kind != PatternKind::gray ||
        i->bit == gray_bits(i->axis == Axis::u ? display_width_px : display_height_px) - 1;
    if (finer_is_there || is_coarsest) {
      return Error{Code::invalid, text_of(*i) + " is missing in the sequence"};
    }
  }

  state->final_rule.saturated_plane = 0;
  state->tile_planes = 2;
  for (const Axis axis : {Axis::u, Axis::v}) {
    decode::AxisBits& out = axis == Axis::u ? state->final_rule.u : state->final_rule.v;
    auto& pairs = state->gray_pairs[static_cast<std::size_t>(axis)];
    const int side_px = axis == Axis::u ? display_width_px : display_height_px;
    out.bits = gray_bits(side_px);
    while (!pairs[static_cast<std::size_t>(out.lowest)]) ++out.lowest;
    out.last_px = static_cast<std::uint16_t>(side_px - 1);
    out.first_plane = state->tile_planes;
    for (int bit = out.lowest; bit < out.bits; ++bit) {
      pairs[static_cast<std::size_t>(bit)]->plane = state->tile_planes;
      state->tile_planes += kPlanesPerBit;
    }
  }

  ALHAZEN_TRY(state->add_periods(options));

  const int full_scale = (1 << bits) - 1;
  const auto dn = [full_scale](double share) { return share * full_scale; };
  decode::ContrastRule& contrast_rule = state->contrast_rule;
  contrast_rule.full_scale = static_cast<std::uint16_t>(full_scale);
  contrast_rule.least =
      static_cast<std::uint16_t>(std::max(1.0, std::ceil(dn(options.min_contrast))));
  contrast_rule.noise = static_cast<std::uint16_t>(std::lround(dn(kNoiseSigmas * options.noise)));
  contrast_rule.modulation_q16 =
      static_cast<std::uint16_t>(std::lround(options.min_modulation * 65'535));
  // Where phases follow they judge what scatters light; all they need is their period, which the
  // bit above the finest shown one tells, too: that one is unresolved on its edges.
  const int coarsest = state->periods.empty()
                           ? options.max_bit
                           : std::max(state->final_rule.u.lowest, state->final_rule.v.lowest) + 1;
  state->final_rule.coarsest = static_cast<std::uint16_t>(1U << static_cast<unsigned>(coarsest));
  state->final_rule.to_255 = static_cast<float>(255 / dn(1));
  state->final_rule.noise_square =
      static_cast<float>(std::pow(dn(kNoiseToCells * options.noise), 2)) * kNoiseSquareToSigma;
  return Decoder(std::move(state));
}

Status Decoder::add(const Pattern& pattern, const Image& image) {
  ALHAZEN_TRY(state_->check(pattern, image));
  std::optional<Image>* place = state_->place_of(pattern);
  if (place == nullptr || *place) {
    return Error{Code::conflict, text_of(pattern) + " was there already"};
  }
  *place = image;
  state_->format = image.format();
  if (pattern.kind == PatternKind::white || pattern.kind == PatternKind::black) {
    state_->fold_contrast();
  }
  state_->fold_pairs();
  state_->fold_periods();
  return {};
}

bool Decoder::complete() const noexcept {
  return state_->is_gray_folded() &&
         std::ranges::all_of(state_->periods, [](const Period& period) { return period.folded; });
}

Result<LightMap> Decoder::finish() && {
  State& state = *state_;
  for (const Pattern& pattern : state.sequence) {
    const std::optional<Image>* place = state.place_of(pattern);
    if (place != nullptr && !*place) return Error{Code::conflict, text_of(pattern) + " is missing"};
  }
  if (!state.has_positions) state.make_positions();
  if (!state.periods.empty()) state.drop_unsharpened();
  return std::move(state.map);
}

}  // namespace alhazen
