#include "reconstruct/exchange/vtu.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "tests/unit/scan/temporary_folder.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

/// An octree of several levels with a field whose values say where they belong.
struct Scene {
  Octree octree = Octree::uniform({{1, 2, 3}, 16}, 2);
  NormalField field;
  std::vector<float> divergence;
  Indicator indicator;
};

Scene some_scene() {
  Scene scene;
  std::vector<std::uint8_t> wanted(scene.octree.size(), 2);
  wanted[5] = 4;
  scene.octree = scene.octree.adapted(wanted);
  for (std::size_t i = 0; i < scene.octree.size(); ++i) {
    const auto x = static_cast<float>(i);
    scene.field.normal.emplace_back(x, -x, 0.5F);
    scene.field.consistency.push_back(x / 1000);
    scene.field.support.push_back(x * 3);
    scene.field.votes.push_back(static_cast<std::uint16_t>(65535 - i));
    scene.field.free_space.push_back(static_cast<std::uint8_t>(i % 2));
    scene.field.no_surface.push_back(static_cast<std::uint8_t>(i % 3 == 0));
    scene.divergence.push_back(-x / 7);
    scene.indicator.u.push_back(1 - x / 1000);
  }
  return scene;
}

/// What Python's readers of XML and base64 find in the file.
nlohmann::json read_independently(const fs::path& file) {
  const std::string command =
      "python3 '" ALHAZEN_SOURCE_DIR "/tests/support/read_vtu.py' '" + file.string() + "'";
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::string text;
  std::array<char, 4096> part{};
  while (const std::size_t n = fread(part.data(), 1, part.size(), pipe.get()))
    text.append(part.data(), n);
  return nlohmann::json::parse(text);
}

TEST(Vtu, HoldsEveryLeafAndNumber) {
  const Scene scene = some_scene();
  ASSERT_EQ(scene.octree.finest_level(), 4);
  const TemporaryFolder folder;
  const fs::path file = folder.path() / "field.vtu";
  ASSERT_TRUE(write_vtu(scene.octree, scene.field, scene.divergence, scene.indicator, file));
  const nlohmann::json got = read_independently(file);
  const std::size_t cells = scene.octree.size();
  ASSERT_EQ(got["corners"].size(), cells);
  const auto& data = got["data"];
  for (std::size_t i = 0; i < cells; ++i) {
    EXPECT_EQ(got["types"][i], 11) << "VTK_VOXEL";
    ASSERT_EQ(got["corners"][i].size(), 8U);
    const double half = scene.octree.edge_mm(i) / 2;
    for (int corner = 0; corner < 8; ++corner) {
      const auto& p =
          got["points"][got["corners"][i][static_cast<std::size_t>(corner)].get<std::size_t>()];
      for (int axis = 0; axis < 3; ++axis) {
        const double sign = ((corner >> axis) & 1) != 0 ? 1 : -1;
        EXPECT_NEAR(p[static_cast<std::size_t>(axis)].get<double>(),
                    scene.octree.centre_mm(i)[axis] + sign * half, 1e-5);
      }
    }
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_EQ(data["normal"][i][static_cast<std::size_t>(axis)].get<float>(),
                scene.field.normal[i][axis]);
    EXPECT_EQ(data["consistency"][i].get<float>(), scene.field.consistency[i]);
    EXPECT_EQ(data["support"][i].get<float>(), scene.field.support[i]);
    EXPECT_EQ(data["votes"][i], scene.field.votes[i]);
    EXPECT_EQ(data["free_space"][i], scene.field.free_space[i]);
    EXPECT_EQ(data["no_surface"][i], scene.field.no_surface[i]);
    EXPECT_EQ(data["divergence_per_mm"][i].get<float>(), scene.divergence[i]);
    EXPECT_EQ(data["indicator"][i].get<float>(), scene.indicator.u[i]);
    EXPECT_EQ(data["level"][i], scene.octree.leaves()[i].level);
  }
  const std::set<std::vector<double>> distinct = got["points"].get<std::set<std::vector<double>>>();
  EXPECT_EQ(distinct.size(), got["points"].size()) << "neighbours share their corners";
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), fs::directory_iterator()), 1);
}

TEST(Vtu, SaysWhereItCannotBeWritten) {
  const Scene scene = some_scene();
  const auto written =
      write_vtu(scene.octree, scene.field, scene.divergence, scene.indicator, "/nowhere/field.vtu");
  EXPECT_EQ(written.error().code, Code::unavailable);
  EXPECT_EQ(write_vtu(scene.octree, scene.field, scene.divergence, scene.indicator, "/dev/full/x")
                .error()
                .code,
            Code::unavailable);
}

}  // namespace
}  // namespace alhazen
