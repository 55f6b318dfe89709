// How fast the simulated rig renders: rays per second of tracing, frames per second of evaluating
// patterns from kept light transport. ALHAZEN_DATA names the folder of meshes; without the bunny
// the mesh rows use the block with pits.

#include <benchmark/benchmark.h>
#include <algorithm>

#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "drivers/sim/world.h"

namespace alhazen::sim {
namespace {

std::shared_ptr<World> open_world(const std::string& name) {
  const std::filesystem::path source = ALHAZEN_SOURCE_DIR;
  SceneOverrides overrides;
  std::string file = name;
  if (name == "bunny") {
    const char* data = std::getenv("ALHAZEN_DATA");
    const std::filesystem::path mesh =
        (data != nullptr ? std::filesystem::path(data) : source / "../shared/data") /
        "meshes/bunny00.off";
    if (std::filesystem::exists(mesh))
      overrides.object_mesh = mesh;
    else
      file = "pits";
  }
  auto scene = Scene::load(source / "config/worlds" / (file + ".toml"), overrides);
  ALHAZEN_CHECK(bool(scene));
  auto world = World::make(*std::move(scene));
  ALHAZEN_CHECK(bool(world));
  return *world;
}

const std::shared_ptr<World>& world_of(const std::string& name) {
  static std::map<std::string, std::shared_ptr<World>> worlds;
  std::shared_ptr<World>& world = worlds[name];
  if (!world) world = open_world(name);
  return world;
}

/// Around the object, as a scan would choose it.
Region object_region(const World& world, std::size_t camera) {
  const CameraTruth& truth = world.scene().cameras[camera];
  const int side = std::min({700, truth.width_px, truth.height_px});
  return {(truth.width_px - side) / 2, (truth.height_px - side) / 2, side, side};
}

Picture stripes(const DisplayTruth& display, int period_px, bool along_u) {
  std::vector<std::uint8_t> pixels;
  for (int y = 0; y < display.height_px; ++y)
    for (int x = 0; x < display.width_px; ++x)
      pixels.push_back(((along_u ? x : y) / period_px) % 2 == 0 ? 0 : 255);
  return {Image::copy<std::uint8_t>(display.width_px, display.height_px, 8, pixels), std::nullopt};
}

void trace(benchmark::State& state, const std::string& name) {
  const auto& world = world_of(name);
  const Renderer renderer(world->scene(), world->shape());
  const std::size_t cameras = world->scene().cameras.size();
  std::uint64_t rays = 0, pixels = 0, uneven = 0, bytes = 0;
  std::size_t turn = 0;
  for ([[maybe_unused]] auto _ : state) {
    const std::size_t camera = turn % cameras;
    const Region region = object_region(*world, camera);
    const Transport transport =
        renderer.trace(world->scene().cameras[camera],
                       world->rig_from_object(0.5 * static_cast<double>(turn)), region);
    rays += transport.ray_count;
    uneven += transport.uneven_count;
    bytes += transport.bytes();
    pixels += static_cast<std::uint64_t>(region.width) * static_cast<std::uint64_t>(region.height);
    ++turn;
  }
  state.counters["rays/s"] =
      benchmark::Counter(static_cast<double>(rays), benchmark::Counter::kIsRate);
  state.counters["rays/px"] = static_cast<double>(rays) / static_cast<double>(pixels);
  state.counters["uneven"] = static_cast<double>(uneven) / static_cast<double>(pixels);
  state.counters["bytes/px"] = static_cast<double>(bytes) / static_cast<double>(pixels);
}

/// A frame of a Gray pattern on one display, the others black, from kept transport.
void frame(benchmark::State& state, const std::string& name) {
  const auto& world = world_of(name);
  const Region region = object_region(*world, 2);
  Time now{Micros{0}};
  const std::size_t displays = world->scene().displays.size();
  for (std::size_t d = 0; d < displays; ++d)
    now = std::max(now, world->show(d, stripes(world->scene().displays[d], 1 << 14, true), now));
  now = world->show(0, stripes(world->scene().displays[0], 16, true), now);
  (void)world->expose({2, now, Micros(9000), 0, region});  // traces
  for (auto _ : state) benchmark::DoNotOptimize(world->expose({2, now, Micros(9000), 0, region}));
  state.counters["frames/s"] =
      benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  state.counters["ns/px"] = benchmark::Counter(
      1e-9 * static_cast<double>(region.width) * static_cast<double>(region.height) *
          static_cast<double>(state.iterations()),
      benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
}

/// Taking up a picture: what a display's show() costs once a pattern.
void show(benchmark::State& state) {
  const auto& world = world_of("sphere");
  const Picture picture = stripes(world->scene().displays[0], 16, true);
  Time now{Micros{0}};
  for (auto _ : state) now = world->show(0, picture, now);
}

BENCHMARK_CAPTURE(trace, sphere, "sphere")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(trace, torus, "torus")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(trace, mesh, "bunny")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(frame, sphere, "sphere")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(frame, mesh, "bunny")->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();
BENCHMARK(show)->Unit(benchmark::kMillisecond)->MeasureProcessCPUTime();

}  // namespace
}  // namespace alhazen::sim
