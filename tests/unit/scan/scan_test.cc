#include "reconstruct/scan/scan.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "reconstruct/scan/image_file.h"
#include "reconstruct/scan/light_map_file.h"
#include "reconstruct/scan/safe_file.h"
#include "tests/support/file_size_limit.h"
#include "tests/unit/scan/small_scan.h"
#include "tests/unit/scan/temporary_folder.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

Rig small_rig() {
  Rig rig;
  for (const char* name : {"left", "right"}) {
    CameraModel camera;
    camera.name = name;
    camera.width_px = 20;
    camera.height_px = 20;
    camera.fx_px = camera.fy_px = 30;
    rig.cameras.push_back(camera);
  }
  for (const char* name : {"north", "below"}) {
    DisplayModel display;
    display.name = name;
    display.width_px = 8;
    display.height_px = 4;
    rig.displays.push_back(display);
  }
  return rig;
}

class ScanDirectory : public testing::Test {
 protected:
  [[nodiscard]] Scan make() const { return *Scan::create(path_, small_manifest(), small_rig()); }
  TemporaryFolder folder_;
  const fs::path path_ = folder_.path() / "bunny-1";
};

TEST_F(ScanDirectory, HoldsWhatItWasMadeWith) {
  const Scan made = make();
  const Scan scan = *Scan::open(path_);
  EXPECT_EQ(scan.manifest().to_json(), small_manifest().to_json());
  EXPECT_EQ(scan.rig().to_json(), small_rig().to_json());
  EXPECT_TRUE(scan.light_maps()->empty());
  EXPECT_TRUE(scan.frame_log()->records.empty());
  // Nothing of the making is left beside it.
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()), 1);
}

TEST_F(ScanDirectory, IsMadeOnce) {
  const Scan scan = make();
  EXPECT_EQ(Scan::create(path_, small_manifest(), small_rig()).error().code, Code::conflict);
  EXPECT_EQ(Scan::create(path_ / "", small_manifest(), small_rig()).error().code, Code::conflict);
  Manifest wrong = small_manifest();
  wrong.level = 99;
  EXPECT_EQ(Scan::create(folder_.path() / "x", wrong, small_rig()).error().code, Code::invalid);
  EXPECT_FALSE(fs::exists(folder_.path() / "x"));
  EXPECT_EQ(Scan::open(folder_.path() / "y").error().code, Code::unavailable);
}

TEST_F(ScanDirectory, KeepsLightMapsAndWhereTheyCameFrom) {
  Scan scan = make();
  const std::vector<StackKey> keys = {
      {0, "north", "right"}, {1, "below", "left"}, {1, "north", "left"}};
  const std::vector<FrameRecord> records = {small_record(1), small_record(2)};
  for (auto key = keys.rbegin(); key != keys.rend(); ++key) {
    ASSERT_TRUE(scan.commit(small_light_map(*key), records));
  }
  const Scan again = *Scan::open(path_);
  EXPECT_EQ(*again.light_maps(), keys);
  EXPECT_EQ(again.frame_log()->records.size(), 6U);
  EXPECT_EQ(again.load_light_map(keys[1])->key, keys[1]);
  EXPECT_EQ(again.load_light_map({0, "north", "left"}).error().code, Code::unavailable);
}

TEST_F(ScanDirectory, ATornLogIsCutWhenItIsOpened) {
  Scan scan = make();
  ASSERT_TRUE(scan.commit(small_light_map({0, "north", "left"}), {{small_record(1)}}));
  const auto size = fs::file_size(path_ / "frames.jsonl");
  std::ofstream(path_ / "frames.jsonl", std::ios::app) << "{\"step\":2,\"cam";
  ASSERT_TRUE(Scan::open(path_));
  EXPECT_EQ(fs::file_size(path_ / "frames.jsonl"), size);
}

TEST_F(ScanDirectory, AMapUnderAWrongNameIsCorrupt) {
  Scan scan = make();
  const StackKey north{0, "north", "left"}, below{0, "below", "left"};
  ASSERT_TRUE(scan.commit(small_light_map(north), {}));
  fs::rename(path_ / "light_maps" / light_map_name(north),
             path_ / "light_maps" / light_map_name(below));
  const auto map = scan.load_light_map(below);
  ASSERT_FALSE(map);
  EXPECT_EQ(map.error().code, Code::corrupt);
}

TEST_F(ScanDirectory, StrangeFilesAreNoLightMaps) {
  const Scan scan = make();
  for (const char* name : {".000_north_left.exr.partial", "000_north_left.exr.bak",
                           "002_north_left.exr", "000_west_left.exr", "notes.txt"}) {
    std::ofstream(path_ / "light_maps" / name) << "x";
  }
  EXPECT_TRUE(scan.light_maps()->empty());
}

TEST_F(ScanDirectory, StoresFramesAsTheyAre) {
  Scan scan = make();
  std::vector<std::uint16_t> deep(12);
  for (std::size_t i = 0; i < deep.size(); ++i)
    deep[i] = static_cast<std::uint16_t>(4095 - i * 300);
  const Image image_16 = Image::copy<std::uint16_t>(4, 3, 12, deep);
  const Image image_8 = Image::copy<std::uint8_t>(4, 3, 8, std::vector<std::uint8_t>(12, 77));
  FrameRecord record = small_record(3);
  const std::string name = *scan.store_frame(record, image_16);
  EXPECT_EQ(name, "frames/001_north_left_004_try2.png");
  record.attempt = 1;
  record.pattern = 5;
  const std::string other = *scan.store_frame(record, image_8);
  const Image back_16 = *read_image(path_ / name, 12);
  EXPECT_EQ(back_16.bits(), 12);
  EXPECT_EQ(checksum(back_16), checksum(image_16));
  const Image back_8 = *read_image(path_ / other);
  EXPECT_EQ(back_8.format(), PixelFormat::mono8);
  EXPECT_EQ(checksum(back_8), checksum(image_8));
  EXPECT_NE(checksum(back_8), checksum(back_16));
}

TEST_F(ScanDirectory, PicturesThatAreNone) {
  std::ofstream(folder_.path() / "x.png") << "GIF89a?";
  std::ofstream(folder_.path() / "empty.png").flush();
  EXPECT_EQ(read_image(folder_.path() / "x.png").error().code, Code::corrupt);
  EXPECT_EQ(read_image(folder_.path() / "empty.png").error().code, Code::corrupt);
  EXPECT_EQ(read_image(folder_.path() / "none.png").error().code, Code::unavailable);
  EXPECT_EQ(read_image(folder_.path() / "none.png", 7).error().code, Code::invalid);
  EXPECT_EQ(write_image(Image(), folder_.path() / "y.png").error().code, Code::invalid);
}

TEST_F(ScanDirectory, AFailedAppendLeavesNothing) {
  const fs::path file = folder_.path() / "frames.jsonl";
  ASSERT_TRUE(append_to_file(file, "one\n"));
  {
    const FileSizeLimit limit(6);  // room for half of it
    EXPECT_EQ(append_to_file(file, "two\n").error().code, Code::exhausted);
  }
  ASSERT_TRUE(append_to_file(file, "two\n"));
  EXPECT_EQ(*read_file(file, 100), "one\ntwo\n");
}

TEST_F(ScanDirectory, SafeFilesAreWholeOrNot) {
  const fs::path file = folder_.path() / "a.json";
  ASSERT_TRUE(write_file_safely(file, "one"));
  ASSERT_TRUE(write_file_safely(file, "two, longer"));
  EXPECT_EQ(*read_file(file, 100), "two, longer");
  EXPECT_EQ(read_file(file, 5).error().code, Code::invalid);
  ASSERT_TRUE(append_to_file(file, "!"));
  ASSERT_TRUE(cut_file(file, 3));
  EXPECT_EQ(*read_file(file, 100), "two");
  EXPECT_EQ(write_file_safely(folder_.path() / "no" / "b", "x").error().code, Code::unavailable);
  EXPECT_EQ(write_file_safely(folder_.path(), "x").error().code, Code::unavailable);
  EXPECT_EQ(write_file_safely("/dev/full/x", "x").error().code, Code::unavailable);
  EXPECT_EQ(append_to_file("/dev/full", "x").error().code, Code::exhausted);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()), 1);
}

}  // namespace
}  // namespace alhazen
