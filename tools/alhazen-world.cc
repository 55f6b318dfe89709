// alhazen-world: what is true about a simulated world. The daemon never sees it.

#include <CLI/CLI.hpp>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "daemon/base/exit_code.h"
#include "drivers/sim/calibrated_rig.h"
#include "drivers/sim/scene.h"
#include "drivers/sim/shape.h"
#include "drivers/sim/world.h"
#include "reconstruct/mesh_io/mesh_file.h"

namespace alhazen {
namespace {

constexpr double kRadFromDeg = std::numbers::pi / 180;

/// What every sub-command reads its world from.
struct WorldFlags {
  std::string file, mesh, up;
  double size_mm = 0;

  void add_to(CLI::App& app) {
    app.add_option("WORLD", file, "world file (config/worlds/*.toml)")->required();
    app.add_option("--object", mesh, "closed mesh that replaces the file's (PLY, OBJ, OFF, STL)");
    app.add_option("--size-mm", size_mm, "its longest edge")
        ->check(CLI::Range(sim::kSmallestSizeMm, sim::kLargestSizeMm));
    app.add_option("--up", up, "which of its axes points up: x, y, z, -x, -y or -z");
  }
  [[nodiscard]] sim::SceneOverrides overrides() const {
    sim::SceneOverrides out;
    if (!mesh.empty()) out.object_mesh = mesh;
    if (size_mm > 0) out.object_size_mm = size_mm;
    if (!up.empty()) out.object_up = up;
    return out;
  }
};

Status write_truth(const WorldFlags& world, const std::string& out) {
  const sim::Scene scene = ALHAZEN_TRY(sim::Scene::load(world.file, world.overrides()));
  const sim::Shape shape = ALHAZEN_TRY(sim::Shape::make(scene.object));
  return write_mesh(shape.truth(), out);
}

Status write_rig(const WorldFlags& world, const sim::CalibrationError& error,
                 const std::string& out) {
  // CLI11 takes "nan" for a number that is not negative.
  if (!std::isfinite(error.camera_px + error.display_mm + error.display_rad + error.axis_mm))
    return Error{Code::invalid, "every error of the calibration must be a finite number"};
  const sim::Scene scene = ALHAZEN_TRY(sim::Scene::load(world.file, world.overrides()));
  std::ofstream file(out, std::ios::binary);
  if (!(file << sim::calibrated_rig(scene, error)) || !file.flush())
    return Error{Code::unavailable, out + ": cannot be written"};
  return {};
}

/// A picture of the world as a camera sees it, each display showing a checkerboard of its own grey.
Status write_picture(const WorldFlags& world_flags, const std::string& camera, double angle_deg,
                     const std::string& out) {
  if (!std::isfinite(angle_deg))
    return Error{Code::invalid, "--angle must be a finite number of degrees"};
  sim::Scene scene = ALHAZEN_TRY(sim::Scene::load(world_flags.file, world_flags.overrides()));
  const auto& cameras = scene.cameras;
  const auto found =
      std::find_if(cameras.begin(), cameras.end(), [&](const auto& c) { return c.id == camera; });
  if (found == cameras.end())
    return Error{Code::invalid, "the world has no camera \"" + camera + "\"; it has c0 … c" +
                                    std::to_string(cameras.size() - 1)};
  const auto index = static_cast<std::size_t>(found - cameras.begin());
  const Region all{0, 0, found->width_px, found->height_px};
  std::vector<std::shared_ptr<const sim::Emission>> shown;
  for (const sim::DisplayTruth& display : scene.displays) {
    constexpr int kSquares = 16;  // across
    const int side = std::max(1, display.width_px / kSquares);
    std::vector<std::uint8_t> pixels;
    for (int y = 0; y < display.height_px; ++y)
      for (int x = 0; x < display.width_px; ++x)
        pixels.push_back((x / side + y / side) % 2 == 0
                             ? 255
                             : static_cast<std::uint8_t>(60 + 50 * (shown.size() % 4)));
    shown.push_back(std::make_shared<const sim::Emission>(
        Image::copy<std::uint8_t>(display.width_px, display.height_px, 8, pixels), display));
  }
  const auto world = ALHAZEN_TRY(sim::World::make(std::move(scene)));
  const std::vector<float> radiance = world->radiance(index, angle_deg * kRadFromDeg, all, shown);
  cv::Mat picture(all.height, all.width, CV_8U);
  for (int y = 0; y < all.height; ++y)
    for (int x = 0; x < all.width; ++x) {
      const double light =
          radiance[static_cast<std::size_t>(y) * static_cast<std::size_t>(all.width) +
                   static_cast<std::size_t>(x)];
      picture.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(
          std::lround(255 * std::pow(std::clamp(light, 0.0, 1.0), 1 / 2.2)));
    }
  if (!cv::imwrite(out, picture)) return Error{Code::unavailable, out + ": cannot be written"};
  return {};
}

int finish(const Status& status) {
  if (status) return 0;
  std::fprintf(stderr, "alhazen-world: %s\n", status.error().text().c_str());
  return exit_code(status.error().code);
}

}  // namespace
}  // namespace alhazen

int main(int argc, char** argv) {
  using namespace alhazen;
  CLI::App app{"What is true about a simulated world: its surface, its rig, its pictures."};
  app.require_subcommand(1);
  WorldFlags world;
  std::string out;

  CLI::App* truth =
      app.add_subcommand("truth", "write the true surface as a mesh (object frame, mm)");
  world.add_to(*truth);
  truth->add_option("--out", out, "mesh file to write (.ply, .obj, .stl)")->required();

  sim::CalibrationError error;
  double display_deg = 0;
  CLI::App* rig =
      app.add_subcommand("rig", "write the calibrated rig.json, exact or with a stated error");
  world.add_to(*rig);
  rig->add_option("--out", out, "file to write")->required();
  const auto any = CLI::NonNegativeNumber;
  rig->add_option("--camera-px", error.camera_px,
                  "standard deviation of the cameras' rotations, in pixels")
      ->check(any);
  rig->add_option("--display-mm", error.display_mm, "of the displays' places, each coordinate")
      ->check(any);
  rig->add_option("--display-deg", display_deg, "of the displays' rotations, each axis")
      ->check(any);
  rig->add_option("--axis-mm", error.axis_mm, "of the place of the turntable's axis")->check(any);
  rig->add_option("--seed", error.seed, "of the error");

  std::string camera;
  double angle_deg = 0;
  CLI::App* picture =
      app.add_subcommand("picture", "write what a camera sees, displays showing checkerboards");
  world.add_to(*picture);
  picture->add_option("--camera", camera, "its id: c0, c1, …")->required();
  picture->add_option("--angle", angle_deg, "of the turntable, degrees");
  picture->add_option("--out", out, "picture file to write (.png)")->required();

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& wrong) {
    return app.exit(wrong) == 0 ? 0 : exit_code(Code::invalid);
  }
  if (*truth) return finish(write_truth(world, out));
  error.display_rad = display_deg * kRadFromDeg;
  if (*rig) return finish(write_rig(world, error, out));
  return finish(write_picture(world, camera, angle_deg, out));
}
