#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>

#include "reconstruct/geometry/rig.h"
#include "reconstruct/normals/normal_map_file.h"
#include "reconstruct/normals/normal_tables.h"
#include "reconstruct/scan/image_file.h"
#include "reconstruct/scan/safe_file.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {
namespace {

/// Linear intensities of a grey picture, 1 = full scale.
std::vector<float> linear(const Image& image, double gamma) {
  const double full = (1 << image.bits()) - 1;
  std::vector<float> values(image.size_px());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double share =
        (image.format() == PixelFormat::mono8 ? static_cast<double>(image.mono8()[i])
                                              : static_cast<double>(image.mono16()[i])) /
        full;
    values[i] = static_cast<float>(gamma == 1 ? share : std::pow(share, gamma));
  }
  return values;
}

/// Pictures of a table, and the size they all have.
struct Pictures {
  int width = 0, height = 0;
  std::vector<std::vector<float>> intensity;
};

Result<Pictures> load(const std::filesystem::path& table, const std::vector<LightEntry>& lights,
                      double gamma, const Run& run) {
  Pictures pictures;
  for (std::size_t k = 0; k < lights.size(); ++k) {
    if (run.stopped()) return Error{Code::cancelled, "interrupted"};
    run.tell("load pictures", static_cast<double>(k) / static_cast<double>(lights.size()));
    const std::string where =
        table.filename().string() + ", line " + std::to_string(lights[k].line);
    const Image image = ALHAZEN_TRY(read_image(table.parent_path() / lights[k].file).in(where));
    if (k == 0) {
      pictures.width = image.width();
      pictures.height = image.height();
    } else if (image.width() != pictures.width || image.height() != pictures.height) {
      return Error{Code::invalid,
                   "'" + lights[k].file.string() + "' has " + std::to_string(image.width()) +
                       " x " + std::to_string(image.height()) + " px, the first picture " +
                       std::to_string(pictures.width) + " x " + std::to_string(pictures.height),
                   where};
    }
    pictures.intensity.push_back(linear(image, gamma));
  }
  return pictures;
}

/// 1 where the picture is white; everywhere if there is none.
Result<std::vector<std::uint8_t>> load_mask(const std::filesystem::path& file,
                                            const Pictures& pictures) {
  std::vector<std::uint8_t> mask(
      static_cast<std::size_t>(pictures.width) * static_cast<std::size_t>(pictures.height), 1);
  if (file.empty()) return mask;
  const Image image = ALHAZEN_TRY(read_image(file));
  if (image.width() != pictures.width || image.height() != pictures.height) {
    return Error{Code::invalid,
                 "mask '" + file.string() + "' has " + std::to_string(image.width()) + " x " +
                     std::to_string(image.height()) + " px, the pictures " +
                     std::to_string(pictures.width) + " x " + std::to_string(pictures.height)};
  }
  const std::vector<float> share = linear(image, 1);
  for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = share[i] >= 0.5F ? 1 : 0;
  return mask;
}

Result<std::vector<LightEntry>> load_table(const std::filesystem::path& file) {
  return parse_lights(ALHAZEN_TRY(read_file(file, kMaxTableBytes))).in(file.filename().string());
}

float median_of(std::vector<float> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

Status stereo_normals(const StereoArgs& args, const Run& run) {
  const std::vector<LightEntry> table = ALHAZEN_TRY(load_table(args.lights));
  Pictures pictures = ALHAZEN_TRY(load(args.lights, table, args.gamma, run));
  LightStack stack;
  stack.width = pictures.width;
  stack.height = pictures.height;
  stack.intensity = std::move(pictures.intensity);
  stack.mask = ALHAZEN_TRY(load_mask(args.mask, pictures));
  for (const LightEntry& entry : table) stack.lights.push_back(entry.light);

  if (!args.mirror_ball.empty()) {
    const std::vector<LightEntry> ball_table = ALHAZEN_TRY(load_table(args.mirror_ball));
    if (ball_table.size() != table.size()) {
      return Error{Code::invalid, "the mirror ball has " + std::to_string(ball_table.size()) +
                                      " pictures, the object " + std::to_string(table.size())};
    }
    const Pictures ball = ALHAZEN_TRY(load(args.mirror_ball, ball_table, 1, run));
    const std::vector<std::uint8_t> mask = ALHAZEN_TRY(load_mask(args.mirror_ball_mask, ball));
    const std::vector<Light> lights =
        ALHAZEN_TRY(lights_of_mirror_ball(ball.width, ball.height, ball.intensity, mask));
    for (std::size_t k = 0; k < lights.size(); ++k) {
      stack.lights[k].vector = lights[k].vector;
      stack.lights[k].is_near = false;
    }
  }
  const bool has_near = std::any_of(stack.lights.begin(), stack.lights.end(),
                                    [](const Light& light) { return light.is_near; });
  if (has_near) {
    if (args.rig.empty() || !args.depth_mm || !(*args.depth_mm > 0)) {
      return Error{Code::invalid,
                   "a near light needs --rig, --camera and --depth-mm above 0: where it stands "
                   "from the surface"};
    }
    const Rig rig = ALHAZEN_TRY(Rig::load(args.rig));
    const CameraModel* camera = rig.camera(args.camera);
    if (camera == nullptr) {
      return Error{Code::invalid, "the rig has no camera '" + args.camera + "'"};
    }
    if (camera->width_px != stack.width || camera->height_px != stack.height) {
      return Error{Code::invalid,
                   "camera '" + args.camera + "' has " + std::to_string(camera->width_px) + " x " +
                       std::to_string(camera->height_px) + " px, the pictures " +
                       std::to_string(stack.width) + " x " + std::to_string(stack.height)};
    }
    for (int y = 0; y < stack.height; ++y) {
      for (int x = 0; x < stack.width; ++x) {
        const Eigen::Vector3d d = camera->direction(Eigen::Vector2d(x, y));
        stack.point_mm.emplace_back((d * (*args.depth_mm / d.z())).cast<float>());
      }
    }
  }
  const StereoMap found = ALHAZEN_TRY(photometric_stereo(stack, args.options, run));
  ALHAZEN_TRY(write_normal_map(found.map, args.out));

  std::vector<float> residual, lights_used;
  std::size_t unknown = 0;
  for (std::size_t i = 0; i < found.map.size_px(); ++i) {
    unknown += found.map.label[i] == NormalLabel::unknown ? 1U : 0U;
    if (found.map.label[i] != NormalLabel::object) continue;
    residual.push_back(found.residual[i]);
    lights_used.push_back(found.lights[i]);
  }
  nlohmann::ordered_json lights = nlohmann::ordered_json::array();
  for (const Light& light : stack.lights) {
    lights.push_back({{"x", light.vector.x()},
                      {"y", light.vector.y()},
                      {"z", light.vector.z()},
                      {"kind", light.is_near ? "near" : "far"},
                      {"intensity", light.intensity}});
  }
  const nlohmann::ordered_json line{{"file", args.out.string()},
                                    {"normals", residual.size()},
                                    {"unknown", unknown},
                                    {"median_residual", median_of(residual)},
                                    {"median_lights", median_of(lights_used)},
                                    {"noise_deg", found.map.noise_rad * 180 / std::numbers::pi},
                                    {"lights", std::move(lights)}};
  std::printf("%s\n", line.dump().c_str());
  return {};
}

}  // namespace alhazen
