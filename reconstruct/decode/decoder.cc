#include "reconstruct/decode/decoder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "reconstruct/decode/kernels.h"
#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

using decode::kBlock_px;
using decode::kMaxBits;

// Differences within so many standard deviations of noise are not believed.
constexpr double kNoiseSigmas = 3;
// A resolved bit's edge is a ramp of at most 3.2 cells of that bit, where a difference rises by
// twice the contrast (method: the finest bit that survives a footprint F is F / 3.2 pixels wide);
// so noise moves the edge by 3.2 / 2 cells · noise / contrast.
constexpr double kNoiseToCells = 1.6;
// Results are made in pieces that stay in the cache until they are copied to their lists.
constexpr std::size_t kChunk_px = 4096;

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
      return "phase step " + std::to_string(pattern.step);
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
  bool folded = false;
  std::size_t plane = 0;  ///< offset of sign; resolved follows
};

}  // namespace

Status DecodeOptions::is_valid() const {
  constexpr double kLeast = 1e-6;
  ALHAZEN_TRY(in_range("min_contrast", min_contrast, kLeast, 1 - kLeast));
  ALHAZEN_TRY(in_range("min_modulation", min_modulation, kLeast, 1 - kLeast));
  ALHAZEN_TRY(in_range("noise", noise, 0, 0.1));
  return in_range("max_bit", max_bit, 0, kMaxBits - 1);
}

struct Decoder::State {
  StackKey key;
  double angle_rad = 0;
  Region region;
  int bits = 0, display_width_px = 0, display_height_px = 0;
  decode::ContrastRule rule;
  float noise_cells = 0;
  std::uint16_t coarsest = 0;
  std::vector<Pattern> sequence;

  std::optional<PixelFormat> format;  ///< of the first frame
  std::size_t size_px = 0, padded_px = 0;
  Pair contrast_pair;
  std::array<std::array<std::optional<Pair>, kMaxBits>, 2> gray_pairs;  ///< by axis and bit
  std::vector<float> contrast;
  std::unique_ptr<std::uint8_t[]> threshold;  ///< padded_px of the frames' format
  std::unique_ptr<std::uint8_t[]> planes;     ///< saturated, then sign and resolved of each pair

  [[nodiscard]] Pair* pair_of(const Pattern& pattern);
  [[nodiscard]] Status check(const Pattern& pattern, const Image& image) const;
  void fold_contrast();
  void fold(Pair& pair);
  template <class Dn, class Kernel>
  void fold_contrast_as(const Kernel& kernel);
  template <class Dn, class Kernel>
  void fold_as(Pair& pair, const Kernel& kernel);
  [[nodiscard]] decode::AxisPlanes axis_planes(Axis axis) const;
};

Pair* Decoder::State::pair_of(const Pattern& pattern) {
  if (pattern.kind != PatternKind::gray) return &contrast_pair;
  auto& pair =
      gray_pairs[static_cast<std::size_t>(pattern.axis)][static_cast<std::size_t>(pattern.bit)];
  return pair ? &*pair : nullptr;
}

Status Decoder::State::check(const Pattern& pattern, const Image& image) const {
  if (std::ranges::find(sequence, pattern) == sequence.end()) {
    return Error{Code::invalid, text_of(pattern) + " is not of the sequence"};
  }
  if (image.width() != region.width || image.height() != region.height) {
    return Error{Code::invalid, "a frame of " + std::to_string(image.width()) + " x " +
                                    std::to_string(image.height()) + " px; it must have " +
                                    std::to_string(region.width) + " x " +
                                    std::to_string(region.height) + " px"};
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

template <class Dn, class Kernel>
void Decoder::State::fold_contrast_as(const Kernel& kernel) {
  const auto* white = reinterpret_cast<const Dn*>(contrast_pair.first->bytes().data());
  const auto* black = reinterpret_cast<const Dn*>(contrast_pair.second->bytes().data());
  auto* limit = reinterpret_cast<Dn*>(threshold.get());
  const std::size_t whole_px = size_px - size_px % kBlock_px;
  kernel(rule, white, black, whole_px, contrast.data(), limit, planes.get());
  if (whole_px < size_px) {
    std::array<Dn, kBlock_px> last_white{}, last_black{};
    std::copy(white + whole_px, white + size_px, last_white.begin());
    std::copy(black + whole_px, black + size_px, last_black.begin());
    kernel(rule, last_white.data(), last_black.data(), kBlock_px, contrast.data() + whole_px,
           limit + whole_px, planes.get() + whole_px / 8);
  }
}

template <class Dn, class Kernel>
void Decoder::State::fold_as(Pair& pair, const Kernel& kernel) {
  const auto* pattern = reinterpret_cast<const Dn*>(pair.first->bytes().data());
  const auto* inverse = reinterpret_cast<const Dn*>(pair.second->bytes().data());
  const auto* limit = reinterpret_cast<const Dn*>(threshold.get());
  std::uint8_t* sign = planes.get() + pair.plane;
  std::uint8_t* resolved = sign + padded_px / 8;
  const std::size_t whole_px = size_px - size_px % kBlock_px;
  kernel(pattern, inverse, limit, whole_px, sign, resolved);
  if (whole_px < size_px) {
    std::array<Dn, kBlock_px> last_pattern{}, last_inverse{};
    std::copy(pattern + whole_px, pattern + size_px, last_pattern.begin());
    std::copy(inverse + whole_px, inverse + size_px, last_inverse.begin());
    kernel(last_pattern.data(), last_inverse.data(), limit + whole_px, kBlock_px,
           sign + whole_px / 8, resolved + whole_px / 8);
  }
}

void Decoder::State::fold(Pair& pair) {
  if (pair.folded || !pair.first || !pair.second || !contrast_pair.folded) return;
  const decode::Kernels& kernels = decode::scalar_kernels();
  if (*format == PixelFormat::mono8) {
    fold_as<std::uint8_t>(pair, kernels.pair8);
  } else {
    fold_as<std::uint16_t>(pair, kernels.pair16);
  }
  pair.first.reset();
  pair.second.reset();
  pair.folded = true;
}

void Decoder::State::fold_contrast() {
  if (contrast_pair.folded || !contrast_pair.first || !contrast_pair.second) return;
  const decode::Kernels& kernels = decode::scalar_kernels();
  contrast.resize(padded_px);
  threshold.reset(new std::uint8_t[padded_px * bytes_per_pixel(*format)]);
  std::size_t pairs = 0;
  for (const auto& axis : gray_pairs) {
    for (const auto& pair : axis) pairs += pair ? 1U : 0U;
  }
  planes.reset(new std::uint8_t[(2 * pairs + 1) * (padded_px / 8)]);
  if (*format == PixelFormat::mono8) {
    fold_contrast_as<std::uint8_t>(kernels.contrast8);
  } else {
    fold_contrast_as<std::uint16_t>(kernels.contrast16);
  }
  contrast_pair.first.reset();
  contrast_pair.second.reset();
  contrast_pair.folded = true;
}

decode::AxisPlanes Decoder::State::axis_planes(Axis axis) const {
  const int side_px = axis == Axis::u ? display_width_px : display_height_px;
  decode::AxisPlanes out;
  out.bits = gray_bits(side_px);
  out.last_px = static_cast<std::uint16_t>(side_px - 1);
  for (std::size_t bit = 0; bit < kMaxBits; ++bit) {
    const auto& pair = gray_pairs[static_cast<std::size_t>(axis)][bit];
    if (!pair) continue;
    out.sign[bit] = planes.get() + pair->plane;
    out.resolved[bit] = out.sign[bit] + padded_px / 8;
  }
  return out;
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
  state->key = key;
  state->angle_rad = angle_rad;
  state->region = region;
  state->bits = bits;
  state->display_width_px = display_width_px;
  state->display_height_px = display_height_px;
  state->size_px = static_cast<std::size_t>(region.width) * static_cast<std::size_t>(region.height);
  state->padded_px = (state->size_px + kBlock_px - 1) / kBlock_px * kBlock_px;
  state->sequence.assign(sequence.begin(), sequence.end());

  for (auto i = sequence.begin(); i != sequence.end(); ++i) {
    if (i->kind == PatternKind::phase) {
      return Error{Code::unsupported, "phase patterns are not decoded yet"};
    }
    if (std::find(all.begin(), all.end(), *i) == all.end()) {
      return Error{Code::invalid, text_of(*i) + " does not exist on a display of " +
                                      std::to_string(display_width_px) + " x " +
                                      std::to_string(display_height_px) + " px"};
    }
    if (std::find(sequence.begin(), i, *i) != i) {
      return Error{Code::invalid, text_of(*i) + " is in the sequence twice"};
    }
  }
  std::size_t plane = state->padded_px / 8;  // behind the plane of saturation
  for (auto i = all.begin(); i != all.end(); ++i) {
    if (std::ranges::find(sequence, *i) != sequence.end()) {
      if (i->kind == PatternKind::gray && !i->inverted) {
        auto& pair =
            state->gray_pairs[static_cast<std::size_t>(i->axis)][static_cast<std::size_t>(i->bit)];
        pair.emplace();
        pair->plane = plane;
        plane += 2 * (state->padded_px / 8);
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

  const double full_scale = (1 << bits) - 1;
  state->rule.full_scale = static_cast<std::uint16_t>(full_scale);
  state->rule.least =
      static_cast<std::uint16_t>(std::max(1.0, std::ceil(options.min_contrast * full_scale)));
  state->rule.noise =
      static_cast<std::uint16_t>(std::lround(kNoiseSigmas * options.noise * full_scale));
  state->rule.modulation_q16 =
      static_cast<std::uint16_t>(std::lround(options.min_modulation * 65'535));
  state->rule.per_dn = static_cast<float>(1 / full_scale);
  state->noise_cells = static_cast<float>(kNoiseToCells * options.noise);
  state->coarsest = static_cast<std::uint16_t>(1U << static_cast<unsigned>(options.max_bit));
  return Decoder(std::move(state));
}

Status Decoder::add(const Pattern& pattern, const Image& image) {
  ALHAZEN_TRY(state_->check(pattern, image));
  Pair& pair = *state_->pair_of(pattern);
  const bool is_first = pattern.kind == PatternKind::white ||
                        (pattern.kind == PatternKind::gray && !pattern.inverted);
  std::optional<Image>& place = is_first ? pair.first : pair.second;
  if (pair.folded || place) return Error{Code::conflict, text_of(pattern) + " was there already"};
  place = image;
  state_->format = image.format();
  if (pattern.kind != PatternKind::gray) {
    state_->fold_contrast();
    for (auto& axis : state_->gray_pairs) {
      for (auto& waiting : axis) {
        if (waiting) state_->fold(*waiting);
      }
    }
  } else {
    state_->fold(pair);
  }
  return {};
}

bool Decoder::complete() const noexcept {
  return state_->contrast_pair.folded &&
         std::ranges::all_of(state_->gray_pairs, [](const auto& axis) {
           return std::ranges::all_of(
               axis, [](const std::optional<Pair>& pair) { return !pair || pair->folded; });
         });
}

Result<LightMap> Decoder::finish() && {
  State& state = *state_;
  for (const Pattern& pattern : state.sequence) {
    const Pair& pair = *state.pair_of(pattern);
    const bool is_first = pattern.kind == PatternKind::white ||
                          (pattern.kind == PatternKind::gray && !pattern.inverted);
    if (!pair.folded && !(is_first ? pair.first : pair.second)) {
      return Error{Code::conflict, text_of(pattern) + " is missing"};
    }
  }
  decode::Final final;
  final.u = state.axis_planes(Axis::u);
  final.v = state.axis_planes(Axis::v);
  final.contrast = state.contrast.data();
  final.saturated = state.planes.get();
  // Between the least that decodes and the next lower one: no question of rounding.
  final.least_contrast = (static_cast<float>(state.rule.least) - 0.5F) * state.rule.per_dn;
  final.coarsest = state.coarsest;
  final.noise = state.noise_cells;

  LightMap map;
  map.key = std::move(state.key);
  map.angle_rad = state.angle_rad;
  map.region = state.region;
  for (auto* list : {&map.u_px, &map.v_px, &map.sigma_u_px, &map.sigma_v_px}) {
    list->reserve(state.size_px);
  }
  map.label.reserve(state.size_px);
  map.bit_u.reserve(state.size_px);
  map.bit_v.reserve(state.size_px);
  struct Chunk {
    std::array<float, kChunk_px> u, v, sigma_u, sigma_v;
    std::array<Label, kChunk_px> label;
    std::array<std::uint8_t, kChunk_px> bit_u, bit_v;
  };
  const auto chunk = std::make_unique<Chunk>();
  const decode::FinalOut out = {chunk->u.data(),       chunk->v.data(),     chunk->sigma_u.data(),
                                chunk->sigma_v.data(), chunk->label.data(), chunk->bit_u.data(),
                                chunk->bit_v.data()};
  const decode::Kernels& kernels = decode::scalar_kernels();
  for (std::size_t begin = 0; begin < state.size_px; begin += kChunk_px) {
    kernels.finish(final, begin, std::min(kChunk_px, state.padded_px - begin), out);
    const std::size_t count = std::min(kChunk_px, state.size_px - begin);
    const auto append = [count](auto& list, const auto& piece) {
      list.insert(list.end(), piece.data(), piece.data() + count);
    };
    append(map.u_px, chunk->u);
    append(map.v_px, chunk->v);
    append(map.sigma_u_px, chunk->sigma_u);
    append(map.sigma_v_px, chunk->sigma_v);
    append(map.label, chunk->label);
    append(map.bit_u, chunk->bit_u);
    append(map.bit_v, chunk->bit_v);
  }
  state.contrast.resize(state.size_px);
  map.contrast = std::move(state.contrast);
  return map;
}

}  // namespace alhazen
