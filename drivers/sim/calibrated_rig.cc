#include "drivers/sim/calibrated_rig.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

namespace alhazen::sim {
namespace {

using Json = nlohmann::ordered_json;

Json array(const Vec3& v) { return {v.x(), v.y(), v.z()}; }

/// Normal deviates, the same on every machine (std::normal_distribution is not).
class Deviates {
 public:
  explicit Deviates(std::uint64_t seed) : bits_(seed) {}
  double next() {
    const double radius = std::sqrt(-2 * std::log(1 - uniform()));  // Box and Muller 1958
    return radius * std::cos(2 * std::numbers::pi * uniform());
  }
  Vec3 vector(double deviation) {
    const double x = next(), y = next(), z = next();
    return deviation * Vec3(x, y, z);
  }
  Eigen::Matrix3d turn(double deviation_rad) {
    const Vec3 v = vector(deviation_rad);
    return v.norm() > 0 ? Eigen::AngleAxisd(v.norm(), v.normalized()).toRotationMatrix()
                        : Eigen::Matrix3d(Eigen::Matrix3d::Identity());
  }

 private:
  double uniform() { return static_cast<double>(bits_() >> 11) * 0x1p-53; }
  std::mt19937_64 bits_;
};

}  // namespace

std::string calibrated_rig(const Scene& scene, const CalibrationError& error) {
  Deviates deviates(error.seed);
  Json rig;
  rig["cameras"] = Json::array();
  for (const CameraTruth& camera : scene.cameras) {
    const Lens& lens = camera.lens;
    const Rigid off{deviates.turn(error.camera_px / lens.fx_px), Vec3::Zero()};
    const Rigid pose = off * camera.camera_from_rig;
    Json rows = Json::array();
    for (int i = 0; i < 3; ++i)
      rows.push_back({pose.turn(i, 0), pose.turn(i, 1), pose.turn(i, 2), pose.shift_mm[i]});
    rows.push_back({0.0, 0.0, 0.0, 1.0});
    rig["cameras"].push_back(
        {{"name", camera.id},
         {"width_px", camera.width_px},
         {"height_px", camera.height_px},
         {"K", {{lens.fx_px, 0.0, lens.cx_px}, {0.0, lens.fy_px, lens.cy_px}, {0.0, 0.0, 1.0}}},
         {"distortion", lens.k},
         {"camera_from_rig", rows}});
  }
  rig["displays"] = Json::array();
  for (const DisplayTruth& display : scene.displays) {
    const Vec3 to_middle =
        (display.width_px - 1) / 2.0 * display.u_mm + (display.height_px - 1) / 2.0 * display.v_mm;
    const Eigen::Matrix3d turn = deviates.turn(error.display_rad);
    const Vec3 middle = display.origin_mm + to_middle + deviates.vector(error.display_mm);
    rig["displays"].push_back({{"name", display.id},
                               {"width_px", display.width_px},
                               {"height_px", display.height_px},
                               {"origin_mm", array(middle - turn * to_middle)},
                               {"u_mm", array(turn * display.u_mm)},
                               {"v_mm", array(turn * display.v_mm)},
                               {"mount", display.fixed == Fixed::to_rig ? "rig" : "turntable"},
                               {"gamma", display.gamma}});
  }
  const Vec3 slip = deviates.vector(error.axis_mm);
  const Vec3 along = scene.table.direction;
  rig["turntable"] = {{"point_mm", array(scene.table.point_mm + slip - slip.dot(along) * along)},
                      {"direction", array(along)}};
  return rig.dump(2) + "\n";
}

}  // namespace alhazen::sim
