#include "reconstruct/exchange/import.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sys/wait.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <tuple>

#include "reconstruct/exchange/camera_files.h"
#include "reconstruct/mesh_io/mesh_file.h"
#include "reconstruct/pattern/draw.h"
#include "reconstruct/reconstruct.h"
#include "reconstruct/scan/shortcomings.h"
#include "tests/support/analytic.h"
#include "tests/support/nobody.h"
#include "tests/unit/scan/temporary_folder.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const analytic::Sphere kSphere{{1, -0.5, 50}, 25};

/// Pictures of a mirroring sphere as a camera would have taken them, and their table, on disk: what
/// somebody else's software leaves behind.
class Recording {
 public:
  Recording(const analytic::RigSize& size, int stops) : rig_(analytic::make_rig(size)) {
    // Displays of fewer, larger pixels, so that fewer pictures tell them apart.
    for (DisplayModel& display : rig_.displays) {
      constexpr int kCoarser = 8;
      display.origin_mm += (kCoarser - 1) / 2.0 * (display.u_mm + display.v_mm);
      display.u_mm *= kCoarser;
      display.v_mm *= kCoarser;
      display.width_px /= kCoarser;
      display.height_px /= kCoarser;
    }
    table_ = "file,camera,display,stop,angle_deg,exposure_us,kind,axis,bit,inverted\n";
    fs::create_directories(folder() / "pictures");
    for (int stop = 0; stop < stops; ++stop) {
      const double angle_rad = 2 * std::numbers::pi * stop / stops;
      for (const DisplayModel& display : rig_.displays) {
        for (const CameraModel& camera : rig_.cameras) {
          photograph(display, analytic::light_map(rig_, kSphere, {stop, display.name, camera.name},
                                                  angle_rad, {}));
        }
      }
    }
    write(table_);
  }

  [[nodiscard]] const Rig& rig() const { return rig_; }
  [[nodiscard]] fs::path folder() const { return folder_.path(); }
  [[nodiscard]] fs::path table() const { return folder() / "frames.csv"; }
  [[nodiscard]] const std::string& text() const { return table_; }
  void write(const std::string& table) const { std::ofstream(this->table()) << table; }

 private:
  /// One picture for each pattern: each pixel shows the display pixel that it sees.
  void photograph(const DisplayModel& display, const LightMap& map) {
    const auto sequence = make_sequence(Coding::gray, display.width_px, display.height_px);
    for (std::size_t k = 0; k < sequence->size(); ++k) {
      const Pattern& pattern = (*sequence)[k];
      const Picture shown = *draw(pattern, display.width_px, display.height_px);
      std::vector<std::uint8_t> pixels(map.size_px(), 12);  // a dark room
      for (std::size_t i = 0; i < pixels.size(); ++i) {
        if (!map.is_position(i)) continue;
        const auto u = static_cast<std::size_t>(std::lround(map.u_px[i]));
        const auto v = static_cast<std::size_t>(std::lround(map.v_px[i]));
        const std::uint8_t light =
            shown.image.mono8()[v * static_cast<std::size_t>(display.width_px) + u];
        pixels[i] = light > 127 ? 210 : 20;
      }
      const std::string file = "pictures/" + std::to_string(map.key.stop) + display.name +
                               map.key.camera + std::to_string(k) + ".png";
      // Not by write_image(), which waits for the disk after every one.
      const cv::Mat view(map.region.height, map.region.width, CV_8UC1, pixels.data());
      ASSERT_TRUE(cv::imwrite((folder() / file).string(), view));
      const bool is_gray = pattern.kind == PatternKind::gray;
      table_ +=
          file + "," + map.key.camera + "," + display.name + "," + std::to_string(map.key.stop) +
          "," + std::to_string(map.angle_rad * 180 / std::numbers::pi) + ",2000," +
          (is_gray                              ? "gray,"
           : pattern.kind == PatternKind::white ? "white,"
                                                : "black,") +
          (is_gray ? (pattern.axis == Axis::u ? "u," : "v,") : "-,") +
          (is_gray ? std::to_string(pattern.bit) + "," + (pattern.inverted ? "1" : "0") : ",") +
          "\n";
    }
  }

  TemporaryFolder folder_;
  Rig rig_;
  std::string table_;
};

ImportOptions some_options() {
  ImportOptions options;
  options.created_at = "2026-11-22T10:00:00Z";
  options.object_id = "ball";
  options.software_version = "test";
  options.level = 6;
  return options;
}

const Recording& tiny() {
  static const Recording recording(
      {.cameras = 2, .pixel_mm = 4, .sensor_px = 20, .has_above = false}, 3);
  return recording;
}

Result<Imported> import_of(const Recording& recording, const fs::path& scan,
                           const ImportOptions& options = some_options()) {
  return import_scan(recording.rig(), recording.table(), scan, {recording.folder(), 0, {}}, options,
                     kNobody);
}

TEST(Import, FromPicturesToAMesh) {
  const Recording recording({.cameras = 5, .pixel_mm = 1.0, .sensor_px = 64}, 6);
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "My Scan_1";
  const auto imported = import_of(recording, path);
  ASSERT_TRUE(imported) << imported.error().text();
  EXPECT_EQ(imported->light_maps, 5U * 6 * 3);
  EXPECT_EQ(imported->decoded, imported->light_maps);
  EXPECT_THAT(imported->warnings, IsEmpty());

  const Scan scan = *Scan::open(path);
  EXPECT_EQ(scan.manifest().scan_id, "my-scan-1");
  EXPECT_EQ(scan.manifest().stops.size(), 6U);
  EXPECT_NEAR(scan.manifest().stops[2].wanted_rad, 2 * std::numbers::pi / 3, 1e-6);
  EXPECT_EQ(scan.manifest().cameras[0].settings.exposure, Micros(2000));
  EXPECT_EQ(scan.rig().hash(), recording.rig().hash());
  const std::vector<StackKey> keys = *scan.light_maps();
  EXPECT_THAT(shortcomings(scan, keys), IsEmpty());
  const FrameLog log = *scan.frame_log();
  EXPECT_EQ(log.records.size(),
            static_cast<std::size_t>(std::ranges::count(recording.text(), '\n')) - 1);
  const FrameRecord& record = log.records[100];
  const PlannedDisplay& shown = scan.manifest().displays[0];
  EXPECT_LT(record.pattern, static_cast<int>(shown.patterns.size()));
  EXPECT_FALSE(record.file);

  // What was decoded is the display pixel that was seen.
  const DisplayModel& display = recording.rig().displays[0];
  const StackKey key{1, display.name, "c03"};
  const LightMap truth =
      analytic::light_map(recording.rig(), kSphere, key, std::numbers::pi / 3, {});
  const LightMap map = *scan.load_light_map(key);
  std::size_t positions = 0;
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    ASSERT_EQ(map.is_position(i), truth.is_position(i));
    if (!map.is_position(i)) continue;
    ++positions;
    EXPECT_LE(std::abs(map.u_px[i] - truth.u_px[i]), 0.501F);
    EXPECT_LE(std::abs(map.v_px[i] - truth.v_px[i]), 0.501F);
  }
  EXPECT_GT(positions, 50U);

  Reconstruction reconstruction = *Reconstruction::make(scan.rig(), scan.manifest().volume, 6, {});
  for (const StackKey& each : keys) ASSERT_TRUE(reconstruction.add(*scan.load_light_map(each)));
  const auto made = reconstruction.finish(kNobody);
  ASSERT_TRUE(made) << made.error().text();
  EXPECT_THAT(made->warnings, IsEmpty());
  std::vector<double> errors;
  for (std::size_t i = 0; i < made->mesh.vertices_mm.size(); ++i) {
    if (made->mesh.observed[i] != 0)
      errors.push_back(std::abs(analytic::distance_mm(kSphere, made->mesh.vertices_mm[i])));
  }
  ASSERT_GT(errors.size(), 80U);
  std::ranges::sort(errors);
  // Display pixels of 2.2 mm half a metre away, camera pixels of 1 mm, 90 light maps.
  EXPECT_LT(errors[errors.size() / 2], 0.1);
  EXPECT_LT(errors[errors.size() * 9 / 10], 0.4);
}

/// The same by the commands, to what others' software opens.
TEST(Import, TheCommandsDoIt) {
#if defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the program uses TBB, which the thread sanitizer cannot see into";
#endif
  const Recording recording({.cameras = 4, .pixel_mm = 1.25, .sensor_px = 48}, 6);
  const TemporaryFolder folder;
  const fs::path scan = folder.path() / "ball", rig = folder.path() / "rig.json";
  std::ofstream(rig) << recording.rig().to_json();
  const auto command = [&](const std::string& arguments) {
    const std::string line = "'" ALHAZEN_BINARY_DIR "/bin/alhazen-reconstruct' --quiet " +
                             arguments + " >'" + (folder.path() / "out").string() + "' 2>&1";
    const int code = std::system(line.c_str());  // NOLINT(cert-env33-c): the program under test
    std::ifstream out(folder.path() / "out");
    return std::pair(WEXITSTATUS(code), std::string(std::istreambuf_iterator<char>(out), {}));
  };
  const std::string to_scan = " --rig " + rig.string() + " --frames " + recording.table().string() +
                              " --out " + scan.string();
  auto [code, said] = command("import --level 6" + to_scan);
  ASSERT_EQ(code, 0) << said;
  EXPECT_THAT(said, HasSubstr("\"light_maps\":72,\"decoded\":72,\"warnings\":[]"));
  std::tie(code, said) = command("run --field " + scan.string());
  ASSERT_EQ(code, 0) << said;
  for (const char* file : {"mesh.ply", "report.json", "report.html", "field.vtu"})
    EXPECT_TRUE(fs::exists(scan / file)) << file;
  std::tie(code, said) = command("export --format obj --format stl " + scan.string());
  ASSERT_EQ(code, 0) << said;
  EXPECT_EQ(read_mesh(scan / "export/mesh.obj")->triangles,
            read_mesh(scan / "mesh.ply")->triangles);
  EXPECT_TRUE(read_mesh(scan / "export/mesh.stl"));
  const auto views = read_cameras((scan / "export/colmap").string(), 1);
  ASSERT_TRUE(views) << views.error().text();
  ASSERT_EQ(views->size(), 4U * 6);
  // A point of the object is seen where the rig says: stop 2, camera c02.
  const ForeignCamera& view = (*views)[2 * 4 + 1];
  EXPECT_EQ(view.model.name, "002_c02");
  const Eigen::Vector3d p(10, -20, 60);
  const CameraModel& camera = recording.rig().cameras[1];
  const Pose turned = recording.rig().turntable.rig_from_object(2 * std::numbers::pi / 3);
  EXPECT_LT((*view.model.project(view.model.camera_from_rig * p) -
             *camera.project(camera.camera_from_rig * (turned * p)))
                .norm(),
            1e-4);

  // A rig of camera files, and back again.
  const fs::path cameras = folder.path() / "cameras", again = folder.path() / "again.json";
  std::tie(code, said) = command("rig --rig " + rig.string() + " --out " + cameras.string());
  ASSERT_EQ(code, 0) << said;
  std::tie(code, said) = command("rig --rig " + rig.string() + " --cameras " + cameras.string() +
                                 " --out " + again.string());
  ASSERT_EQ(code, 0) << said;
  const Rig there_and_back = *Rig::load(again);
  for (std::size_t i = 0; i < there_and_back.cameras.size(); ++i) {
    EXPECT_NEAR(there_and_back.cameras[i].cx_px, recording.rig().cameras[i].cx_px, 1e-11);
    EXPECT_LT((there_and_back.cameras[i].camera_from_rig.rotation -
               recording.rig().cameras[i].camera_from_rig.rotation)
                  .norm(),
              1e-14);
  }
  std::tie(code, said) = command("import" + to_scan + " --rig /nowhere.json");
  EXPECT_EQ(code, 64) << said;
}

TEST(Import, IsGoneOnWithAndOtherwiseRefused) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "scan";
  ASSERT_TRUE(import_of(tiny(), path));
  const std::vector<StackKey> keys = *Scan::open(path)->light_maps();
  fs::remove(path / "light_maps" / "001_side_c01.exr");
  const auto again = import_of(tiny(), path);
  ASSERT_TRUE(again) << again.error().text();
  EXPECT_EQ(again->decoded, 1U);
  EXPECT_EQ(*Scan::open(path)->light_maps(), keys);

  ImportOptions other = some_options();
  other.level = 7;
  const auto refused = import_of(tiny(), path, other);
  EXPECT_EQ(refused.error().code, Code::conflict);
  fs::create_directories(folder.path() / "occupied");
  EXPECT_EQ(import_of(tiny(), folder.path() / "occupied").error().code, Code::conflict);
}

/// A table with one thing changed.
class Edited {
 public:
  Edited(const std::string& from, const std::string& to, bool every = false)
      : table_(tiny().folder() / ("edited_" + std::to_string(++count_) + ".csv")) {
    std::string text = tiny().text();
    std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    do {
      text.replace(at, from.size(), to);
      at = text.find(from, at + to.size());
    } while (every && at != std::string::npos);
    std::ofstream(table_) << text;
  }
  [[nodiscard]] Result<Imported> import_to(const fs::path& scan,
                                           const ImportOptions& options = some_options()) const {
    return import_scan(tiny().rig(), table_, scan, {tiny().folder(), 0, {}}, options, kNobody);
  }

 private:
  static inline int count_ = 0;
  fs::path table_;
};

TEST(Import, BadTablesAreRefusedBeforeAnythingIsDecoded) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "scan";
  const auto expect = [&](const Edited& edited, Code code, const std::string& words) {
    const auto imported = edited.import_to(path);
    ASSERT_FALSE(imported) << words;
    EXPECT_EQ(imported.error().code, code);
    EXPECT_THAT(imported.error().text(), HasSubstr(words));
    EXPECT_FALSE(fs::exists(path));
  };
  expect({",c01,side,1,", ",left,side,1,", true}, Code::invalid,
         "the rig has no camera 'left'; it has c01, c02");
  expect({",c01,side,1,", ",c01,north,1,", true}, Code::invalid,
         "the rig has no display 'north'; it has side, below");
  expect({"pictures/1sidec013.png", "pictures/none.png"}, Code::unavailable, "none.png");
  expect({",c01,side,1,120.000000", ",c01,side,1,60", true}, Code::invalid, "a stop is one angle");
}

TEST(Import, PicturesOfAnotherSizeAreRefusedNamingBoth) {
  const TemporaryFolder folder;
  Rig rig = tiny().rig();
  rig.cameras[1].width_px = 40;
  const auto imported = import_scan(rig, tiny().table(), folder.path() / "scan",
                                    {tiny().folder(), 0, {}}, some_options(), kNobody);
  ASSERT_FALSE(imported);
  EXPECT_EQ(imported.error().code, Code::invalid);
  EXPECT_THAT(imported.error().text(),
              HasSubstr("a picture of 20 x 20 px, but the rig's camera 'c02' has 40 x 20 px"));
  EXPECT_FALSE(fs::exists(folder.path() / "scan"));
}

TEST(Import, DamagedPicturesEndItOrAreLeftOut) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "scan";
  std::ofstream(tiny().folder() / "torn.png") << "\x89PNG";
  const Edited edited("pictures/1sidec013.png", "torn.png");
  const auto ended = edited.import_to(path);
  ASSERT_FALSE(ended);
  EXPECT_EQ(ended.error().code, Code::corrupt);
  EXPECT_THAT(ended.error().text(), HasSubstr("stop 1, display side, camera c01"));
  EXPECT_THAT(ended.error().text(), HasSubstr("torn.png"));
  ImportOptions options = some_options();
  options.leaves_out_bad = true;
  const auto imported = edited.import_to(path, options);
  ASSERT_TRUE(imported) << imported.error().text();
  EXPECT_THAT(imported->warnings, ElementsAre(HasSubstr("torn.png")));
  EXPECT_EQ(imported->light_maps, 3U * 2 * 2 - 1);
  const Scan scan = *Scan::open(path);
  EXPECT_THAT(shortcomings(scan, *scan.light_maps()),
              ElementsAre("1 of 12 light maps are missing: stop 1 display side camera c01"));
}

TEST(Import, StopsAreNumberedAnew) {
  const TemporaryFolder folder;
  std::string text;
  for (std::size_t at = 0; at < tiny().text().size();) {
    const std::size_t end = tiny().text().find('\n', at) + 1;
    std::string line = tiny().text().substr(at, end - at);
    at = end;
    for (const char* camera : {",c01,", ",c02,"}) {
      for (const char* display : {"side,", "below,"}) {
        const std::string key = std::string(camera) + display;
        const std::size_t found = line.find(key + "2,");
        if (found != std::string::npos) line.replace(found + key.size(), 1, "5");
      }
    }
    text += line;
  }
  const fs::path table = tiny().folder() / "gaps.csv";
  std::ofstream(table) << text;
  const auto imported = import_scan(tiny().rig(), table, folder.path() / "scan",
                                    {tiny().folder(), 0, {}}, some_options(), kNobody);
  ASSERT_TRUE(imported) << imported.error().text();
  EXPECT_THAT(imported->warnings, ElementsAre(HasSubstr("lacks stop 2 to 4")));
  EXPECT_EQ(Scan::open(folder.path() / "scan")->light_maps()->size(), 12U);
}

TEST(Import, DevicesWithoutPicturesAreNamed) {
  const TemporaryFolder folder;
  Rig rig = tiny().rig();
  CameraModel third = rig.cameras[0];
  third.name = "c03";
  rig.cameras.push_back(third);
  const auto imported = import_scan(rig, tiny().table(), folder.path() / "scan",
                                    {tiny().folder(), 0, {}}, some_options(), kNobody);
  ASSERT_TRUE(imported) << imported.error().text();
  EXPECT_THAT(imported->warnings, ElementsAre(HasSubstr("no picture of the rig's camera 'c03'")));
}

TEST(Import, StopsWhenAsked) {
  const TemporaryFolder folder;
  std::stop_source source;
  source.request_stop();
  const auto imported =
      import_scan(tiny().rig(), tiny().table(), folder.path() / "scan", {tiny().folder(), 0, {}},
                  some_options(), {source.get_token(), {}});
  EXPECT_EQ(imported.error().code, Code::cancelled);
}

}  // namespace
}  // namespace alhazen
