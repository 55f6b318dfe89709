#include "reconstruct/reconstruct.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <string_view>

#include "reconstruct/mesh/clean.h"
#include "tests/support/analytic.h"
#include "tests/support/nobody.h"

namespace alhazen {
namespace {

using testing::HasSubstr;

const Volume kVolume{};
const analytic::Sphere kSphere{{1, -0.5, 50}, 25};

/// A small scan of the sphere: 288 Gray maps with coarse pixels.
struct SmallScan {
  Rig rig;
  std::vector<LightMap> maps;
};

const SmallScan& small_scan() {
  static const SmallScan scan = [] {
    SmallScan made;
    analytic::RigSize size;
    size.cameras = 8;
    size.pixel_mm = 0.5;
    size.sensor_px = 256;
    made.rig = analytic::make_rig(size);
    analytic::scan(made.rig, kSphere, 12, {.gray = true}, kSphere.centre_mm, 27,
                   [&](LightMap map) { made.maps.push_back(std::move(map)); });
    return made;
  }();
  return scan;
}

Reconstruction with_maps(const Rig& rig, const std::vector<LightMap>& maps, int level) {
  Options options;
  options.adapt.start_level = level - 1;  // so that small tests change levels, too
  auto reconstruction = Reconstruction::make(rig, kVolume, level, options);
  EXPECT_TRUE(reconstruction) << reconstruction.error().text();
  for (const LightMap& map : maps) EXPECT_TRUE(reconstruction->add(map));
  return std::move(*reconstruction);
}

TEST(Reconstruction, SphereComesOutClosedAndRightWhereItWasObserved) {
  const SmallScan& scan = small_scan();
  Reconstruction reconstruction = with_maps(scan.rig, scan.maps, 7);
  const auto result = reconstruction.finish(kNobody);
  ASSERT_TRUE(result) << result.error().text();
  const Mesh& mesh = result->mesh;
  EXPECT_EQ(result->light_maps, scan.maps.size());
  EXPECT_GT(result->hypotheses, 1000000u);
  const MeshCheck check = check_closed(mesh);
  EXPECT_TRUE(check.closed());
  EXPECT_EQ(check.components, 1u);
  EXPECT_EQ(check.euler, 2);
  const std::size_t count = mesh.vertices_mm.size();
  ASSERT_EQ(mesh.normals.size(), count);
  ASSERT_EQ(mesh.consistency.size(), count);
  // A single vertex that votes happen to agree on is no observation.
  std::vector<std::uint8_t> is_held(count, 0);
  for (const auto& triangle : mesh.triangles) {
    if (mesh.observed[triangle[0]] == 0 || mesh.observed[triangle[1]] == 0 ||
        mesh.observed[triangle[2]] == 0) {
      continue;
    }
    for (const std::uint32_t v : triangle) is_held[v] = 1;
  }
  EXPECT_EQ(is_held, std::vector<std::uint8_t>(mesh.observed.begin(), mesh.observed.end()));
  ASSERT_EQ(mesh.observed.size(), count);
  ASSERT_EQ(mesh.depth_sigma_mm.size(), count);
  double sum2 = 0, z2 = 0;
  std::vector<double> errors, turned;
  for (std::size_t i = 0; i < count; ++i) {
    if (mesh.observed[i] == 0) {
      EXPECT_TRUE(std::isnan(mesh.depth_sigma_mm[i]));
      continue;
    }
    const double error = analytic::distance_mm(kSphere, mesh.vertices_mm[i]);
    sum2 += error * error;
    z2 += error * error / (mesh.depth_sigma_mm[i] * mesh.depth_sigma_mm[i]);
    errors.push_back(std::abs(error));
    turned.push_back(
        (mesh.normals[i].cast<double>() - analytic::normal(kSphere, mesh.vertices_mm[i])).norm());
  }
  // A third of the sphere's surface at 0.8 mm leaves is 2500 leaves and about as many vertices.
  ASSERT_GT(errors.size(), 2500u);
  const auto n = static_cast<double>(errors.size());
  std::sort(errors.begin(), errors.end());
  std::sort(turned.begin(), turned.end());
  // Far below the thesis's 20 µm where well seen, although pixels are 0.5 mm and leaves 0.8 mm.
  EXPECT_LT(errors[errors.size() / 2], 0.012);
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.05);
  EXPECT_LT(std::sqrt(sum2 / n), 0.04);
  EXPECT_LT(turned[turned.size() * 9 / 10], 0.03);
  EXPECT_LT(std::sqrt(z2 / n), 2.0) << "the standard deviations are believable";
  EXPECT_EQ(result->octree.finest_level(), 7);
  EXPECT_EQ(result->field.normal.size(), result->octree.size());
  EXPECT_EQ(result->divergence.size(), result->octree.size());
  EXPECT_EQ(result->indicator.u.size(), result->octree.size());
  for (const char* stage : {"add", "vote", "surface", "depth", "mesh"}) {
    EXPECT_TRUE(std::any_of(result->times.begin(), result->times.end(), [&](const StageTime& t) {
      return t.stage == stage;
    })) << stage;
  }
}

TEST(Reconstruction, IsByteForByteTheSameForAnyOrderThreadsAndPreviews) {
  const SmallScan& scan = small_scan();
  const auto run = [&](const std::vector<LightMap>& maps, int threads, bool previews) {
    tbb::task_arena arena(threads);
    return arena.execute([&] {
      Reconstruction reconstruction = with_maps(scan.rig, {}, 6);
      for (std::size_t i = 0; i < maps.size(); ++i) {
        EXPECT_TRUE(reconstruction.add(maps[i]));
        if (previews && i % 100 == 99) {
          EXPECT_TRUE(reconstruction.preview(kNobody));
        }
      }
      auto result = reconstruction.finish(kNobody);
      EXPECT_TRUE(result) << result.error().text();
      return std::move(*result);
    });
  };
  const Reconstructed first = run(scan.maps, 1, false);
  std::vector<LightMap> shuffled = scan.maps;
  std::mt19937 random(1);
  std::shuffle(shuffled.begin(), shuffled.end(), random);
  const Reconstructed second = run(shuffled, 2, true);
  const auto same = [](const auto& a, const auto& b) {
    return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(a[0])) == 0;
  };
  EXPECT_TRUE(same(first.mesh.vertices_mm, second.mesh.vertices_mm));
  EXPECT_TRUE(same(first.mesh.triangles, second.mesh.triangles));
  EXPECT_TRUE(same(first.mesh.normals, second.mesh.normals));
  EXPECT_TRUE(same(first.mesh.consistency, second.mesh.consistency));
  EXPECT_TRUE(same(first.mesh.observed, second.mesh.observed));
  EXPECT_TRUE(same(first.mesh.depth_sigma_mm, second.mesh.depth_sigma_mm));
  EXPECT_TRUE(same(first.field.normal, second.field.normal));
  EXPECT_TRUE(same(first.divergence, second.divergence));
  EXPECT_TRUE(same(first.indicator.u, second.indicator.u));
}

TEST(Reconstruction, PreviewIsACoarseClosedMeshOfWhatIsThere) {
  const SmallScan& scan = small_scan();
  Reconstruction reconstruction =
      with_maps(scan.rig, {scan.maps.begin(), scan.maps.begin() + 90}, 8);
  const auto mesh = reconstruction.preview(kNobody);
  ASSERT_TRUE(mesh) << mesh.error().text();
  EXPECT_TRUE(check_closed(*mesh).closed());
  EXPECT_LT(mesh->vertices_mm.size(), 20000u);
  EXPECT_THAT(mesh->observed, testing::Each(0)) << "a preview measures nothing";
  for (const Eigen::Vector3d& p : mesh->vertices_mm) {
    EXPECT_LT(analytic::distance_mm(kSphere, p), 4);
  }
}

TEST(Reconstruction, ProgressOfEachStageOnlyGrowsAndEnds) {
  const SmallScan& scan = small_scan();
  Reconstruction reconstruction = with_maps(scan.rig, scan.maps, 5);
  std::mutex mutex;
  std::map<std::string, double, std::less<>> share;
  bool only_grows = true;
  const alhazen::Run run{{}, [&](std::string_view stage, double done) {
                           const std::scoped_lock lock(mutex);
                           double& last = share[std::string(stage)];
                           only_grows = only_grows && done >= last - 1e-9 && done <= 1;
                           last = std::max(last, done);
                         }};
  tbb::task_arena arena(1);
  arena.execute([&] { EXPECT_TRUE(reconstruction.finish(run)); });
  EXPECT_TRUE(only_grows);
  for (const char* stage : {"vote", "surface", "depth", "mesh"})
    EXPECT_EQ(share[stage], 1) << stage;
  EXPECT_EQ(share.size(), 4u);
}

TEST(Reconstruction, StopsInEveryStageWhenAsked) {
  const SmallScan& scan = small_scan();
  for (const char* stage : {"vote", "surface", "depth", "mesh"}) {
    Reconstruction reconstruction = with_maps(scan.rig, scan.maps, 5);
    std::stop_source source;
    const alhazen::Run run{source.get_token(), [&](std::string_view now, double) {
                             if (now == stage) source.request_stop();
                           }};
    const auto result = reconstruction.finish(run);
    // The last word of a stage may come when nothing is left to stop.
    if (result) {
      EXPECT_STREQ(stage, "mesh");
      continue;
    }
    EXPECT_EQ(result.error().code, Code::cancelled) << stage;
    if (std::string_view(stage) == "depth") {
      EXPECT_TRUE(reconstruction.finish(kNobody)) << "what was added is still there";
    }
  }
}

TEST(Reconstruction, SaysWhyThereIsNothing) {
  const SmallScan& scan = small_scan();
  auto reconstruction = Reconstruction::make(scan.rig, kVolume, 6, Options{});
  ASSERT_TRUE(reconstruction);
  EXPECT_EQ(reconstruction->preview(kNobody).error().code, Code::conflict);
  EXPECT_EQ(reconstruction->finish(kNobody).error().code, Code::invalid);
  ASSERT_TRUE(reconstruction->add(scan.maps[0]));
  const auto one = reconstruction->finish(kNobody);
  ASSERT_FALSE(one);
  EXPECT_EQ(one.error().code, Code::invalid);
  EXPECT_THAT(one.error().what, HasSubstr("no surface; take more stops"));
  EXPECT_EQ(reconstruction->preview(kNobody).error().code, Code::conflict);
}

TEST(Reconstruction, RefinesItsCalibrationAtWhatItsMeshObserved) {
  const SmallScan& scan = small_scan();
  Reconstruction reconstruction = with_maps(scan.rig, scan.maps, 6);
  const auto made = reconstruction.finish(kNobody);
  ASSERT_TRUE(made) << made.error().text();
  const auto refined = reconstruction.refine(made->mesh, kNobody);
  ASSERT_TRUE(refined) << refined.error().text();
  std::size_t observed = 0;
  for (const auto flag : made->mesh.observed) observed += flag != 0 ? 1u : 0u;
  const Refinement& how = refined->how;
  EXPECT_LE(how.used_before.points + how.held_out_before.points, observed);
  EXPECT_EQ(how.is_accepted, how.refusal.empty());
  EXPECT_EQ(how.is_accepted, refined->rig.to_json() != scan.rig.to_json());
  // Of a mesh that observed nothing nothing is refined.
  Mesh unseen = made->mesh;
  std::fill(unseen.observed.begin(), unseen.observed.end(), std::uint8_t{0});
  const auto kept = reconstruction.refine(unseen, kNobody);
  ASSERT_TRUE(kept);
  EXPECT_FALSE(kept->how.is_accepted);
  EXPECT_THAT(kept->how.refusal, HasSubstr("votes agree at 0 and 0 points"));
}

TEST(Reconstruction, RefusesWhatCannotBe) {
  const Rig& rig = small_scan().rig;
  const auto refused = [&](const Volume& volume, int level, const Options& options,
                           const std::string& words) {
    const auto made = Reconstruction::make(rig, volume, level, options);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, Code::invalid);
    EXPECT_THAT(made.error().what, HasSubstr(words));
  };
  refused(kVolume, 3, {}, "level is 3, allowed 4 to 11");
  refused(kVolume, 12, {}, "level is 12, allowed 4 to 11");
  refused(Volume{{0, 0, 0}, 0}, 7, {}, "edge");
  refused(Volume{{0, 0, 0}, -5}, 7, {}, "edge");
  refused(Volume{{0, std::nan(""), 0}, 50}, 7, {}, "finite");
  Options options;
  options.vote.bandwidth_rad = 0;
  refused(kVolume, 7, options, "vote.bandwidth_rad is 0 rad, allowed above 0 to 0.5 rad");
  options = {};
  options.surface.lambda = std::nan("");
  refused(kVolume, 7, options, "surface.lambda");
  options = {};
  options.depth.min_votes = 2;
  refused(kVolume, 7, options, "depth.min_votes is 2, allowed 3 to 100");
  options = {};
  options.refine.camera_px = 0;
  refused(kVolume, 7, options, "refine.camera_px is 0 px, allowed above 0 to 100 px");
  options = {};
  options.adapt.adaptions = 11;
  refused(kVolume, 7, options, "adapt.adaptions is 11, allowed 1 to 10");
}

TEST(Reconstruction, ALightMapThatDoesNotFitLeavesTheRestAlone) {
  const SmallScan& scan = small_scan();
  Reconstruction reconstruction =
      with_maps(scan.rig, {scan.maps.begin(), scan.maps.begin() + 60}, 6);
  EXPECT_EQ(reconstruction.add(scan.maps[3]).error().code, Code::conflict);
  LightMap alien = scan.maps[70];
  alien.key.camera = "nobody";
  EXPECT_EQ(reconstruction.add(alien).error().code, Code::invalid);
  const auto result = reconstruction.finish(kNobody);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->light_maps, 60u);
}

}  // namespace
}  // namespace alhazen
