#include "tests/experiment/simulated_scan.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <system_error>
#include <utility>

#include "daemon/plan/plan.h"
#include "drivers/sim/calibrated_rig.h"
#include "drivers/sim/world.h"
#include "reconstruct/decode/decoder.h"
#include "reconstruct/pattern/draw.h"

namespace alhazen::experiment {
namespace {

DeviceFacts facts_of(const sim::Scene& scene) {
  DeviceFacts facts;
  const sim::SensorTruth& sensor = scene.sensor;
  for (const sim::CameraTruth& camera : scene.cameras) {
    const CameraInfo info{"simulated camera",  camera.id,   camera.width_px,
                          camera.height_px,    sensor.bits, sensor.exposure_min,
                          sensor.exposure_max, 0,           sensor.gain_max_db,
                          sensor.readout};
    facts.cameras.push_back({camera.id, info, {}});
  }
  for (const sim::DisplayTruth& display : scene.displays) {
    facts.displays.push_back({display.id,
                              {.model = "simulated display",
                               .serial = display.id,
                               .width_px = display.width_px,
                               .height_px = display.height_px,
                               .refresh_hz = display.refresh_hz}});
  }
  facts.turntable.emplace();
  facts.turntable->model = "simulated table";
  return facts;
}

/// Names what goes into a scan, so that a changed recipe, world or coding is another directory.
std::string name_of(const ScanRecipe& recipe, const Manifest& plan) {
  const std::string mesh = recipe.overrides.object_mesh.value_or("").stem();
  const std::size_t hash = std::hash<std::string>()(plan.to_json());
  std::string name =
      recipe.world + (mesh.empty() ? "" : "-" + mesh) + "-" +
      std::to_string(plan.stops.size() * plan.displays.size() * plan.cameras.size()) +
      (recipe.coding == Coding::gray ? "-gray-" : "-phase-");
  for (int shift = 0; shift < 32; shift += 4) name += "0123456789abcdef"[(hash >> shift) & 15U];
  return name;
}

Status take(sim::World& world, Scan& scan, const Run& run) {
  const Manifest& plan = scan.manifest();
  const sim::Scene& scene = world.scene();
  const auto camera_of = [&](const std::string& id) {
    const auto found = std::find_if(scene.cameras.begin(), scene.cameras.end(),
                                    [&](const auto& camera) { return camera.id == id; });
    return static_cast<std::size_t>(found - scene.cameras.begin());
  };
  const auto display_of = [&](const std::string& id) {
    const auto found = std::find_if(scene.displays.begin(), scene.displays.end(),
                                    [&](const auto& display) { return display.id == id; });
    return static_cast<std::size_t>(found - scene.displays.begin());
  };
  Time now{};
  for (const sim::DisplayTruth& display : scene.displays) {
    const Pattern black;
    now = std::max(now,
                   world.show(display_of(display.id),
                              ALHAZEN_TRY(draw(black, display.width_px, display.height_px)), now));
  }
  const double sets = static_cast<double>(plan.stops.size() * plan.displays.size());
  double done = 0;
  for (const Stop& stop : plan.stops) {
    now = world.turn(stop.wanted_rad, now);
    const double angle_rad = world.encoder_rad(now);
    for (const PlannedDisplay& display : plan.displays) {
      run.tell("simulate", done++ / sets);
      std::vector<Decoder> decoders;
      for (const PlannedCamera& camera : plan.cameras) {
        decoders.push_back(ALHAZEN_TRY(Decoder::make(
            {}, {stop.index, display.name, camera.name}, angle_rad, camera.settings.region,
            scene.sensor.bits, display.width_px, display.height_px, display.patterns)));
      }
      const std::size_t index = display_of(display.name);
      std::vector<Status> outcomes(plan.cameras.size());
      for (const Pattern& pattern : display.patterns) {
        if (run.stopped()) return Error{Code::cancelled, "the simulation was stopped"};
        now = world.show(
            index, ALHAZEN_TRY(draw(pattern, display.width_px, display.height_px, display.gamma)),
            now);
        for (const PlannedCamera& camera : plan.cameras)
          world.begin_exposure(camera_of(camera.name), now);
        tbb::parallel_for(std::size_t{0}, plan.cameras.size(), [&](std::size_t k) {
          const PlannedCamera& camera = plan.cameras[k];
          const Image image = world.expose({camera_of(camera.name), now, camera.settings.exposure,
                                            camera.settings.gain_db, camera.settings.region});
          if (outcomes[k]) outcomes[k] = decoders[k].add(pattern, image);
        });
        Micros longest{0};
        for (const PlannedCamera& camera : plan.cameras)
          longest = std::max(longest, camera.settings.exposure);
        now = now + longest;
      }
      for (const Status& outcome : outcomes) ALHAZEN_TRY(outcome);
      for (Decoder& decoder : decoders) {
        ALHAZEN_TRY(scan.commit(cropped(ALHAZEN_TRY(std::move(decoder).finish())), {}));
      }
      now =
          world.show(index, ALHAZEN_TRY(draw(Pattern{}, display.width_px, display.height_px)), now);
    }
  }
  run.tell("simulate", 1);
  return {};
}

}  // namespace

Result<Scan> simulated_scan(const std::filesystem::path& cache, const ScanRecipe& recipe,
                            const Run& run) {
  const std::filesystem::path file =
      std::filesystem::path(ALHAZEN_SOURCE_DIR) / "config/worlds" / (recipe.world + ".toml");
  sim::Scene scene = ALHAZEN_TRY(sim::Scene::load(file, recipe.overrides));
  const Rig rig = ALHAZEN_TRY(Rig::parse(sim::calibrated_rig(scene, {})));
  ScanRequest request;
  request.object_id = "object";
  request.choices.stops = recipe.stops;
  request.choices.coding = recipe.coding;
  request.choices.level = recipe.level;
  request.choices.edge_mm = recipe.edge_mm;
  const Manifest plan = ALHAZEN_TRY(
      make_plan(request, {}, rig, facts_of(scene), {"simulated", "2000-01-01T00:00:00Z", "0"}));
  const std::filesystem::path directory = cache / name_of(recipe, plan);
  std::error_code ignored;
  if (std::filesystem::exists(directory, ignored)) return Scan::open(directory);

  // Under another name until it is complete, so that what was interrupted is not taken for whole.
  const std::filesystem::path partial = directory.string() + ".part";
  std::filesystem::remove_all(partial, ignored);
  std::filesystem::create_directories(cache, ignored);
  {
    Scan scan = ALHAZEN_TRY(Scan::create(partial, plan, rig));
    const auto world = ALHAZEN_TRY(sim::World::make(std::move(scene)));
    ALHAZEN_TRY(take(*world, scan, run));
  }
  std::filesystem::rename(partial, directory, ignored);
  return Scan::open(directory);
}

void scatter_outliers(LightMap& map, double share, std::uint64_t seed, int width_px,
                      int height_px) {
  const std::string name =
      std::to_string(map.key.stop) + "/" + map.key.display + "/" + map.key.camera;
  std::seed_seq mix(name.begin(), name.end());
  std::vector<std::uint32_t> words(2);
  mix.generate(words.begin(), words.end());
  std::mt19937_64 random(seed ^ (std::uint64_t{words[0]} << 32 | words[1]));
  const auto uniform = [&] { return static_cast<double>(random() >> 11) * 0x1p-53; };
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    if (!map.is_position(i) || uniform() >= share) continue;
    map.u_px[i] = static_cast<float>(uniform() * (width_px - 1));
    map.v_px[i] = static_cast<float>(uniform() * (height_px - 1));
  }
}

}  // namespace alhazen::experiment
