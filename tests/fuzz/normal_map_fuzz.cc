// Whatever the bytes of a normal map, PNG or OpenEXR: an error, or unit vectors of its size.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>

#include "reconstruct/normals/normal_map_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  alhazen::CameraModel camera;
  camera.name = "c0";
  camera.width_px = camera.height_px = 256;
  camera.fx_px = camera.fy_px = 1000;
  const auto map = alhazen::parse_normal_map({reinterpret_cast<const char*>(data), size}, {},
                                             camera, {0, "c0"}, 0);
  if (!map) return 0;
  ALHAZEN_CHECK(map->normal.size() == map->size_px() && map->label.size() == map->size_px());
  for (std::size_t i = 0; i < map->size_px(); ++i) {
    if (map->label[i] == alhazen::NormalLabel::object) {
      ALHAZEN_CHECK(std::abs(map->normal[i].norm() - 1) < 1e-3F);
    }
  }
  return 0;
}
