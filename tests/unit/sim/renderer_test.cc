#include "drivers/sim/renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tests/unit/sim/world_file.h"

namespace alhazen::sim {
namespace {

Image stripes(const DisplayTruth& display, int period_px, bool along_u) {
  std::vector<std::uint8_t> pixels;
  for (int y = 0; y < display.height_px; ++y)
    for (int x = 0; x < display.width_px; ++x)
      pixels.push_back(((along_u ? x : y) / period_px) % 2 == 0 ? 255 : 0);
  return Image::copy<std::uint8_t>(display.width_px, display.height_px, 8, pixels);
}

/// What a mirroring sphere on the plate shows at one point of the sensor, by the law of reflection
/// written out again: rig frame, complete search over displays, nearest display pixel.
double sphere_radiance(const Scene& scene, const CameraTruth& camera, const Vec2& pixel,
                       const std::vector<Image>& shown) {
  const Rigid rig_from_camera = camera.camera_from_rig.inverse();
  const Vec2 plane = camera.lens.plane_point(pixel);
  Vec3 o = rig_from_camera.shift_mm,
       d = (rig_from_camera.turn * Vec3(plane.x(), plane.y(), 1)).normalized();
  const double r = scene.object.radius_mm;
  const Vec3 m(0, 0, r);
  double share = 1;
  const double closest = (m - o).dot(d), gap = (o + closest * d - m).norm();
  if (gap < r) {
    const Vec3 p = o + (closest - std::sqrt(r * r - gap * gap)) * d, n = (p - m) / r;
    d -= 2 * d.dot(n) * n;
    o = p;
    share = scene.object.reflectance;
  }
  std::optional<std::size_t> hit;
  double nearest = 1e18, u = 0, v = 0;
  for (std::size_t i = 0; i < scene.displays.size(); ++i) {
    const DisplayTruth& display = scene.displays[i];
    // o + t d = origin + u u_mm + v v_mm
    Eigen::Matrix3d system;
    system << display.u_mm, display.v_mm, -d;
    const Vec3 answer = system.inverse() * (o - display.origin_mm);
    if (answer.z() <= 1e-6 || answer.z() >= nearest || answer.x() < -0.5 || answer.y() < -0.5 ||
        answer.x() >= display.width_px - 0.5 || answer.y() >= display.height_px - 0.5)
      continue;
    nearest = answer.z();
    hit = d.dot(display.u_mm.cross(display.v_mm)) > 0 ? std::optional(i) : std::nullopt;
    u = answer.x();
    v = answer.y();
  }
  // The holder, below the sphere: only lines that pass under the plate meet it.
  if (!hit) return 0;
  const DisplayTruth& display = scene.displays[*hit];
  const int value =
      shown[*hit]
          .mono8()[static_cast<std::size_t>(std::lround(v) * display.width_px + std::lround(u))];
  return share *
         (display.black_share + (1 - display.black_share) * std::pow(value / 255.0, display.gamma));
}

TEST(Renderer, ShowsOnASphereWhatTheLawOfReflectionSays) {
  const auto world =
      make_world(replaced(text_of(shipped_world("small")), "radius_mm = 3.0", "radius_mm = 0.0"));
  ASSERT_TRUE(world);
  const Scene& scene = world->scene();
  for (const bool along_u : {true, false}) {
    const std::vector<Image> shown = {stripes(scene.displays[0], 8, along_u),
                                      stripes(scene.displays[1], 8, along_u)};
    std::vector<std::shared_ptr<const Emission>> light;
    for (std::size_t i = 0; i < 2; ++i)
      light.push_back(std::make_shared<const Emission>(shown[i], scene.displays[i]));
    for (const std::size_t camera : {0U, 2U}) {
      const Region region{50, 40, 60, 70};
      const std::vector<float> picture = world->radiance(camera, 0, region, light);
      double square = 0, worst_even = 0;
      int count = 0, lit = 0;
      for (int y = 0; y < region.height; y += 3)
        for (int x = 0; x < region.width; x += 4) {
          constexpr int kAcross = 12;
          double brute = 0;
          for (int j = 0; j < kAcross; ++j)
            for (int i = 0; i < kAcross; ++i)
              brute += sphere_radiance(scene, scene.cameras[camera],
                                       {region.x + x + (i + 0.5) / kAcross - 0.5,
                                        region.y + y + (j + 0.5) / kAcross - 0.5},
                                       shown) /
                       (kAcross * kAcross);
          const double ours = static_cast<double>(picture[index_of(x, y, region.width)]);
          square += (ours - brute) * (ours - brute);
          if (brute > 0.01) ++lit;
          worst_even = std::max(worst_even, std::abs(ours - brute));
          ++count;
        }
      EXPECT_GT(lit, 10);
      EXPECT_LT(std::sqrt(square / count), 0.02);
      EXPECT_LT(worst_even, 0.25);  // at the displays' edges four samples stand for the pixel
    }
  }
}

TEST(Renderer, TracesTheSameWhateverTheRegion) {
  const auto world = make_world(text_of(shipped_world("small")));
  ASSERT_TRUE(world);
  std::vector<std::shared_ptr<const Emission>> light;
  for (const DisplayTruth& display : world->scene().displays)
    light.push_back(std::make_shared<const Emission>(stripes(display, 4, true), display));
  const std::vector<float> whole = world->radiance(1, 0.3, {0, 0, 160, 160}, light);
  const Region part{37, 51, 70, 41};
  const std::vector<float> cut = world->radiance(1, 0.3, part, light);
  for (int y = 0; y < part.height; ++y)
    for (int x = 0; x < part.width; ++x)
      ASSERT_NEAR(cut[index_of(x, y, part.width)], whole[index_of(part.x + x, part.y + y, 160)],
                  1e-5)
          << x << ", " << y;
}

TEST(Renderer, FollowsLightFromWallToWall) {
  // Within the torus's ring a second bounce reaches the displays where the first does not.
  const std::string text =
      replaced(text_of(shipped_world("torus")), "samples_across = 4", "samples_across = 2");
  const auto deep = make_world(text);
  const auto shallow = make_world(replaced(text, "path_depth = 4", "path_depth = 1"));
  ASSERT_TRUE(deep && shallow);
  std::vector<std::shared_ptr<const Emission>> white(2, std::make_shared<const Emission>(1.0));
  const Region hole{240, 240, 160, 160};
  const std::vector<float> all = deep->radiance(4, 0, hole, white),
                           first = shallow->radiance(4, 0, hole, white);
  double more = 0, bounced_twice = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_GE(all[i], first[i] - 1e-6);
    more += static_cast<double>(all[i] - first[i]);
    if (first[i] < 0.01F && std::abs(static_cast<double>(all[i]) - 0.9 * 0.9) < 0.01)
      ++bounced_twice;
  }
  EXPECT_GT(more, 1);
  EXPECT_GE(bounced_twice, 3);
}

TEST(Renderer, HolderHidesWhatIsBehindIt) {
  // The tablet below is seen by the lower half of the sphere, unless a plate is in the way.
  const std::string text =
      replaced(text_of(shipped_world("sphere")), "samples_across = 4", "samples_across = 2");
  const auto thin = make_world(text),
             thick = make_world(replaced(text, "radius_mm = 6.0", "radius_mm = 60.0"));
  ASSERT_TRUE(thin && thick);
  const std::vector<std::shared_ptr<const Emission>> tablet_lit = {
      std::make_shared<const Emission>(0.0), std::make_shared<const Emission>(1.0)};
  const Region ball{840, 840, 368, 368};
  double seen = 0, hidden = 0;
  for (const float value : thin->radiance(2, 0, ball, tablet_lit))
    seen += static_cast<double>(value > 0.5F);
  for (const float value : thick->radiance(2, 0, ball, tablet_lit))
    hidden += static_cast<double>(value > 0.5F);
  EXPECT_GT(seen, 1000);
  EXPECT_LT(hidden, 0.5 * seen);
}

TEST(Renderer, MattSurfaceGathersTheDisplaysLight) {
  const std::string text = replaced(text_of(shipped_world("small")), "radius_mm = 12.0",
                                    "radius_mm = 12.0\nreflectance = 0.0\ndiffuse = 0.5");
  const auto world = make_world(text);
  ASSERT_TRUE(world);
  const Scene& scene = world->scene();
  std::vector<std::shared_ptr<const Emission>> one_lit = {std::make_shared<const Emission>(1.0),
                                                          std::make_shared<const Emission>(0.0)};
  const CameraTruth& camera = scene.cameras[0];
  // A point of the sphere between camera and display; the integral over the display in small cells.
  const Vec3 centre(0, 0, 12), eye = camera.camera_from_rig.inverse().shift_mm;
  const Vec3 normal = ((eye - centre).normalized() + Vec3(0.2, 0.8, 0.3)).normalized(),
             p = centre + 12 * normal;
  double brute = 0;
  const DisplayTruth& display = scene.displays[0];
  for (int v = 0; v < display.height_px; ++v)
    for (int u = 0; u < display.width_px; ++u) {
      const Vec3 to = display.origin_mm + u * display.u_mm + v * display.v_mm - p;
      const Vec3 inward = display.u_mm.cross(display.v_mm);  // length: area of a pixel
      brute += 0.5 / 3.14159265 * std::max(0.0, to.dot(normal)) * std::max(0.0, to.dot(inward)) /
               std::pow(to.squaredNorm(), 2);
    }
  const Vec2 pixel = camera.lens.project(camera.camera_from_rig * p);
  const Region region{static_cast<int>(std::lround(pixel.x())),
                      static_cast<int>(std::lround(pixel.y())), 1, 1};
  const double dark = scene.displays[0].black_share;
  EXPECT_NEAR(static_cast<double>(world->radiance(0, 0, region, one_lit)[0]), brute * (1 + dark),
              0.02 * brute);
}

}  // namespace
}  // namespace alhazen::sim
