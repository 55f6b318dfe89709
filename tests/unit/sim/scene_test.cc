#include "drivers/sim/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/unit/sim/world_file.h"

namespace alhazen::sim {
namespace {

using testing::AllOf;
using testing::HasSubstr;

TEST(Scene, ReadsEveryShippedWorld) {
  for (const char* name : {"small", "sphere", "torus", "pits", "bunny"}) {
    const auto scene = Scene::load(shipped_world(name));
    ASSERT_TRUE(scene) << scene.error().text();
    EXPECT_FALSE(scene->cameras.empty());
    EXPECT_GE(scene->displays.size(), 2U);
    for (const CameraTruth& camera : scene->cameras) {
      // The object's middle is in the picture, and the picture upright: z goes up.
      const Vec2 low = camera.lens.project(camera.camera_from_rig * Vec3(0, 0, 20));
      const Vec2 high = camera.lens.project(camera.camera_from_rig * Vec3(0, 0, 30));
      EXPECT_GT(low.x(), 0);
      EXPECT_LT(low.x(), camera.width_px);
      EXPECT_LT(high.y(), low.y());
      EXPECT_NEAR(camera.camera_from_rig.turn.determinant(), 1, 1e-12);
    }
    for (const DisplayTruth& display : scene->displays)
      // The object is on the lit side.
      EXPECT_LT((Vec3(0, 0, 20) - display.origin_mm).dot(display.u_mm.cross(display.v_mm)), 0)
          << display.id;
  }
}

TEST(Scene, SaysWhatIsWrongAndWhere) {
  const std::string good = text_of(shipped_world("small"));
  const struct {
    const char *from, *to, *file_line_key, *range;
  } mistakes[] = {
      {"samples_across = 2", "samples_across = 9", ".toml:6: key 'renderer.samples_across' is 9",
       "[2, 8]"},
      {"samples_across = 2", "samples_across = \"2\"", "key 'renderer.samples_across'",
       "a whole number"},
      {"samples_across = 2", "samples_acros = 2", ".toml:6: unknown key 'renderer.samples_acros'",
       ""},
      {"seed = 1", "seed = -1", ".toml:3: key 'seed' is -1", "[0, "},
      {"seed = 1", "sead = 1", ".toml:3: unknown key 'sead'", ""},
      {"[holder]", "[holdre]", "unknown key 'holdre'", ""},
      {"form = \"sphere\"", "form = \"cube\"", "key 'object.form' is \"cube\"",
       "sphere, torus, pits or mesh"},
      {"radius_mm = 12.0", "radius_mm = nan", "key 'object.radius_mm'", "[1, 1000]"},
      {"radius_mm = 12.0", "", "key 'object.radius_mm' is missing", "[1, 1000]"},
      {"bits = 8", "bits = 10", "key 'sensor.bits' is 10", "8, 12 or 16"},
      {"elevation_deg = [15.0, 70.0]", "elevation_deg = [15.0]", "key 'arc.elevation_deg'",
       "2 numbers"},
      {"elevation_deg = [15.0, 70.0]", "elevation_deg = [15.0, 170.0]", "key 'arc.elevation_deg'",
       "[-90, 90]"},
      {"elevation_deg = [15.0, 70.0]", "elevation_deg = [\"a\", 1]", "key 'arc.elevation_deg'",
       "array of numbers"},
      {"width_px = 160", "", "key 'arc.width_px' is missing", "[8, 8192]"},
      {"id = \"above\"", "id = \"side\"", "key 'display.id' is \"side\" twice", "different"},
      {"pitch_mm = 3.0", "pitch_mm = 0", "key 'display[0].pitch_mm' is 0", "[0.001, 100]"},
      {"[turntable]", "[turntable]\nmax_deg = -1.0", "key 'turntable.max_deg'", "min_deg"},
      {"seed = 1", "seed = 1\nambient = 4", "'ambient' must be a table", ""},
      {"[[display]]", "[[camera]]\nid = \"c3\"\n[[display]]", "key 'camera.id' is \"c3\"",
       "c0 … c2"},
      {"[[display]]", "[[fault]]\ndevice = \"c9\"\ncall = 1\nkind = \"lost\"\n[[display]]",
       "key 'fault.device' is \"c9\"", "the id of a camera"},
      {"[[display]]", "[[fault]]\ndevice = \"side\"\ncall = 1\nkind = \"corrupt\"\n[[display]]",
       "key 'fault.kind' is \"corrupt\"", "stale for a camera"},
      {"[[display]]", "[[fault]]\ndevice = \"c0\"\ncall = 1\nkind = \"gone\"\n[[display]]",
       "key 'fault.kind' is \"gone\"", "lost_for_good"},
      {"[[display]]",
       "[[fault]]\ndevice = \"c0\"\ncall = 1\nkind = \"lost\"\non = \"show\"\n[[display]]",
       "key 'fault.on'", ""},
      {"[sensor]", "[sensor", ".toml:", ""},
  };
  for (const auto& mistake : mistakes) {
    const WorldFile file(replaced(good, mistake.from, mistake.to));
    const auto scene = Scene::load(file.path());
    ASSERT_FALSE(scene) << mistake.to;
    EXPECT_EQ(scene.error().code, Code::invalid);
    EXPECT_THAT(scene.error().what,
                AllOf(HasSubstr(file.path().string()), HasSubstr(mistake.file_line_key),
                      HasSubstr(mistake.range)))
        << mistake.to;
  }
  const auto missing = Scene::load("/nowhere/world.toml");
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, Code::unavailable);
}

TEST(Scene, LetsTheStarterChooseMeshAndSeed) {
  SceneOverrides overrides;
  overrides.object_mesh = "/some/mesh.ply";
  overrides.object_size_mm = 55;
  overrides.object_up = "-x";
  overrides.seed = 99;
  const auto scene = Scene::load(shipped_world("bunny"), overrides);
  ASSERT_TRUE(scene) << scene.error().text();
  EXPECT_EQ(scene->object.mesh, "/some/mesh.ply");
  EXPECT_EQ(scene->object.size_mm, 55);
  EXPECT_EQ(scene->object.up, "-x");
  EXPECT_EQ(scene->seed, 99U);
  // A sphere is no mesh.
  EXPECT_FALSE(Scene::load(shipped_world("sphere"), overrides));
  overrides.object_size_mm = 0.5;
  EXPECT_FALSE(Scene::load(shipped_world("bunny"), overrides));
  overrides.object_size_mm = 55;
  overrides.object_up = "w";
  EXPECT_FALSE(Scene::load(shipped_world("bunny"), overrides));
}

TEST(Scene, CamerasMayDifferFromTheArc) {
  const auto scene =
      Scene::load(WorldFile(text_of(shipped_world("small")) +
                            "\n[[camera]]\nid = \"c1\"\nelevation_deg = 90.0\nwidth_px = "
                            "200\ndistortion = [0.1, 0, 0, 0, 0, 0, 0, 0]\n")
                      .path());
  ASSERT_TRUE(scene) << scene.error().text();
  EXPECT_EQ(scene->cameras[0].width_px, 160);
  EXPECT_EQ(scene->cameras[1].width_px, 200);
  EXPECT_EQ(scene->cameras[1].lens.k[0], 0.1);
  const Vec3 centre = scene->cameras[1].camera_from_rig.inverse().shift_mm;
  EXPECT_LT((centre - Vec3(0, 0, 412)).norm(), 1e-6);
}

}  // namespace
}  // namespace alhazen::sim
