// Frame hand-over: what the sequencer, the queue and the writer cost, devices and decoding apart.
// Fake devices answer at once and hand out one picture made before; so what is left is guards,
// checksums, freshness, the queue, and (in the second benchmark) decoding and committing.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <cstdlib>
#include <filesystem>
#include <set>

#include "daemon/capture/capture.h"
#include "daemon/capture/sequencer.h"
#include "daemon/virtual_clock.h"
#include "tests/support/fake_devices.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

class Silent final : public Log {
 public:
  void write(Severity, std::string_view) noexcept override {}
};

/// CPU time of all threads.
double cpu_us() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto us = [](const timeval& t) {
    return 1e6 * static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_usec);
  };
  return us(usage.ru_utime) + us(usage.ru_stime);
}

template <class T>
T must(Result<T> result) {
  if (result) return std::move(*result);
  std::fprintf(stderr, "%s\n", result.error().text().c_str());
  std::exit(1);
}

/// A rig of 11 cameras as in the thesis and one display, frames of side × side px.
struct Bench {
  explicit Bench(int side) : fake(clock, options(side)), loader("") {
    if (!loader.adopt(FakeRig::entry())) std::exit(1);
    devices = must(DeviceSet::open(fake.specs(), loader, Host{clock, log}));
    ScanRequest request;
    request.object_id = "bench";
    request.choices.stops = 1;
    request.choices.crop = false;
    plan = must(make_plan(request, {}, fake.rig(), fake.facts(),
                          {"bench", "2026-11-22T00:00:00Z", "bench"}));
  }
  static FakeOptions options(int side) {
    FakeOptions options;
    options.cameras = 11;
    options.displays = 1;
    options.width_px = options.height_px = side;
    options.speed_rad_s = 0;
    options.pixels = false;
    return options;
  }
  VirtualClock clock;
  Silent log;
  FakeRig fake;
  Loader loader;
  std::unique_ptr<DeviceSet> devices;
  Manifest plan;
};

/// Sequencer and queue: frames are dropped on the other side.
void hand_over(benchmark::State& state) {
  Bench bench(static_cast<int>(state.range(0)));
  const CaptureHooks hooks;
  std::uint64_t frames = 0, captures = 0;
  const double before = cpu_us();
  for (auto _ : state) {
    BoundedQueue<WriterItem> queue(3);
    std::jthread reader([&] {
      while (queue.pop({})) {
      }
    });
    Hold hold;
    Sequencer sequencer(bench.plan, *bench.devices, bench.clock, OnGap::fail, hold, hooks,
                        [&](WriterItem item) { return queue.push(std::move(item), {}); }, {});
    if (!sequencer.run({})) std::exit(1);
    queue.close();
    frames += sequencer.done().frames;
    captures += sequencer.done().steps;
  }
  const double spent = cpu_us() - before;
  state.counters["cpu_us_per_frame"] = spent / static_cast<double>(frames);
  state.counters["cpu_us_per_capture"] = spent / static_cast<double>(captures);
}
BENCHMARK(hand_over)->Arg(64)->Arg(2048)->Unit(benchmark::kMillisecond)->UseRealTime();

/// The whole capture: decoded and committed.
void whole_capture(benchmark::State& state) {
  Bench bench(static_cast<int>(state.range(0)));
  const fs::path folder = fs::temp_directory_path() / "alhazen_capture_bench";
  std::uint64_t frames = 0;
  const double before = cpu_us();
  for (auto _ : state) {
    fs::remove_all(folder);
    Scan scan = must(Scan::create(folder, bench.plan, bench.fake.rig()));
    Hold hold;
    frames += must(capture_scan(scan, *bench.devices, bench.clock, {}, hold, {}, {})).frames;
  }
  fs::remove_all(folder);
  state.counters["cpu_us_per_frame"] = (cpu_us() - before) / static_cast<double>(frames);
}
BENCHMARK(whole_capture)
    ->Arg(64)
    ->Arg(1024)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime()
    ->Iterations(1);

}  // namespace
}  // namespace alhazen
