#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "alhazen/caught.h"
#include "alhazen/driver.h"
#include "drivers/sim/claim.h"
#include "drivers/sim/sim_camera.h"
#include "drivers/sim/sim_display.h"
#include "drivers/sim/sim_turntable.h"

namespace alhazen::sim {
namespace {

/// Owns one world and opens its devices.
class SimDriver final : public Driver {
 public:
  SimDriver(const Host& host, std::shared_ptr<World> world)
      : host_(host), world_(std::move(world)) {}

  Result<std::vector<Found>> find() noexcept override {
    std::vector<Found> out;
    for (const CameraTruth& camera : world_->scene().cameras)
      out.push_back({"camera", "simulated camera", camera.id});
    for (const DisplayTruth& display : world_->scene().displays)
      out.push_back({"display", "simulated display", display.id});
    out.push_back({"turntable", "simulated turntable", "turntable"});
    return out;
  }

  Result<std::unique_ptr<Camera>> open_camera(const Settings& settings) noexcept override {
    const std::size_t index = ALHAZEN_TRY(place(settings, world_->scene().cameras, "camera"));
    auto claim = ALHAZEN_TRY(DeviceClaim::make(world_, host_, world_->scene().cameras[index].id));
    return std::unique_ptr<Camera>(std::make_unique<SimCamera>(std::move(claim), index));
  }
  Result<std::unique_ptr<Display>> open_display(const Settings& settings) noexcept override {
    const std::size_t index = ALHAZEN_TRY(place(settings, world_->scene().displays, "display"));
    auto claim = ALHAZEN_TRY(DeviceClaim::make(world_, host_, world_->scene().displays[index].id));
    return std::unique_ptr<Display>(std::make_unique<SimDisplay>(std::move(claim), index));
  }
  Result<std::unique_ptr<Turntable>> open_turntable(const Settings&) noexcept override {
    auto claim = ALHAZEN_TRY(DeviceClaim::make(world_, host_, "turntable"));
    return std::unique_ptr<Turntable>(std::make_unique<SimTurntable>(std::move(claim)));
  }

 private:
  /// Where the device with the configured id stands among `all`.
  template <class Truth>
  static Result<std::size_t> place(const Settings& settings, const std::vector<Truth>& all,
                                   const std::string& kind) {
    const std::string id = ALHAZEN_TRY(settings.text("id"));
    std::string known;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (all[i].id == id) return i;
      known += (i > 0 ? ", " : "") + all[i].id;
    }
    return Error{Code::invalid,
                 "the world has no " + kind + " with id \"" + id + "\"; it has " + known};
  }

  Host host_;
  std::shared_ptr<World> world_;
};

/// Keys: world (path of the world file); object_mesh, object_size_mm, object_up and seed replace
/// what the file says.
Result<std::unique_ptr<Driver>> open_checked(const Host& host, const Settings& settings) {
  const std::string file = ALHAZEN_TRY(settings.path("world"));
  SceneOverrides overrides;
  std::optional<std::string> mesh;
  if (settings.has("object_mesh")) mesh = ALHAZEN_TRY(settings.path("object_mesh"));
  if (mesh) overrides.object_mesh = *mesh;
  if (settings.has("object_size_mm"))
    overrides.object_size_mm =
        ALHAZEN_TRY(settings.number("object_size_mm", kSmallestSizeMm, kLargestSizeMm));
  if (settings.has("object_up")) overrides.object_up = ALHAZEN_TRY(settings.text("object_up"));
  if (settings.has("seed"))
    overrides.seed =
        static_cast<std::uint64_t>(ALHAZEN_TRY(settings.integer("seed", 0, INT64_MAX)));
  std::error_code trouble;
  for (const auto& [key, path] :
       {std::pair("world", std::optional<std::string>(file)), std::pair("object_mesh", mesh)})
    if (path && !std::filesystem::is_regular_file(*path, trouble))
      return Error{Code::invalid, "key '" + std::string(key) + "' names " + *path +
                                      ", which does not exist; it must be a file"};
  Scene scene = ALHAZEN_TRY(Scene::load(file, overrides));
  std::shared_ptr<World> world = ALHAZEN_TRY(World::make(std::move(scene)));
  host.log.write(Severity::info, "simulated world " + file + ": " +
                                     std::to_string(world->scene().cameras.size()) + " cameras, " +
                                     std::to_string(world->scene().displays.size()) + " displays");
  return std::unique_ptr<Driver>(std::make_unique<SimDriver>(host, std::move(world)));
}

Result<std::unique_ptr<Driver>> open(const Host& host, const Settings& settings) noexcept {
  return caught(Code::internal, "simulated rig", [&] { return open_checked(host, settings); });
}

}  // namespace
}  // namespace alhazen::sim

ALHAZEN_DRIVER("sim", "a simulated rig: one world of cameras, displays, a turntable and an object",
               true, alhazen::sim::open);
