// What CGAL, which knows nothing of how these meshes were made, says of them.
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "reconstruct/mesh/clean.h"
#include "reconstruct/mesh/contour.h"
#include "tests/unit/surface/scene.h"

namespace alhazen {
namespace {

using scene::kVolume;
using scene::refined_near;
using Kernel = CGAL::Simple_cartesian<double>;
using Surface = CGAL::Surface_mesh<Kernel::Point_3>;

/// The mesh as CGAL's; a triangle that no manifold mesh has fails the test.
Surface surface_of(const Mesh& mesh) {
  Surface surface;
  std::vector<Surface::Vertex_index> vertices;
  for (const Eigen::Vector3d& p : mesh.vertices_mm) {
    vertices.push_back(surface.add_vertex({p.x(), p.y(), p.z()}));
  }
  for (const auto& triangle : mesh.triangles) {
    const auto face = surface.add_face(vertices[static_cast<std::size_t>(triangle[0])],
                                       vertices[static_cast<std::size_t>(triangle[1])],
                                       vertices[static_cast<std::size_t>(triangle[2])]);
    EXPECT_NE(face, Surface::null_face());
  }
  return surface;
}

struct Shape {
  const char* name;
  scene::Distance distance;
};

/// Smooth, twisted, thin and sharp.
std::vector<Shape> shapes() {
  const auto about = [](const Eigen::Vector3d& p) -> Eigen::Vector3d {
    return p - kVolume.centre_mm;
  };
  return {{"sphere", [=](const Eigen::Vector3d& p) { return about(p).norm() - 20.3; }},
          {"torus",
           [=](const Eigen::Vector3d& p) {
             const Eigen::Vector3d q = about(p);
             return std::hypot(std::hypot(q.x(), q.y()) - 18.2, q.z()) - 7.1;
           }},
          {"waves",
           [=](const Eigen::Vector3d& p) {
             const Eigen::Vector3d q = about(p);
             return q.norm() - 18 - 1.5 * std::sin(0.9 * q.x()) * std::sin(0.7 * q.y() + q.z());
           }},
          {"plate of one and a half leaves",
           [=](const Eigen::Vector3d& p) {
             const Eigen::Vector3d q = about(p);
             return std::max(std::abs(q.z() + 0.2 * q.x()) - 0.75, q.norm() - 20);
           }},
          {"block", [=](const Eigen::Vector3d& p) {
             const Eigen::Vector3d q = about(p);
             return std::max({std::abs(q.x() + 0.3 * q.y()) - 15.2, std::abs(q.y()) - 11.7,
                              std::abs(q.z() - 0.1 * q.x()) - 9.4});
           }}};
}

TEST(Cgal, FindsMeshesClosedOutwardAndFreeOfSelfIntersections) {
  namespace pmp = CGAL::Polygon_mesh_processing;
  for (const Shape& shape : shapes()) {
    SCOPED_TRACE(shape.name);
    const Octree octree = refined_near(shape.distance, 3, 6, 3);  // leaves of 1 mm
    for (const double noise_mm : {0.0, 0.05}) {
      SCOPED_TRACE(noise_mm);
      std::mt19937 random(1);
      std::normal_distribution<double> noise(0, 1);
      std::vector<float> value(octree.size());
      for (std::size_t i = 0; i < octree.size(); ++i) {
        value[i] =
            static_cast<float>(shape.distance(octree.centre_mm(i)) + noise_mm * noise(random));
      }
      CleanOptions options;
      options.min_edge_mm = 0.05;
      const auto contoured = contour(octree, value, {});
      ASSERT_TRUE(contoured) << contoured.error().text();
      const auto mesh = clean(*contoured, options);
      ASSERT_TRUE(mesh) << mesh.error().text();
      const Surface surface = surface_of(*mesh);
      EXPECT_TRUE(surface.is_valid(false));
      EXPECT_TRUE(CGAL::is_closed(surface));
      EXPECT_TRUE(pmp::is_outward_oriented(surface));
      std::vector<std::pair<Surface::Face_index, Surface::Face_index>> crossings;
      pmp::self_intersections(surface, std::back_inserter(crossings));
      EXPECT_TRUE(crossings.empty()) << crossings.size() << " of " << surface.number_of_faces();
    }
  }
}

}  // namespace
}  // namespace alhazen
