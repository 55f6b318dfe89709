// Whatever the bytes of a camera file of OpenCV's kind: an error, or a camera of finite numbers.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "reconstruct/exchange/camera_files.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  for (const char* suffix : {"", "1"}) {
    const auto camera = alhazen::parse_opencv_camera(text, suffix, 1000);
    if (!camera) continue;
    ALHAZEN_CHECK(camera->model.fx_px > 0 && camera->model.fy_px > 0);
    ALHAZEN_CHECK(std::isfinite(camera->model.cx_px) && std::isfinite(camera->model.cy_px));
    for (const double k : camera->model.distortion) ALHAZEN_CHECK(std::isfinite(k));
    ALHAZEN_CHECK(!camera->has_size || camera->model.width_px >= 1);
  }
  return 0;
}
