// The processor's own rates: compiled once for every instruction set, chosen at run time.
#include "tests/experiment/machine_rate.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/experiment/machine_rate.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace alhazen::experiment {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using DI = hn::RebindToSigned<D>;

/// `rounds` times twelve independent multiply-adds; returns how many operations that were. Twelve
/// hide the latency of any processor's units.
double multiply_add(std::size_t rounds, float* sink) {
  const D d;
  constexpr int kChains = 12;
  const auto factor = hn::Set(d, 0.999F), term = hn::Set(d, 0.001F);
  auto a0 = hn::Set(d, 1), a1 = a0, a2 = a0, a3 = a0, a4 = a0, a5 = a0;
  auto b0 = a0, b1 = a0, b2 = a0, b3 = a0, b4 = a0, b5 = a0;
  for (std::size_t i = 0; i < rounds; ++i) {
    a0 = hn::MulAdd(a0, factor, term);
    a1 = hn::MulAdd(a1, factor, term);
    a2 = hn::MulAdd(a2, factor, term);
    a3 = hn::MulAdd(a3, factor, term);
    a4 = hn::MulAdd(a4, factor, term);
    a5 = hn::MulAdd(a5, factor, term);
    b0 = hn::MulAdd(b0, factor, term);
    b1 = hn::MulAdd(b1, factor, term);
    b2 = hn::MulAdd(b2, factor, term);
    b3 = hn::MulAdd(b3, factor, term);
    b4 = hn::MulAdd(b4, factor, term);
    b5 = hn::MulAdd(b5, factor, term);
  }
  const auto a = hn::Add(hn::Add(hn::Add(a0, a1), hn::Add(a2, a3)), hn::Add(a4, a5));
  const auto b = hn::Add(hn::Add(hn::Add(b0, b1), hn::Add(b2, b3)), hn::Add(b4, b5));
  *sink += hn::GetLane(hn::Add(a, b));
  return 2.0 * kChains * static_cast<double>(rounds) * static_cast<double>(hn::Lanes(d));
}

/// Reads the table through `index` once; returns how many elements that were.
double gather(const std::vector<float>& table, const std::vector<std::int32_t>& index,
              float* sink) {
  const D d;
  const DI di;
  auto sum0 = hn::Zero(d), sum1 = sum0, sum2 = sum0, sum3 = sum0;
  const std::size_t n = hn::Lanes(d);
  std::size_t i = 0;
  for (; i + 4 * n <= index.size(); i += 4 * n) {
    const std::int32_t* at = index.data() + i;
    sum0 = hn::Add(sum0, hn::GatherIndex(d, table.data(), hn::LoadU(di, at)));
    sum1 = hn::Add(sum1, hn::GatherIndex(d, table.data(), hn::LoadU(di, at + n)));
    sum2 = hn::Add(sum2, hn::GatherIndex(d, table.data(), hn::LoadU(di, at + 2 * n)));
    sum3 = hn::Add(sum3, hn::GatherIndex(d, table.data(), hn::LoadU(di, at + 3 * n)));
  }
  *sink += hn::GetLane(hn::Add(hn::Add(sum0, sum1), hn::Add(sum2, sum3)));
  return static_cast<double>(i);
}

}  // namespace HWY_NAMESPACE
}  // namespace alhazen::experiment
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace alhazen::experiment {

HWY_EXPORT(multiply_add);
HWY_EXPORT(gather);

namespace {

double cpu_s() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// The best of several runs: what disturbs a loop only makes it slower.
template <class Loop>
double best_rate(const Loop& loop) {
  double best = 0;
  for (int run = 0; run < 9; ++run) {
    const double begin = cpu_s();
    const double done = loop();
    best = std::max(best, done / (cpu_s() - begin));
  }
  return best;
}

}  // namespace

MachineRate machine_rate() {
  // As votes read a light map: rows of neighbouring pixels, a step aside at each.
  constexpr std::size_t kTable = 1U << 16, kReads = 1U << 22;
  const std::vector<float> table(kTable, 1.0F);
  std::vector<std::int32_t> index(kReads);
  for (std::size_t i = 0; i < kReads; ++i) {
    index[i] = static_cast<std::int32_t>((i * 3 + i / 64 * 1021) % kTable);
  }
  volatile float kept = 0;
  float sink = 0;
  MachineRate rate;
  rate.flops_per_s =
      best_rate([&] { return HWY_DYNAMIC_DISPATCH(multiply_add)(std::size_t{1} << 22, &sink); });
  rate.gathers_per_s = best_rate([&] { return HWY_DYNAMIC_DISPATCH(gather)(table, index, &sink); });
  kept = sink;
  static_cast<void>(kept);
  return rate;
}

}  // namespace alhazen::experiment
#endif  // HWY_ONCE
