#include "reconstruct/report/pictures.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <system_error>

#include "reconstruct/report/colour.h"
#include "reconstruct/report/draw.h"
#include "reconstruct/report/number_text.h"
#include "reconstruct/scan/light_map_file.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

constexpr int kView_px = 480;      // half of it on a page, which shows some 180 on a side
constexpr int kSlice_px = 520;     // at least
constexpr int kLightMap_px = 520;  // at most

std::array<std::uint8_t, 4> opaque(const Colour& c) {
  const auto byte = [](float v) { return static_cast<std::uint8_t>(std::lround(v * 255)); };
  return {byte(c.r), byte(c.g), byte(c.b), 255};
}

Status add_views(Pictures& to, const Report& report, const Mesh& mesh,
                 std::span<const Colouring> colourings) {
  if (mesh.vertices_mm.empty()) return {};
  for (const ViewDirection& view : six_views()) {
    const DrawnView drawn(mesh, view, (report.mesh.low_mm + report.mesh.high_mm) / 2,
                          views_extent_mm(report), kView_px);
    for (const Colouring& colouring : colourings) {
      const Picture8 picture = drawn.coloured(
          [&colouring](std::uint32_t vertex) { return colouring.of(vertex); }, colouring.relief);
      to[view_name(colouring.file, view.name)] = {ALHAZEN_TRY(to_png(picture)),
                                                  ALHAZEN_TRY(to_png(halved(picture)))};
    }
  }
  return {};
}

/// One cell a square of `scale` pixels; where the inside begins, a line.
Picture8 slice_picture(const Slice& slice, const Colour& line_colour,
                       const std::function<Colour(std::size_t cell)>& colour) {
  const int scale = std::max(1, (kSlice_px + slice.width - 1) / slice.width);
  Picture8 picture{slice.width * scale, slice.height * scale, {}};
  picture.pixels.reserve(static_cast<std::size_t>(picture.width) *
                         static_cast<std::size_t>(picture.height));
  const auto cell_at = [&](int row, int column) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(slice.width) +
           static_cast<std::size_t>(column);
  };
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      const int row = y / scale, column = x / scale;
      const std::size_t cell = cell_at(row, column);
      const bool is_inside = slice.inside[cell] >= 0.5F;
      const bool is_edge = (x % scale == 0 && column > 0 &&
                            is_inside != (slice.inside[cell_at(row, column - 1)] >= 0.5F)) ||
                           (y % scale == 0 && row > 0 &&
                            is_inside != (slice.inside[cell_at(row - 1, column)] >= 0.5F));
      const Colour c = is_edge ? line_colour : colour(cell);
      picture.pixels.push_back(opaque(c));
    }
  }
  return picture;
}

Status add_slices(Pictures& to, const Slice& slice) {
  to["slice_consistency"].file =
      ALHAZEN_TRY(to_png(slice_picture(slice, {0.86F, 0.33F, 0.10F}, [&](std::size_t cell) {
        return at_share(kSequential, slice.consistency[cell]);
      })));
  const auto limit = static_cast<float>(divergence_limit_per_mm(slice));
  to["slice_divergence"].file =
      ALHAZEN_TRY(to_png(slice_picture(slice, {0.10F, 0.10F, 0.12F}, [&](std::size_t cell) {
        return at_share(kDiverging, 0.5F + 0.5F * slice.divergence_per_mm[cell] / limit);
      })));
  return {};
}

/// The box about all that was seen in the mirror, in pixels of the map's lists.
Region mirrored(const LightMap& map) {
  int low_x = map.region.width, low_y = map.region.height, high_x = -1, high_y = -1;
  std::size_t pixel = 0;
  for (int y = 0; y < map.region.height; ++y) {
    for (int x = 0; x < map.region.width; ++x, ++pixel) {
      if (map.label[pixel] != Label::mirror) continue;
      low_x = std::min(low_x, x);
      high_x = std::max(high_x, x);
      low_y = std::min(low_y, y);
      high_y = y;
    }
  }
  if (high_x < 0) return {0, 0, map.region.width, map.region.height};
  return {low_x, low_y, high_x - low_x + 1, high_y - low_y + 1};
}

/// Places along one axis of the display as the mirror showed them, cut to these; grey where the
/// display itself was seen, clear where nothing decoded. Every n-th pixel of what is larger than a
/// picture: a mean of places is no place.
Picture8 light_map_picture(const LightMap& map, const PixelList<float>& place_px, int display_px) {
  const Region box = mirrored(map);
  const int step = (std::max(box.width, box.height) + kLightMap_px - 1) / kLightMap_px;
  Picture8 picture{(box.width + step - 1) / step, (box.height + step - 1) / step, {}};
  picture.pixels.reserve(static_cast<std::size_t>(picture.width) *
                         static_cast<std::size_t>(picture.height));
  for (int y = box.y; y < box.y + box.height; y += step) {
    for (int x = box.x; x < box.x + box.width; x += step) {
      const std::size_t pixel =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(map.region.width) +
          static_cast<std::size_t>(x);
      if (map.label[pixel] == Label::mirror) {
        const float share = place_px[pixel] / static_cast<float>(std::max(display_px - 1, 1));
        picture.pixels.push_back(opaque(at_share(kPlaces, share)));
      } else if (map.label[pixel] == Label::direct_sight) {
        picture.pixels.push_back(opaque(kDirect));
      } else {
        picture.pixels.push_back({0, 0, 0, 0});
      }
    }
  }
  return picture;
}

}  // namespace

std::string view_name(const std::string& colouring_file, const char* view) {
  return colouring_file + "_" + view;
}

std::string light_map_picture_name(const StackKey& key, char axis) {
  const std::string file = light_map_name(key);
  return "light_map_" + file.substr(0, file.rfind('.')) + "_" + axis;
}

double views_extent_mm(const Report& report) {
  return std::max(1.04 * (report.mesh.high_mm - report.mesh.low_mm).maxCoeff(), 1e-6);
}

double divergence_limit_per_mm(const Slice& slice) {
  std::vector<float> sizes;
  for (const float d : slice.divergence_per_mm) {
    if (d != 0) sizes.push_back(std::abs(d));
  }
  if (sizes.empty()) return 1;
  // A few cells on crossing surfaces reach far beyond the rest.
  const auto at = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() * 98 / 100);
  std::nth_element(sizes.begin(), at, sizes.end());
  return round_limit(static_cast<double>(*at));
}

Result<Pictures> draw_pictures(const Report& report, const Mesh& mesh,
                               std::span<const Colouring> colourings) {
  Pictures pictures;
  ALHAZEN_TRY(add_views(pictures, report, mesh, colourings));
  if (report.slice) ALHAZEN_TRY(add_slices(pictures, *report.slice));
  for (const LightMapSample& sample : report.light_maps) {
    const LightMap& map = sample.map;
    pictures[light_map_picture_name(map.key, 'u')].file =
        ALHAZEN_TRY(to_png(light_map_picture(map, map.u_px, sample.display_width_px)));
    pictures[light_map_picture_name(map.key, 'v')].file =
        ALHAZEN_TRY(to_png(light_map_picture(map, map.v_px, sample.display_height_px)));
  }
  return pictures;
}

Status write_pictures(const Pictures& pictures, const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return Error{Code::unavailable, folder.string() + ": " + error.message()};
  for (const auto& [name, picture] : pictures)
    ALHAZEN_TRY(write_file_safely(folder / (name + ".png"), picture.file));

  // What an earlier report drew and this one has not would be taken for its own.
  std::vector<std::string> possible{"slice_consistency", "slice_divergence"};
  for (const char* file : kColouringFiles)
    for (const ViewDirection& view : six_views()) possible.push_back(view_name(file, view.name));
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const fs::path& file = at->path();
    const std::string name = file.stem().string();
    if (file.extension() == ".png" && name.starts_with("light_map_")) possible.push_back(name);
  }
  for (const std::string& name : possible) {
    if (!error && !pictures.contains(name)) fs::remove(folder / (name + ".png"), error);
  }
  if (error) return Error{Code::unavailable, folder.string() + ": " + error.message()};
  return {};
}

}  // namespace alhazen
