#include "reconstruct/decode/decoder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <memory>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "reconstruct/pattern/draw.h"
#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

const StackKey kKey{3, "north", "left"};

std::vector<Pattern> sequence_of(int width_px, int height_px) {
  return *make_sequence(Coding::gray, width_px, height_px);
}

/// A display decoded from its own pictures: pixel (x, y) must say (x, y).
LightMap decode_itself(int width_px, int height_px) {
  const std::vector<Pattern> sequence = sequence_of(width_px, height_px);
  Decoder decoder =
      *Decoder::make({}, kKey, 0.5, {0, 0, width_px, height_px}, 8, width_px, height_px, sequence);
  for (const Pattern& pattern : sequence) {
    EXPECT_FALSE(decoder.complete());
    EXPECT_TRUE(decoder.add(pattern, draw(pattern, width_px, height_px)->image));
  }
  EXPECT_TRUE(decoder.complete());
  return *std::move(decoder).finish();
}

TEST(Decoder, EveryDisplayDecodesItself) {
  for (const auto& [width, height] :
       {std::pair{2, 2}, {3, 5}, {7, 2}, {64, 64}, {64, 1023}, {1025, 3}, {16384, 2}, {2, 16383}}) {
    const LightMap map = decode_itself(width, height);
    ASSERT_EQ(map.region.width, width);
    EXPECT_EQ(map.key, kKey);
    EXPECT_EQ(map.angle_rad, 0.5);
    ASSERT_EQ(map.u_px.size(), map.size_px());
    std::size_t i = 0;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x, ++i) {
        ASSERT_EQ(map.label[i], Label::mirror) << x << " " << y;
        ASSERT_EQ(map.u_px[i], static_cast<float>(x));
        ASSERT_EQ(map.v_px[i], static_cast<float>(y));
        ASSERT_EQ(map.bit_u[i], 0);
        ASSERT_NEAR(map.sigma_u_px[i], 1 / std::sqrt(12.0), 1e-3);
        ASSERT_EQ(map.contrast[i], 255);
      }
    }
  }
}

constexpr int kWidth_px = 1280;

/// Share of [x − F/2, x + F/2] where the pattern is white, by integrating it display pixel by
/// display pixel: an independent model of a camera's pixel.
double share_of_white(const Pattern& pattern, double centre_px, double width_px) {
  if (pattern.kind == PatternKind::black) return 0;
  const double begin = centre_px - width_px / 2, end = centre_px + width_px / 2;
  double white = 0;
  for (auto u = static_cast<int>(std::floor(begin + 0.5)); u - 0.5 < end; ++u) {
    const double part = std::min(end, u + 0.5) - std::max(begin, u - 0.5);
    if (u < 0 || u >= kWidth_px) continue;  // nothing shines beside the display
    if (pattern.kind == PatternKind::white) {
      white += part;
      continue;
    }
    if (pattern.kind == PatternKind::phase) {
      white += part * (0.5 + 0.5 * std::cos(2 * std::numbers::pi *
                                            (static_cast<double>(u) / pattern.period_px -
                                             static_cast<double>(pattern.step) / pattern.steps)));
      continue;
    }
    const bool one = ((gray_from_binary(static_cast<std::uint32_t>(u)) >> pattern.bit) & 1U) != 0;
    if (one != pattern.inverted) white += part;
  }
  return white / width_px;
}

struct Seen {
  double u_px, footprint_px;  ///< what share `other` sees is mixed in
  double other_px = 0, other_share = 0;
  double brightness = 1;
};

/// Decodes pixels that see these places; v is the same for all.
LightMap decode_seen(const std::vector<Seen>& pixels, double noise_dn, DecodeOptions options = {},
                     int bits = 8, int lowest_bit = 0, Coding coding = Coding::gray) {
  const double full_scale = (1 << bits) - 1;
  std::vector<Pattern> sequence = *make_sequence(coding, kWidth_px, 2);
  std::erase_if(sequence, [&](const Pattern& pattern) {
    return pattern.kind == PatternKind::gray && pattern.axis == Axis::u && pattern.bit < lowest_bit;
  });
  const Region region{10, 20, static_cast<int>(pixels.size()), 1};
  Decoder decoder = *Decoder::make(options, kKey, 0, region, bits, kWidth_px, 2, sequence);
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, noise_dn);
  for (const Pattern& pattern : sequence) {
    std::vector<std::uint16_t> frame;
    for (const Seen& pixel : pixels) {
      const bool is_u = pattern.axis == Axis::u;
      const double place = is_u ? pixel.u_px : 0;
      const double width = is_u ? pixel.footprint_px : 0.1;
      const double light =
          (1 - pixel.other_share) * share_of_white(pattern, place, width) +
          pixel.other_share * share_of_white(pattern, is_u ? pixel.other_px : 0, width);
      const double dn = full_scale * (0.05 + 0.85 * pixel.brightness * light) + noise(random);
      frame.push_back(static_cast<std::uint16_t>(std::clamp(std::round(dn), 0.0, full_scale)));
    }
    if (bits == 8) {
      const std::vector<std::uint8_t> bytes(frame.begin(), frame.end());
      EXPECT_TRUE(decoder.add(pattern, Image::copy<std::uint8_t>(region.width, 1, 8, bytes)));
    } else {
      EXPECT_TRUE(decoder.add(pattern, Image::copy<std::uint16_t>(region.width, 1, bits, frame)));
    }
  }
  return *std::move(decoder).finish();
}

/// Places all over the display, but for its edges.
std::vector<Seen> places(double footprint_px, std::size_t count) {
  std::mt19937 random(11);
  std::uniform_real_distribution<double> u(footprint_px, 1279 - footprint_px);
  std::vector<Seen> pixels;
  for (std::size_t i = 0; i < count; ++i) pixels.push_back({u(random), footprint_px});
  return pixels;
}

TEST(Decoder, ResolvesWhatTheOpticsDoAndNothingFiner) {
  for (const int bits : {8, 12}) {
    for (const double footprint_px : {0.2, 1.0, 1.9, 3.0, 3.9, 5.0, 6.4, 9.0, 16.0, 30.0, 50.0}) {
      SCOPED_TRACE(footprint_px);
      const std::vector<Seen> pixels = places(footprint_px, 3000);
      const LightMap map = decode_seen(pixels, bits == 8 ? 0.7 : 11, {}, bits);
      // The finest bit that survives F is F / 3.2 wide; where it happens to lie on its edge, the
      // next coarser one counts, and off its edge the next finer one may not have faded.
      const double cell_px = std::exp2(std::max(0.0, std::ceil(std::log2(footprint_px / 3.2))));
      std::size_t decoded = 0;
      double squares = 0;
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        if (!map.is_position(i)) continue;
        ++decoded;
        const double error_px = map.u_px[i] - pixels[i].u_px;
        squares += std::pow(error_px / map.sigma_u_px[i], 2);
        ASSERT_LE(std::abs(error_px), 0.5 * std::exp2(map.bit_u[i]) + 0.15 * footprint_px)
            << pixels[i].u_px;
        ASSERT_GE(std::exp2(map.bit_u[i]), 0.5 * cell_px);
        ASSERT_LE(std::exp2(map.bit_u[i]), 4 * cell_px);
      }
      EXPECT_GE(decoded, pixels.size() * 97 / 100);
      // Sigma is neither boast nor alarm.
      const double rms = std::sqrt(squares / static_cast<double>(decoded));
      EXPECT_GT(rms, 0.6);
      EXPECT_LT(rms, 1.15);
    }
  }
}

TEST(Decoder, EdgesOfCoarseBitsAreOneCellWide) {
  // Exactly on an edge of every bit: its own reading is noise, the others decide.
  std::vector<Seen> pixels;
  for (int u = 1; u < 1279; ++u) {
    for (const double offset : {-0.02, 0.0, 0.02}) pixels.push_back({u - 0.5 + offset, 1.0});
  }
  const LightMap map = decode_seen(pixels, 1.0);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    ASSERT_EQ(map.label[i], Label::mirror) << pixels[i].u_px;
    ASSERT_LE(std::abs(map.u_px[i] - pixels[i].u_px), 0.55);
  }
}

TEST(Decoder, TwoPlacesAtOnceAreMixed) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(20, 1260), share(0.42, 0.5);
  std::vector<Seen> pixels;
  while (pixels.size() < 4000) {
    const Seen seen{u(random), 1.5, u(random), share(random)};
    if (std::abs(seen.u_px - seen.other_px) > 8) pixels.push_back(seen);
  }
  const LightMap map = decode_seen(pixels, 0.7);
  std::size_t positions = 0, far = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!map.is_position(i)) continue;
    ++positions;
    const double off = std::min(std::abs(map.u_px[i] - pixels[i].u_px),
                                std::abs(map.u_px[i] - pixels[i].other_px));
    far += off > 3 * map.sigma_u_px[i] ? 1U : 0U;
  }
  // Codes that differ in one bit only, mirrored about its edge, cannot be told from a clean one by
  // that axis alone.
  EXPECT_LT(positions, pixels.size() / 20);
  EXPECT_LT(far, pixels.size() / 50);
}

TEST(Decoder, TheBrighterOfTwoPlacesWinsWhereItIsClear) {
  std::vector<Seen> pixels = places(1.0, 2000);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> u(20, 1260);
  for (Seen& pixel : pixels) {
    pixel.other_px = u(random);
    pixel.other_share = 0.25;
  }
  const LightMap map = decode_seen(pixels, 0.5);
  std::size_t right = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    right += map.is_position(i) && std::abs(map.u_px[i] - pixels[i].u_px) < 1.6 ? 1U : 0U;
  }
  EXPECT_GE(right, pixels.size() * 97 / 100);
}

TEST(Decoder, NoContrastNoPosition) {
  std::vector<Seen> pixels = places(1.0, 500);
  for (std::size_t i = 0; i < pixels.size(); ++i) pixels[i].brightness = i % 2 == 0 ? 0.05 : 1.0;
  const LightMap map = decode_seen(pixels, 0.3);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    ASSERT_EQ(map.label[i], i % 2 == 0 ? Label::none : Label::mirror);
    ASSERT_EQ(std::isnan(map.u_px[i]), i % 2 == 0);
    ASSERT_NEAR(map.contrast[i] / 255.0, i % 2 == 0 ? 0.0425 : 0.85, 0.01);
  }
}

TEST(Decoder, SequencesMayEndAboveTheFinestBit) {
  const std::vector<Seen> pixels = places(1.0, 1000);
  const LightMap map = decode_seen(pixels, 0.5, {}, 8, 3);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    ASSERT_TRUE(map.is_position(i));
    ASSERT_GE(map.bit_u[i], 3);
    ASSERT_LE(std::abs(map.u_px[i] - pixels[i].u_px), 4.2);
  }
}

TEST(Decoder, ScatteredLightIsNoPosition) {
  // A matt surface sees the whole display, one half of it better.
  const std::vector<Pattern> sequence = sequence_of(1280, 1024);
  Decoder decoder = *Decoder::make({}, kKey, 0, {0, 0, 1, 1}, 8, 1280, 1024, sequence);
  for (const Pattern& pattern : sequence) {
    std::uint8_t dn = 100;
    if (pattern.kind == PatternKind::white) dn = 180;
    if (pattern.kind == PatternKind::black) dn = 20;
    if (pattern.kind == PatternKind::gray && pattern.bit >= 9) dn = pattern.inverted ? 60 : 140;
    ASSERT_TRUE(
        decoder.add(pattern, Image::copy<std::uint8_t>(1, 1, 8, std::vector<std::uint8_t>{dn})));
  }
  const LightMap map = *std::move(decoder).finish();
  EXPECT_EQ(map.label[0], Label::mixed);
  EXPECT_EQ(map.bit_u[0], 9);
  EXPECT_EQ(map.bit_v[0], 9);
}

TEST(Decoder, PhasesAreSubPixel) {
  for (const int bits : {8, 12}) {
    for (const double footprint_px : {1.0, 5.0, 16.0, 30.0, 50.0, 75.0, 120.0, 160.0}) {
      SCOPED_TRACE(footprint_px);
      const std::vector<Seen> pixels = places(footprint_px, 3000);
      const LightMap map =
          decode_seen(pixels, bits == 8 ? 0.7 : 11, {}, bits, 0, Coding::gray_phase);
      std::size_t decoded = 0;
      double squares = 0, sum = 0, errors2 = 0;
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        if (!map.is_position(i)) continue;
        ++decoded;
        const double error_px = map.u_px[i] - pixels[i].u_px;
        sum += error_px;
        errors2 += error_px * error_px;
        squares += std::pow(error_px / map.sigma_u_px[i], 2);
      }
      const auto count = static_cast<double>(decoded);
      EXPECT_GE(decoded, pixels.size() * 97 / 100);
      const double rms_px = std::sqrt(errors2 / count), sigmas = std::sqrt(squares / count);
      // A 200th of the footprint, or of the shortest period where that is more.
      EXPECT_LE(rms_px, std::max(footprint_px, kPhasePeriods_px.back() / 2.0) / 150);
      EXPECT_LE(std::abs(sum / count), 4 * rms_px / std::sqrt(count) + 0.005);
      EXPECT_GT(sigmas, 0.7);
      EXPECT_LT(sigmas, 1.3);
    }
  }
}

TEST(Decoder, WiderThanEveryPeriodIsNoPosition) {
  const std::vector<Seen> pixels = places(300, 1000);
  const LightMap map = decode_seen(pixels, 0.7, {}, 8, 0, Coding::gray_phase);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    ASSERT_EQ(map.label[i], Label::mixed);
    ASSERT_TRUE(std::isnan(map.u_px[i]) && std::isnan(map.v_px[i]));
    ASSERT_TRUE(std::isnan(float{map.sigma_u_px[i]}) && std::isnan(float{map.sigma_v_px[i]}));
  }
}

TEST(Decoder, TheEdgeOfADisplayIsNotBeyondIt) {
  // Pixels that see the display's edge, and nothing beside it.
  std::vector<Seen> pixels;
  for (double u = -40; u < 40; u += 0.1) pixels.push_back({u, 60});
  for (double u = 1240; u < 1320; u += 0.1) pixels.push_back({u, 60});
  const LightMap map = decode_seen(pixels, 0.7, {}, 8, 0, Coding::gray_phase);
  std::size_t positions = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!map.is_position(i)) continue;
    ++positions;
    ASSERT_GE(map.u_px[i], -0.5F);
    ASSERT_LE(map.u_px[i], 1279.5F);
  }
  EXPECT_GT(positions, pixels.size() / 4);
}

TEST(Decoder, TwoPlacesInThePhasesAreMixed) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(40, 1240), share(0.3, 0.5);
  std::vector<Seen> pixels;
  while (pixels.size() < 4000) {
    const Seen seen{u(random), 1.5, u(random), share(random)};
    if (std::abs(seen.u_px - seen.other_px) > 40) pixels.push_back(seen);
  }
  const LightMap map = decode_seen(pixels, 0.7, {}, 8, 0, Coding::gray_phase);
  std::size_t far = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    if (!map.is_position(i)) continue;
    far += std::abs(map.u_px[i] - pixels[i].u_px) > 4 ? 1U : 0U;
  }
  EXPECT_LT(far, pixels.size() / 25);
}

/// Frames of noise: what matters is that all orders come to the same.
std::vector<Image> noise_frames(std::size_t count, const Region& region) {
  std::minstd_rand random(9);
  std::vector<Image> frames;
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<std::uint8_t> pixels(static_cast<std::size_t>(region.width) *
                                     static_cast<std::size_t>(region.height));
    for (std::uint8_t& dn : pixels) dn = static_cast<std::uint8_t>(random() >> 16);
    frames.push_back(Image::copy<std::uint8_t>(region.width, region.height, 8, pixels));
  }
  return frames;
}

template <class T>
bool same_bytes(const PixelList<T>& a, const PixelList<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

class DecoderOrder : public testing::TestWithParam<std::tuple<Coding, int, int>> {};
INSTANTIATE_TEST_SUITE_P(Codings, DecoderOrder,
                         testing::Values(std::tuple{Coding::gray, 40, 30},
                                         std::tuple{Coding::gray_phase, 70, 300}));

TEST_P(DecoderOrder, DoesNotMatter) {
  const Region region{0, 0, 97, 61};  // more than a tile, and no whole number of them
  const auto [coding, width_px, height_px] = GetParam();
  const std::vector<Pattern> sequence = *make_sequence(coding, width_px, height_px);
  const std::vector<Image> frames = noise_frames(sequence.size(), region);
  std::vector<std::size_t> order(sequence.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::optional<LightMap> first;
  std::mt19937 random(1);
  for (int round = 0; round < 12; ++round) {
    Decoder decoder = *Decoder::make({}, kKey, 0, region, 8, width_px, height_px, sequence);
    for (const std::size_t i : order) ASSERT_TRUE(decoder.add(sequence[i], frames[i]));
    LightMap map = *std::move(decoder).finish();
    if (!first) first = map;
    EXPECT_TRUE(same_bytes(map.u_px, first->u_px) && same_bytes(map.v_px, first->v_px) &&
                same_bytes(map.sigma_u_px, first->sigma_u_px) &&
                same_bytes(map.sigma_v_px, first->sigma_v_px) &&
                same_bytes(map.contrast, first->contrast) && same_bytes(map.label, first->label) &&
                same_bytes(map.bit_u, first->bit_u) && same_bytes(map.bit_v, first->bit_v));
    std::ranges::shuffle(order, random);
  }
}

TEST(Decoder, KeepsFourPairsAtMost) {
  const Region region{0, 0, 8, 8};
  const std::vector<Pattern> sequence = sequence_of(40, 30);
  Decoder decoder = *Decoder::make({}, kKey, 0, region, 8, 40, 30, sequence);
  const std::vector<Image> frames = noise_frames(sequence.size(), region);
  std::vector<std::weak_ptr<const std::byte[]>> alive;
  // White and black are folded at once, then every four pairs, and the last two with the last.
  ASSERT_EQ(sequence.size(), 2U + 2 * 11);
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    std::shared_ptr<std::byte[]> pixels(new std::byte[64]());
    alive.emplace_back(pixels);
    ASSERT_TRUE(decoder.add(sequence[i], Image(8, 8, PixelFormat::mono8, 8, std::move(pixels))));
    const auto held =
        std::ranges::count_if(alive, [](const auto& frame) { return !frame.expired(); });
    const std::size_t since_fold = i < 2 ? i + 1 : (i - 2) % 8 + 1;
    const bool is_folded = i == 1 || since_fold == 8 || i + 1 == sequence.size();
    EXPECT_EQ(held, is_folded ? 0 : static_cast<std::ptrdiff_t>(since_fold)) << i;
  }
}

TEST(Decoder, RefusesWhatDoesNotBelong) {
  const Region region{0, 0, 4, 2};
  const std::vector<Pattern> sequence = sequence_of(8, 8);
  Decoder decoder = *Decoder::make({}, kKey, 0, region, 8, 8, 8, sequence);
  const Image good = Image::copy<std::uint8_t>(4, 2, 8, std::vector<std::uint8_t>(8));
  const Image large = Image::copy<std::uint8_t>(4, 3, 8, std::vector<std::uint8_t>(12));
  const Image deep = Image::copy<std::uint16_t>(4, 2, 12, std::vector<std::uint16_t>(8));
  EXPECT_EQ(decoder.add(sequence[0], large).error().text(),
            "invalid: a frame of 4 x 3 px; it must have 4 x 2 px");
  EXPECT_EQ(decoder.add(sequence[0], deep).error().code, Code::invalid);
  EXPECT_EQ(decoder.add({.kind = PatternKind::gray, .bit = 3}, good).error().text(),
            "invalid: gray bit 3 of u is not of the sequence");
  ASSERT_TRUE(decoder.add(sequence[0], good));
  EXPECT_EQ(decoder.add(sequence[0], good).error().text(), "conflict: white was there already");
  ASSERT_TRUE(decoder.add(sequence[1], good));
  EXPECT_EQ(decoder.add(sequence[1], good).error().code, Code::conflict);
  const auto early = std::move(decoder).finish();
  ASSERT_FALSE(early);
  EXPECT_EQ(early.error().text(), "conflict: gray bit 2 of u is missing");
}

TEST(Decoder, RefusesSequencesThatCannotBeDecoded) {
  const auto make = [](const std::vector<Pattern>& sequence, DecodeOptions options = {}) {
    return Decoder::make(options, kKey, 0, {0, 0, 4, 4}, 8, 8, 8, sequence);
  };
  const std::vector<Pattern> good = sequence_of(8, 8);
  ASSERT_TRUE(make(good));
  for (std::size_t i = 0; i < good.size(); ++i) {
    std::vector<Pattern> missing = good;
    missing.erase(missing.begin() + static_cast<std::ptrdiff_t>(i));
    const auto decoder = make(missing);
    ASSERT_FALSE(decoder) << i;
    EXPECT_EQ(decoder.error().code, Code::invalid);
    EXPECT_NE(decoder.error().what.find("is missing"), std::string::npos);
  }
  std::vector<Pattern> twice = good;
  twice.push_back(good[3]);
  EXPECT_EQ(make(twice).error().code, Code::invalid);
  std::vector<Pattern> beyond = good;
  beyond.push_back({.kind = PatternKind::gray, .bit = 3});
  EXPECT_EQ(make(beyond).error().code, Code::invalid);
  const auto with_period = [&](int period_px, int steps, int shown) {
    std::vector<Pattern> sequence = good;
    for (int step = 0; step < shown; ++step) {
      sequence.push_back(
          {.kind = PatternKind::phase, .period_px = period_px, .step = step, .steps = steps});
    }
    return sequence;
  };
  EXPECT_TRUE(make(with_period(16, 4, 4)));
  EXPECT_NE(make(with_period(16, 4, 3))
                .error()
                .what.find("phase step 3 of 4 of period 16 px of u is missing"),
            std::string::npos);
  EXPECT_NE(make(with_period(3, 4, 4)).error().what.find("must be at least 4 px"),
            std::string::npos);
  EXPECT_EQ(make(with_period(16, 2, 2)).error().code, Code::invalid);
  EXPECT_EQ(make(with_period(0, 4, 4)).error().code, Code::invalid);
  std::vector<Pattern> mixed_steps = with_period(16, 4, 4);
  mixed_steps.push_back({.kind = PatternKind::phase, .period_px = 16, .step = 4, .steps = 5});
  EXPECT_EQ(make(mixed_steps).error().code, Code::invalid);
  EXPECT_EQ(make(good, {.min_phase_modulation = 0.2}).error().code, Code::invalid);
  EXPECT_FALSE(make({}));
  EXPECT_EQ(make(good, {.min_contrast = 0}).error().code, Code::invalid);
  EXPECT_EQ(make(good, {.min_modulation = 1}).error().code, Code::invalid);
  EXPECT_EQ(make(good, {.noise = std::nan("")}).error().code, Code::invalid);
  EXPECT_EQ(make(good, {.max_bit = 14}).error().code, Code::invalid);
  EXPECT_FALSE(Decoder::make({}, kKey, 0, {0, 0, 0, 4}, 8, 8, 8, good));
  EXPECT_FALSE(Decoder::make({}, kKey, 0, {0, 0, 4, 4}, 7, 8, 8, good));
  EXPECT_FALSE(Decoder::make({}, kKey, 0, {0, 0, 4, 4}, 8, 1, 8, good));
}

}  // namespace
}  // namespace alhazen
