// Whatever the bytes of a COLMAP model, cameras and images parted by a zero: an error, or cameras
// that survive being written and read again.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "reconstruct/exchange/camera_files.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const std::size_t middle = std::min(text.find('\0'), size);
  const auto cameras =
      alhazen::parse_colmap(text.substr(0, middle), text.substr(std::min(middle + 1, size)), 1);
  if (!cameras) return 0;
  std::vector<alhazen::ColmapImage> images;
  for (const alhazen::ForeignCamera& camera : *cameras)
    images.push_back({camera.model.name + ".png", camera.model, camera.model.camera_from_rig});
  const alhazen::ColmapModel model = alhazen::to_colmap(images);
  const auto again = alhazen::parse_colmap(model.cameras_txt, model.images_txt, 1);
  ALHAZEN_CHECK(again && again->size() == cameras->size());
  return 0;
}
