// Whatever the bytes of a mesh file: an error or a mesh that can be used without looking, and no
// more memory than a small multiple of the bytes. The first byte chooses the format.
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "reconstruct/mesh_io/mesh_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  constexpr std::array<const char*, 4> kFormats{"ply", "obj", "off", "stl"};
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  const auto mesh = alhazen::parse_mesh(bytes, kFormats[data[0] % kFormats.size()]);
  if (!mesh) return 0;
  const std::size_t vertices = mesh->vertices_mm.size();
  ALHAZEN_CHECK(vertices * sizeof(mesh->vertices_mm[0]) +
                    mesh->triangles.size() * sizeof(mesh->triangles[0]) <=
                16 * size);
  for (const std::size_t list : {mesh->normals.size(), mesh->consistency.size(),
                                 mesh->observed.size(), mesh->depth_sigma_mm.size()})
    ALHAZEN_CHECK(list == 0 || list == vertices);
  for (const auto& p : mesh->vertices_mm) ALHAZEN_CHECK(p.allFinite());
  for (const auto& n : mesh->normals) ALHAZEN_CHECK(n.allFinite());
  for (const auto& triangle : mesh->triangles) {
    for (const std::uint32_t corner : triangle) ALHAZEN_CHECK(corner < vertices);
  }
  return 0;
}
