#include "reconstruct/report/slice.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>

#include "alhazen/check.h"

namespace alhazen {
namespace {

constexpr int kMaxSide = 1024;  // cells; a picture of a page is no larger

Error damaged(const std::string& what) { return Error{Code::corrupt, "slice: " + what}; }

}  // namespace

Slice middle_slice(const Reconstructed& reconstructed) {
  const Octree& octree = reconstructed.octree;
  for (const std::size_t size :
       {reconstructed.field.consistency.size(), reconstructed.divergence.size(),
        reconstructed.indicator.u.size()}) {
    ALHAZEN_CHECK(size == octree.size());
  }
  const int level = octree.finest_level();
  Slice slice;
  slice.width = slice.height = std::min(1 << level, kMaxSide);
  const auto cells = static_cast<std::size_t>(slice.width) * static_cast<std::size_t>(slice.height);
  slice.consistency.reserve(cells);
  slice.divergence_per_mm.reserve(cells);
  slice.inside.reserve(cells);
  const Volume& volume = octree.volume();
  const double cell_mm = volume.edge_mm / slice.width;
  for (int row = 0; row < slice.height; ++row) {
    for (int column = 0; column < slice.width; ++column) {
      // Half a finest leaf beside the middle, which is a boundary between leaves.
      const Eigen::Vector3d p =
          volume.centre_mm + Eigen::Vector3d((column + 0.5) * cell_mm - volume.edge_mm / 2,
                                             volume.edge_mm / (2 << level),
                                             volume.edge_mm / 2 - (row + 0.5) * cell_mm);
      const auto leaf = octree.find(p);
      ALHAZEN_CHECK(leaf.has_value());
      slice.consistency.push_back(reconstructed.field.consistency[*leaf]);
      slice.divergence_per_mm.push_back(reconstructed.divergence[*leaf]);
      slice.inside.push_back(reconstructed.indicator.u[*leaf]);
    }
  }
  return slice;
}

std::string to_pfm(const Slice& slice) {
  static_assert(std::endian::native == std::endian::little, "the file says little endian");
  std::string out =
      "PF\n" + std::to_string(slice.width) + " " + std::to_string(slice.height) + "\n-1.0\n";
  out.reserve(out.size() + slice.consistency.size() * 12);
  for (int row = slice.height - 1; row >= 0; --row) {  // the format begins at the bottom
    for (int column = 0; column < slice.width; ++column) {
      const auto cell = static_cast<std::size_t>(row) * static_cast<std::size_t>(slice.width) +
                        static_cast<std::size_t>(column);
      const float values[] = {slice.consistency[cell], slice.divergence_per_mm[cell],
                              slice.inside[cell]};
      char raw[sizeof(values)];
      std::memcpy(raw, values, sizeof(values));
      out.append(raw, sizeof(raw));
    }
  }
  return out;
}

Result<Slice> parse_slice(std::string_view pfm) {
  if (!pfm.starts_with("PF\n")) return damaged("does not begin with PF");
  pfm.remove_prefix(3);
  Slice slice;
  for (const char end : {' ', '\n'}) {
    int& side = end == ' ' ? slice.width : slice.height;
    const auto [rest, error] = std::from_chars(pfm.data(), pfm.data() + pfm.size(), side);
    if (error != std::errc{} || side < 1 || side > kMaxSide || rest == pfm.data() + pfm.size() ||
        *rest != end)
      return damaged("width and height must be 1 … " + std::to_string(kMaxSide));
    pfm.remove_prefix(static_cast<std::size_t>(rest - pfm.data()) + 1);
  }
  constexpr std::string_view kLittleEndian = "-1.0\n";
  if (!pfm.starts_with(kLittleEndian)) return damaged("the scale must be -1.0");
  pfm.remove_prefix(kLittleEndian.size());
  const auto width = static_cast<std::size_t>(slice.width);
  const auto height = static_cast<std::size_t>(slice.height);
  if (pfm.size() != width * height * 12)
    return damaged("has " + std::to_string(pfm.size()) + " bytes of values instead of " +
                   std::to_string(width * height * 12));
  slice.consistency.resize(width * height);
  slice.divergence_per_mm.resize(width * height);
  slice.inside.resize(width * height);
  for (std::size_t row = 0; row < height; ++row) {
    for (std::size_t column = 0; column < width; ++column) {
      float values[3];
      std::memcpy(values, pfm.data() + ((height - 1 - row) * width + column) * 12, sizeof(values));
      if (!std::isfinite(values[0]) || !std::isfinite(values[1]) || !std::isfinite(values[2]))
        return damaged("a value is not finite");
      const std::size_t cell = row * width + column;
      slice.consistency[cell] = values[0];
      slice.divergence_per_mm[cell] = values[1];
      slice.inside[cell] = values[2];
    }
  }
  return slice;
}

}  // namespace alhazen
