#include "reconstruct/scan/light_map_file.h"

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#include "reconstruct/scan/safe_file.h"
#include "tests/unit/scan/small_scan.h"
#include "tests/unit/scan/temporary_folder.h"

namespace alhazen {
namespace {

const StackKey kKey{1, "north", "left"};

template <class T>
bool same(const PixelList<T>& a, const PixelList<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

bool same(const LightMap& a, const LightMap& b) {
  return a.key == b.key && a.angle_rad == b.angle_rad && a.region == b.region &&
         same(a.u_px, b.u_px) && same(a.v_px, b.v_px) && same(a.sigma_u_px, b.sigma_u_px) &&
         same(a.sigma_v_px, b.sigma_v_px) && same(a.contrast, b.contrast) &&
         same(a.label, b.label) && same(a.bit_u, b.bit_u) && same(a.bit_v, b.bit_v);
}

class LightMapFile : public testing::Test {
 protected:
  [[nodiscard]] std::string bytes_of(const LightMap& map) const {
    EXPECT_TRUE(write_light_map(map, file_));
    return *read_file(file_, 1 << 20);
  }
  TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_.path() / "map.exr";
};

TEST_F(LightMapFile, ComesBackAsItWas) {
  LightMap map = small_light_map(kKey);
  ASSERT_TRUE(write_light_map(map, file_));
  EXPECT_TRUE(same(*read_light_map(file_), map));
  EXPECT_FALSE(std::filesystem::exists(aside(file_)));

  // More rows than are converted at once.
  map.region = {0, 65535 - 150, 1, 150};
  for (auto* list : {&map.u_px, &map.v_px}) list->assign(150, 1.5F);
  for (auto* list : {&map.sigma_u_px, &map.sigma_v_px}) list->assign(150, Imath::half(1.5F));
  map.contrast.resize(150);
  for (std::size_t i = 0; i < 150; ++i) map.contrast[i] = static_cast<std::uint8_t>(255 - i);
  map.label.assign(150, Label::mirror);
  map.bit_u.assign(150, 3);
  map.bit_v.resize(150);
  for (std::size_t i = 0; i < 150; ++i) map.bit_v[i] = static_cast<std::uint8_t>(i % 15);
  ASSERT_TRUE(write_light_map(map, file_));
  EXPECT_TRUE(same(*read_light_map(file_), map));
}

TEST(LightMap, IsCroppedToWhatItSays) {
  LightMap map;
  map.key = kKey;
  map.angle_rad = 0.25;
  map.region = {10, 20, 7, 5};
  map.resize_lists();
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    map.label[i] = Label::none;
    map.u_px[i] = static_cast<float>(i);
    map.bit_v[i] = static_cast<std::uint8_t>(i);
  }
  const LightMap nothing = cropped(map);
  EXPECT_EQ(nothing.region, (Region{10, 20, 1, 1}));
  EXPECT_EQ(nothing.label[0], Label::none);

  map.label[1 * 7 + 4] = Label::mixed;
  map.label[3 * 7 + 2] = Label::mirror;
  const LightMap some = cropped(map);
  EXPECT_EQ(some.key, kKey);
  EXPECT_EQ(some.angle_rad, 0.25);
  EXPECT_EQ(some.region, (Region{12, 21, 3, 3}));
  ASSERT_TRUE(some.has_whole_lists());
  for (int y = 0; y < 3; ++y) {
    for (int x = 0; x < 3; ++x) {
      const auto to = static_cast<std::size_t>(3 * y + x);
      const auto from = static_cast<std::size_t>(7 * (y + 1) + x + 2);
      EXPECT_EQ(some.u_px[to], map.u_px[from]);
      EXPECT_EQ(some.bit_v[to], map.bit_v[from]);
      EXPECT_EQ(some.label[to], map.label[from]);
    }
  }
}

TEST_F(LightMapFile, AnyBeginningOfItIsCorrupt) {
  const std::string bytes = bytes_of(small_light_map(kKey));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    const auto map = parse_light_map(std::string_view(bytes).substr(0, size));
    ASSERT_FALSE(map) << size << " of " << bytes.size();
    ASSERT_EQ(map.error().code, Code::corrupt) << map.error().text();
  }
}

TEST_F(LightMapFile, AFlippedBitIsCorruptOrChangesNothing) {
  const LightMap good = small_light_map(kKey);
  std::string bytes = bytes_of(good);
  std::size_t harmless = 0;
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << (bit % 8)));
    const auto map = parse_light_map(bytes);
    if (map) {
      ASSERT_TRUE(same(*map, good)) << "bit " << bit % 8 << " of byte " << bit / 8;
      ++harmless;
    } else {
      ASSERT_EQ(map.error().code, Code::corrupt) << map.error().text();
    }
    bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << (bit % 8)));
  }
  // Attributes that OpenEXR demands and we do not use, such as the pixel's aspect ratio.
  EXPECT_LT(harmless, 8 * 300U);
}

TEST_F(LightMapFile, HugeClaimsAreNotBelieved) {
  // A data window of 65536 × 65536 would take 128 GB; the file holds 12 pixels.
  std::string bytes = bytes_of(small_light_map(kKey));
  const std::size_t window = bytes.find("dataWindow");
  ASSERT_NE(window, std::string::npos);
  const std::size_t values = window + std::strlen("dataWindow") + 1 + std::strlen("box2i") + 1 + 4;
  for (const std::int32_t side : {65535, 65536, std::numeric_limits<std::int32_t>::max()}) {
    const std::int32_t box[4] = {0, 0, side, side};
    std::memcpy(bytes.data() + values, box, sizeof box);
    const auto map = parse_light_map(bytes);
    ASSERT_FALSE(map);
    EXPECT_EQ(map.error().code, Code::corrupt);
  }
}

TEST_F(LightMapFile, WhatIsNoPositionIsNotWritten) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinite = std::numeric_limits<float>::infinity();
  const LightMap good = small_light_map(kKey);
  ASSERT_EQ(good.label[1], Label::mirror);
  const auto refused = [&](auto&& change, const char* channel) {
    LightMap map = good;
    change(map);
    const Status status = write_light_map(map, file_);
    ASSERT_FALSE(status) << channel;
    EXPECT_NE(status.error().what.find(channel), std::string::npos) << status.error().what;
  };
  refused([](LightMap& map) { map.u_px[1] = kNan; }, "channel 'u'");
  refused([](LightMap& map) { map.v_px[1] = kInfinite; }, "channel 'v'");
  refused([](LightMap& map) { map.u_px[0] = 1; }, "channel 'u'");
  refused([](LightMap& map) { map.sigma_u_px[1] = 0; }, "channel 'sigma_u_px'");
  refused([](LightMap& map) { map.sigma_v_px[2] = -1; }, "channel 'sigma_v_px'");
  refused([](LightMap& map) { map.contrast.pop_back(); }, "lists");
  refused([](LightMap& map) { map.v_px.pop_back(); }, "lists");
  refused([](LightMap& map) { map.region.width = 0; }, "lists");
  EXPECT_FALSE(std::filesystem::exists(file_));
}

TEST_F(LightMapFile, MissingAndOddFilesAreToldApart) {
  EXPECT_EQ(read_light_map(folder_.path() / "nothing.exr").error().code, Code::unavailable);
  EXPECT_EQ(read_light_map(folder_.path()).error().code, Code::invalid);
  std::ofstream(file_) << "no picture at all";
  EXPECT_EQ(read_light_map(file_).error().code, Code::corrupt);
  const Status nowhere =
      write_light_map(small_light_map(kKey), folder_.path() / "missing" / "map.exr");
  EXPECT_EQ(nowhere.error().code, Code::unavailable);
}

}  // namespace
}  // namespace alhazen
