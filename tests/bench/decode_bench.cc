// Decoding a stack against reading it once, and against OpenCV on the same frames. Everything runs
// on one thread; decoders are fed as the daemon feeds them, frame by frame and camera after camera.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cstdint>
#include <ctime>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/structured_light.hpp>
#include <random>
#include <span>
#include <vector>

#include "reconstruct/decode/decoder.h"
#include "reconstruct/decode/kernels.h"
#include "reconstruct/pattern/gray_code.h"
#include "reconstruct/pattern/sequence.h"

namespace alhazen {
namespace {

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

/// The display seen whole and slightly turned, with noise of about a digital number, by a camera of
/// side_px² pixels.
template <class Dn>
Stack make_stack(int side_px, int bits) {
  Stack stack;
  const int share = 12 * side_px / 2048;
  const int scale = 1 << (bits - 8);
  std::minstd_rand random(1);
  std::vector<std::uint8_t> noise(1 << 16);
  for (std::uint8_t& value : noise) value = static_cast<std::uint8_t>((random() >> 8) % 4);
  const auto side = static_cast<std::size_t>(side_px);
  std::vector<Dn> pixels(side * side);
  for (const Pattern& pattern : stack.sequence) {
    const std::size_t shift = random() % noise.size();
    for (int y = 0; y < side_px; ++y) {
      for (int x = 0; x < side_px; ++x) {
        const int u = std::clamp((5 * x + y) / share, 0, kWidth_px - 1);
        const int v = std::clamp((5 * y - x) / share + 100, 0, kHeight_px - 1);
        const std::uint32_t gray =
            gray_from_binary(static_cast<std::uint32_t>(pattern.axis == Axis::u ? u : v));
        const bool one = pattern.kind == PatternKind::gray
                             ? (((gray >> pattern.bit) & 1U) != 0) != pattern.inverted
                             : pattern.kind == PatternKind::white;
        const auto i = static_cast<std::size_t>(y) * side + static_cast<std::size_t>(x);
        pixels[i] = static_cast<Dn>(((one ? 180 : 20) + noise[(i + shift) % noise.size()]) * scale);
      }
    }
    stack.frames.push_back(Image::copy<Dn>(side_px, side_px, bits, pixels));
  }
  return stack;
}

/// Every byte of every frame, once: as fast as memory gives them.
std::uint64_t read_once(std::span<const Stack> cameras) {
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < cameras[0].frames.size(); ++i) {
    for (const Stack& stack : cameras) {
      const std::span<const std::byte> bytes = stack.frames[i].bytes();
      const auto* words = reinterpret_cast<const std::uint64_t*>(bytes.data());
      const std::size_t count = bytes.size() / sizeof(std::uint64_t);
      std::uint64_t part = 0;
      for (std::size_t k = 0; k < count; ++k) part += words[k];  // the compiler makes vectors of it
      sum += part;
    }
  }
  return sum;
}

/// As the daemon does it: pattern after pattern, all cameras in turn, then all light maps.
std::vector<LightMap> decode(std::span<const Stack> cameras) {
  std::vector<Decoder> decoders;
  for (const Stack& stack : cameras) {
    const Image& frame = stack.frames[0];
    decoders.push_back(*Decoder::make({}, {0, "display", "camera"}, 0,
                                      {0, 0, frame.width(), frame.height()}, frame.bits(),
                                      kWidth_px, kHeight_px, stack.sequence));
  }
  for (std::size_t i = 0; i < cameras[0].frames.size(); ++i) {
    for (std::size_t k = 0; k < cameras.size(); ++k) {
      *decoders[k].add(cameras[k].sequence[i], cameras[k].frames[i]);
    }
  }
  std::vector<LightMap> maps;
  maps.reserve(decoders.size());
  for (Decoder& decoder : decoders) maps.push_back(*std::move(decoder).finish());
  return maps;
}

/// Rounds of reading and decoding in turn, the best of each: other work on the machine disturbs
/// both alike. Arguments: the cameras' side in px, how many cameras.
template <class Dn>
void decode_against_reading(benchmark::State& state, int bits) {
  std::vector<Stack> cameras;
  cameras.push_back(make_stack<Dn>(static_cast<int>(state.range(0)), bits));
  double bytes = 0;
  for (const Image& frame : cameras[0].frames) bytes += static_cast<double>(frame.bytes().size());
  while (std::ssize(cameras) < state.range(1)) {
    Stack& other = cameras.emplace_back();
    for (const Image& frame : cameras[0].frames) {
      const std::span<const Dn> pixels(reinterpret_cast<const Dn*>(frame.bytes().data()),
                                       frame.size_px());
      other.frames.push_back(Image::copy<Dn>(frame.width(), frame.height(), bits, pixels));
    }
  }
  bytes *= static_cast<double>(cameras.size());
  double read_s = 1e9, decode_s = 1e9;
  for (auto _ : state) {
    read_s = std::min(read_s, seconds([&] { benchmark::DoNotOptimize(read_once(cameras)); }));
    decode_s = std::min(decode_s, seconds([&] { benchmark::DoNotOptimize(decode(cameras)); }));
  }
  state.counters["read_ms"] = 1e3 * read_s;
  state.counters["decode_ms"] = 1e3 * decode_s;
  state.counters["read_GB_s"] = 1e-9 * bytes / read_s;
  state.counters["decode_GB_s"] = 1e-9 * bytes / decode_s;
  state.counters["decode_per_read"] = decode_s / read_s;
}

void decode_mono8(benchmark::State& state) { decode_against_reading<std::uint8_t>(state, 8); }
void decode_mono16(benchmark::State& state) { decode_against_reading<std::uint16_t>(state, 12); }

/// GrayCodePattern::getProjPixel() at every pixel, one thread, against the same decode().
void decode_opencv(benchmark::State& state) {
  constexpr int kSide_px = 2048;
  const Stack stack = make_stack<std::uint8_t>(kSide_px, 8);
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
      decode_s = std::min(decode_s, seconds([&] {
                            benchmark::DoNotOptimize(decode({&stack, 1}));
                          }));
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

/// 44 frames each of 1024², 2048² and 4096² pixels, and of four cameras that are captured together.
void sizes(benchmark::internal::Benchmark* bench) {
  bench->ArgNames({"side_px", "cameras"})->Unit(benchmark::kMillisecond);
  bench->Args({1024, 1})->Args({2048, 1})->Args({4096, 1})->Args({2048, 4});
  bench->Iterations(40);
}
BENCHMARK(decode_mono8)->Apply(sizes);
BENCHMARK(decode_mono16)->Apply(sizes);
BENCHMARK(decode_opencv)->Iterations(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace alhazen
