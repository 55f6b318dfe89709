#include "reconstruct/report/scene.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <unordered_map>

#include "alhazen/check.h"
#include "reconstruct/mesh/clean.h"
#include "reconstruct/report/draw.h"

namespace alhazen {
namespace {

using Eigen::Vector3d;
using Triangle = std::array<std::uint32_t, 3>;
using Json = nlohmann::ordered_json;

constexpr std::uint32_t kNoVertex = 0xffffffffU;
constexpr double kSteps = 65535;            // of a place along each axis
constexpr std::uint8_t kNotObserved = 255;  // instead of a share

struct Box {
  Vector3d low_mm = Vector3d::Zero(), high_mm = Vector3d::Zero();
};

template <class Places>
Box box_of(std::size_t count, const Places& place_mm) {
  if (count == 0) return {};
  Box box{place_mm(0), place_mm(0)};
  for (std::size_t i = 1; i < count; ++i) {
    box.low_mm = box.low_mm.cwiseMin(place_mm(i));
    box.high_mm = box.high_mm.cwiseMax(place_mm(i));
  }
  return box;
}

/// The triangles whose corners stay apart when each vertex becomes the one that stands for it, with
/// vertices named anew in the order of their first use.
DisplayMesh with_representatives(const Mesh& mesh, const std::vector<std::uint32_t>& of) {
  DisplayMesh out;
  std::vector<std::uint32_t> place(mesh.vertices_mm.size(), kNoVertex);
  for (const Triangle& t : mesh.triangles) {
    const Triangle source{of[t[0]], of[t[1]], of[t[2]]};
    if (source[0] == source[1] || source[1] == source[2] || source[2] == source[0]) continue;
    Triangle named{};
    for (std::size_t k = 0; k < 3; ++k) {
      std::uint32_t& at = place[source[k]];
      if (at == kNoVertex) {
        at = static_cast<std::uint32_t>(out.source.size());
        out.source.push_back(source[k]);
      }
      named[k] = at;
    }
    out.triangles.push_back(named);
  }
  return out;
}

/// Per vertex the one of its cell that lies nearest to the mean of the cell's vertices.
std::vector<std::uint32_t> nearest_to_mean(const Mesh& mesh, const Vector3d& low_mm,
                                           double cell_mm) {
  struct Cell {
    Vector3d sum_mm = Vector3d::Zero();
    std::size_t count = 0;
    double nearest_mm2 = std::numeric_limits<double>::infinity();
    std::uint32_t nearest = kNoVertex;
  };
  std::vector<Cell> cells;
  std::unordered_map<std::uint64_t, std::uint32_t> at;
  std::vector<std::uint32_t> cell_of;
  cell_of.reserve(mesh.vertices_mm.size());
  for (const Vector3d& p : mesh.vertices_mm) {
    std::uint64_t name = 0;
    for (int axis = 0; axis < 3; ++axis)
      name = name << 21U | static_cast<std::uint64_t>((p[axis] - low_mm[axis]) / cell_mm);
    const auto [found, is_new] = at.try_emplace(name, static_cast<std::uint32_t>(cells.size()));
    if (is_new) cells.emplace_back();
    Cell& cell = cells[found->second];
    cell.sum_mm += p;
    ++cell.count;
    cell_of.push_back(found->second);
  }
  for (std::size_t i = 0; i < cell_of.size(); ++i) {
    Cell& cell = cells[cell_of[i]];
    const double away_mm2 =
        (mesh.vertices_mm[i] - cell.sum_mm / static_cast<double>(cell.count)).squaredNorm();
    if (away_mm2 >= cell.nearest_mm2) continue;
    cell.nearest_mm2 = away_mm2;
    cell.nearest = static_cast<std::uint32_t>(i);
  }
  std::vector<std::uint32_t> of;
  of.reserve(cell_of.size());
  for (const std::uint32_t cell : cell_of) of.push_back(cells[cell].nearest);
  return of;
}

template <class Number>
void append(std::string& to, Number number) {
  for (std::size_t byte = 0; byte < sizeof(number); ++byte)
    to += static_cast<char>(static_cast<std::make_unsigned_t<Number>>(number) >> (8 * byte));
}

/// A unit vector on the octahedron |x| + |y| + |z| = 1, its lower half folded over the upper.
std::array<std::int16_t, 2> folded(const Vector3d& n) {
  const double size = n.lpNorm<1>();
  Eigen::Vector2d at = size > 0 ? Eigen::Vector2d(n.head<2>() / size) : Eigen::Vector2d::Zero();
  if (n.z() < 0) {
    at = {(1 - std::abs(at.y())) * std::copysign(1.0, at.x()),
          (1 - std::abs(at.x())) * std::copysign(1.0, at.y())};
  }
  const auto number = [](double x) { return static_cast<std::int16_t>(std::lround(x * 32767)); };
  return {number(at.x()), number(at.y())};
}

Json list_of(const Vector3d& p) { return Json{p.x(), p.y(), p.z()}; }
Json list_of(const Colour& c) { return Json{c.r, c.g, c.b}; }

}  // namespace

DisplayMesh simplified(const Mesh& mesh, std::size_t max_triangles) {
  std::vector<std::uint32_t> itself(mesh.vertices_mm.size());
  for (std::size_t i = 0; i < itself.size(); ++i) itself[i] = static_cast<std::uint32_t>(i);
  DisplayMesh out = with_representatives(mesh, itself);
  if (out.triangles.size() <= max_triangles) return out;

  const Box box = box_of(mesh.vertices_mm.size(),
                         [&](std::size_t i) -> const Vector3d& { return mesh.vertices_mm[i]; });
  const double edge_mm = (box.high_mm - box.low_mm).maxCoeff();
  double area_mm2 = 0;
  for (const auto& [a, b, c] : mesh.triangles)
    area_mm2 += (mesh.vertices_mm[b] - mesh.vertices_mm[a])
                    .cross(mesh.vertices_mm[c] - mesh.vertices_mm[a])
                    .norm() /
                2;
  // A surface meets one to 1.7 cells for each square of its area, two triangles a vertex. Cells are
  // at least so large that 2²¹ of them span the box.
  double cell_mm = std::max({std::sqrt(2 * area_mm2 / static_cast<double>(max_triangles + 1)),
                             edge_mm / (1 << 20), 1e-9});
  constexpr double kCoarser = 1.03;
  for (;; cell_mm *= kCoarser) {
    out = with_representatives(mesh, nearest_to_mean(mesh, box.low_mm, cell_mm));
    if (out.triangles.size() <= max_triangles) break;
  }
  out.cell_mm = cell_mm;
  return out;
}

Scene scene_of(const Mesh& mesh, const DisplayMesh& shown, std::span<const Colouring> colourings) {
  const std::size_t vertices = shown.source.size();
  const auto place_mm = [&](std::size_t i) -> const Vector3d& {
    return mesh.vertices_mm[shown.source[i]];
  };
  const Box box = box_of(vertices, place_mm);
  const Vector3d step_mm = (box.high_mm - box.low_mm) / kSteps;

  Scene scene;
  std::string& data = scene.data;
  for (std::size_t i = 0; i < vertices; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const double number =
          step_mm[axis] > 0 ? (place_mm(i)[axis] - box.low_mm[axis]) / step_mm[axis] : 0;
      append(data, static_cast<std::uint16_t>(std::lround(std::clamp(number, 0.0, kSteps))));
    }
  }
  Mesh with_normals;
  const std::vector<Eigen::Vector3f>* normals = &mesh.normals;
  if (mesh.normals.empty()) {
    with_normals.vertices_mm = mesh.vertices_mm;
    with_normals.triangles = mesh.triangles;
    set_normals(with_normals);
    normals = &with_normals.normals;
  }
  for (const std::uint32_t source : shown.source)
    for (const std::int16_t number : folded((*normals)[source].cast<double>()))
      append(data, number);
  for (const Colouring& colouring : colourings) {
    if (colouring.stops.empty()) continue;
    for (const std::uint32_t source : shown.source) {
      const float share = colouring.share[source];
      append(data, std::isnan(share) ? kNotObserved
                                     : static_cast<std::uint8_t>(std::lround(share * 254)));
    }
  }
  std::uint32_t named = 0;
  for (const Triangle& t : shown.triangles) {
    for (const std::uint32_t vertex : t) {
      ALHAZEN_CHECK(vertex <= named);
      std::uint32_t below = named - vertex;
      if (below == 0) ++named;
      for (; below >= 0x80; below >>= 7U) data += static_cast<char>((below & 0x7fU) | 0x80U);
      data += static_cast<char>(below);
    }
  }

  Json facts{{"vertices", vertices},
             {"triangles", shown.triangles.size()},
             {"of_triangles", mesh.triangles.size()},
             {"cell_mm", shown.cell_mm},
             {"low_mm", list_of(box.low_mm)},
             {"step_mm", list_of(step_mm)},
             {"clay", list_of(kClay)},
             {"not_observed", list_of(kUnobserved)},
             {"colourings", Json::array()},
             {"views", Json::array()}};
  for (const Colouring& colouring : colourings) {
    Json stops = Json::array();
    for (const Colour& stop : colouring.stops) stops.push_back(list_of(stop));
    facts["colourings"].push_back({{"name", colouring.name},
                                   {"explained", colouring.explained},
                                   {"labels", colouring.labels},
                                   {"relief", colouring.relief},
                                   {"stops", stops}});
  }
  for (const ViewDirection& view : six_views())
    facts["views"].push_back({{"name", view.name},
                              {"toward", list_of(view.right.cross(view.up))},
                              {"up", list_of(view.up)}});
  // A page must not read an end of its script in it.
  for (const char c : facts.dump()) {
    if (c == '<') {
      scene.facts += "\\u003c";
    } else {
      scene.facts += c;
    }
  }
  return scene;
}

}  // namespace alhazen
