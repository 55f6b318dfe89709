// Decoding a stack against reading it once, and against OpenCV on the same frames.
#include <benchmark/benchmark.h>
#include <malloc.h>

#include <algorithm>
#include <cstdint>
#include <ctime>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/structured_light.hpp>
#include <random>
#include <vector>

#include "reconstruct/decode/decoder.h"
#include "reconstruct/decode/kernels.h"
#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

constexpr int kSide_px = 2048;                      // camera
constexpr int kWidth_px = 1280, kHeight_px = 1024;  // display: 2 + 2 · (11 + 10) = 44 frames

double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

template <class Work>
double seconds(Work&& work) {
  const double begin = thread_seconds();
  work();
  return thread_seconds() - begin;
}

struct Stack {
  std::vector<Pattern> sequence = *make_sequence(Coding::gray, kWidth_px, kHeight_px);
  std::vector<Image> frames;
};

/// The display seen whole and slightly turned, with noise of about a digital number.
template <class Dn>
Stack make_stack(int bits) {
  Stack stack;
  const int scale = 1 << (bits - 8);
  std::minstd_rand random(1);
  std::vector<std::uint8_t> noise(1 << 16);
  for (std::uint8_t& value : noise) value = static_cast<std::uint8_t>((random() >> 8) % 4);
  std::vector<Dn> pixels(std::size_t{kSide_px} * kSide_px);
  for (const Pattern& pattern : stack.sequence) {
    const std::size_t shift = random() % noise.size();
    for (int y = 0; y < kSide_px; ++y) {
      for (int x = 0; x < kSide_px; ++x) {
        const int u = std::clamp((5 * x + y) / 12, 0, kWidth_px - 1);
        const int v = std::clamp((5 * y - x) / 12 + 100, 0, kHeight_px - 1);
        const std::uint32_t gray =
            gray_from_binary(static_cast<std::uint32_t>(pattern.axis == Axis::u ? u : v));
        const bool one = pattern.kind == PatternKind::gray
                             ? (((gray >> pattern.bit) & 1U) != 0) != pattern.inverted
                             : pattern.kind == PatternKind::white;
        const auto i = static_cast<std::size_t>(y) * kSide_px + static_cast<std::size_t>(x);
        pixels[i] = static_cast<Dn>(((one ? 180 : 20) + noise[(i + shift) % noise.size()]) * scale);
      }
    }
    stack.frames.push_back(Image::copy<Dn>(kSide_px, kSide_px, bits, pixels));
  }
  return stack;
}

/// Every byte of every frame, once: as fast as memory gives them.
std::uint64_t read_once(const Stack& stack) {
  std::uint64_t sum = 0;
  for (const Image& frame : stack.frames) {
    const auto* words = reinterpret_cast<const std::uint64_t*>(frame.bytes().data());
    const std::size_t count = frame.bytes().size() / sizeof(std::uint64_t);
    std::uint64_t part = 0;
    for (std::size_t i = 0; i < count; ++i) part += words[i];  // the compiler makes vectors of it
    sum += part;
  }
  return sum;
}

/// A scan decodes map after map: memory that the last one gave back is taken again. glibc would
/// return such large lists to the system and have every page cleared anew, which costs twice the
/// decoding.
void keep_memory() {
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, 2'000'000'000);
}

LightMap decode(const Stack& stack) {
  Decoder decoder = *Decoder::make({}, {0, "display", "camera"}, 0, {0, 0, kSide_px, kSide_px},
                                   stack.frames[0].bits(), kWidth_px, kHeight_px, stack.sequence);
  for (std::size_t i = 0; i < stack.frames.size(); ++i) {
    *decoder.add(stack.sequence[i], stack.frames[i]);
  }
  return *std::move(decoder).finish();
}

/// Rounds of reading and decoding in turn, the best of each: other work on the machine disturbs
/// both alike.
template <class Dn>
void decode_against_reading(benchmark::State& state, int bits) {
  keep_memory();
  const Stack stack = make_stack<Dn>(bits);
  double read_s = 1e9, decode_s = 1e9;
  for (auto _ : state) {
    read_s = std::min(read_s, seconds([&] { benchmark::DoNotOptimize(read_once(stack)); }));
    decode_s = std::min(decode_s, seconds([&] { benchmark::DoNotOptimize(decode(stack)); }));
  }
  state.counters["frames"] = static_cast<double>(stack.frames.size());
  state.counters["read_ms"] = 1e3 * read_s;
  state.counters["decode_ms"] = 1e3 * decode_s;
  state.counters["decode_per_read"] = decode_s / read_s;
}

void decode_mono8(benchmark::State& state) { decode_against_reading<std::uint8_t>(state, 8); }
void decode_mono16(benchmark::State& state) { decode_against_reading<std::uint16_t>(state, 12); }

/// GrayCodePattern::getProjPixel() at every pixel, one thread, against the same decode().
void decode_opencv(benchmark::State& state) {
  keep_memory();
  const Stack stack = make_stack<std::uint8_t>(8);
  std::vector<cv::Mat> pictures;  // without white and black, as OpenCV wants them
  for (std::size_t i = 2; i < stack.frames.size(); ++i) {
    pictures.emplace_back(kSide_px, kSide_px, CV_8UC1,
                          const_cast<std::byte*>(stack.frames[i].bytes().data()));
  }
  const auto opencv = cv::structured_light::GrayCodePattern::create(kWidth_px, kHeight_px);
  double opencv_s = 1e9, decode_s = 1e9;
  std::size_t wrong = 0;
  for (auto _ : state) {
    for (int round = 0; round < 5; ++round) {
      decode_s = std::min(decode_s, seconds([&] { benchmark::DoNotOptimize(decode(stack)); }));
    }
    opencv_s = std::min(opencv_s, seconds([&] {
                          cv::Point position;
                          for (int y = 0; y < kSide_px; ++y) {
                            for (int x = 0; x < kSide_px; ++x) {
                              wrong += opencv->getProjPixel(pictures, x, y, position) ? 1U : 0U;
                            }
                          }
                        }));
  }
  benchmark::DoNotOptimize(wrong);
  state.counters["opencv_ms"] = 1e3 * opencv_s;
  state.counters["decode_ms"] = 1e3 * decode_s;
  state.counters["opencv_per_decode"] = opencv_s / decode_s;
}

BENCHMARK(decode_mono8)->Iterations(15)->Unit(benchmark::kMillisecond);
BENCHMARK(decode_mono16)->Iterations(15)->Unit(benchmark::kMillisecond);
BENCHMARK(decode_opencv)->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace alhazen
