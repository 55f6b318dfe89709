#include "reconstruct/scan/manifest.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "tests/unit/scan/small_scan.h"

namespace alhazen {
namespace {

using nlohmann::json;

TEST(Manifest, ComesBackAsItWas) {
  Manifest manifest = small_manifest();
  manifest.note = "line 1\nline \"2\" \xC3\xBC";
  manifest.volume.centre_mm = {0.1, -1.0 / 3, 1e-17};
  manifest.stops[1].wanted_rad = 0.1 + 0.2;
  manifest.displays[0].patterns.push_back(
      {.kind = PatternKind::phase, .axis = Axis::v, .period_px = 64, .step = 2, .steps = 5});
  const Manifest back = *Manifest::parse(manifest.to_json());
  EXPECT_EQ(back.to_json(), manifest.to_json());
  EXPECT_EQ(back.note, manifest.note);
  EXPECT_EQ(back.volume.centre_mm, manifest.volume.centre_mm);
  EXPECT_EQ(back.stops[1].wanted_rad, manifest.stops[1].wanted_rad);
  EXPECT_EQ(back.displays[0].patterns, manifest.displays[0].patterns);
  EXPECT_EQ(back.cameras[0].settings, manifest.cameras[0].settings);
}

TEST(Manifest, NotesThatAreNoTextAreMended) {
  Manifest manifest = small_manifest();
  manifest.note = "\xFF\xFE?";
  EXPECT_TRUE(Manifest::parse(manifest.to_json()));
}

struct Wrong {
  const char* pointer;  ///< where
  const char* value;    ///< JSON; nullptr: removed
  const char* message;  ///< what the error must say
};

TEST(Manifest, EveryComplaintNamesKeyAndRange) {
  const Wrong wrongs[] = {
      {"/format", "2", "key 'format' is 2; it must be a whole number in [1, 1]"},
      {"/format", "1.5", "key 'format' is 1.5; it must be a whole number in [1, 1]"},
      {"/format", nullptr, "key 'format' is missing"},
      {"/scan_id", "\"../x\"", "key 'scan_id' is \"../x\"; it must be 1 to 64 of a-z 0-9 -"},
      {"/scan_id", "7", "key 'scan_id' is 7; it must be text of at most 4096 bytes"},
      {"/coding", "\"morse\"", "key 'coding' is \"morse\"; it must be one of gray, gray_phase"},
      {"/keep_frames", "null", "key 'keep_frames' is null; it must be text"},
      {"/volume", "[]", "key 'volume' must be a JSON object"},
      {"/volume/edge_mm", "0", "key 'volume.edge_mm' is 0; it must be a number in [0.001, 1000000"},
      {"/volume/centre_mm/1", "\"x\"", "three numbers in [-1e6, 1e6]"},
      {"/volume/unknown", "1", "unknown key 'volume.unknown'"},
      {"/level", "0", "key 'level' is 0; it must be a whole number in [1, 16]"},
      {"/level", "18446744073709551615", "it must be a whole number in [1, 16]"},
      {"/stops", "[]", "key 'stops' is []; it must be a list of 1 to 100000 entries"},
      {"/stops/1/index", "0", "key 'stops[1].index' is 0; it must be a whole number in [1, 1]"},
      {"/stops/0/wanted_rad", "\"left\"", "key 'stops[0].wanted_rad' is \"left\"; it must be a"},
      {"/displays/0/name", "\"a/b\"", "key 'displays[0].name' is \"a/b\"; it must be 1 to 64 of"},
      {"/displays/0/name", "\"\"", "key 'displays[0].name' is \"\"; it must be 1 to 64 of"},
      {"/displays/0/name", "\".x\"", "not begin with a dot"},
      {"/displays/0/width_px", "1", "it must be a whole number in [2, 16384]"},
      {"/displays/0/height_px", "16385", "it must be a whole number in [2, 16384]"},
      {"/displays/0/patterns/0/kind", "\"red\"", "'displays[0].patterns[0].kind' is \"red\""},
      {"/displays/0/patterns/2/bit", "3", "it must be a whole number in [0, 2]"},
      {"/displays/0/patterns/2/inverted", "1", "it must be true or false"},
      {"/displays/0/patterns/2/axis", "\"w\"", "it must be one of u, v"},
      {"/displays/1/name", "\"north\"", "key 'displays' names 'north' twice"},
      {"/cameras/1/name", "\"left\"", "key 'cameras' names 'left' twice"},
      {"/cameras/0/exposure_us", "0", "key 'cameras[0].exposure_us' is 0; it must be"},
      {"/cameras/0/gain_db", "1e999", "manifest"},
      {"/cameras/0/region/width", "0", "it must be a whole number in [1, 65535]"},
      {"/cameras/0/region/x", "-1", "it must be a whole number in [0, 65535]"},
      {"/cameras/0", "3", "key 'cameras[0]' must be a JSON object"},
      {"/unheard_of", "{}", "unknown key 'unheard_of'"},
  };
  for (const Wrong& wrong : wrongs) {
    SCOPED_TRACE(wrong.pointer);
    json document = json::parse(small_manifest().to_json());
    std::string text;
    if (wrong.value == nullptr) {
      document.erase(std::string(wrong.pointer).substr(1));
      text = document.dump();
    } else {
      document[json::json_pointer(wrong.pointer)] = "@";
      text = document.dump();
      text.replace(text.find("\"@\""), 3, wrong.value);
    }
    const auto manifest = Manifest::parse(text);
    ASSERT_FALSE(manifest);
    EXPECT_EQ(manifest.error().code, Code::invalid);
    EXPECT_NE(manifest.error().what.find(wrong.message), std::string::npos)
        << manifest.error().what;
  }
}

TEST(Manifest, NamesThatMeetInOneFileAreRefused) {
  Manifest manifest = small_manifest();
  manifest.displays[0].name = "a";
  manifest.displays[1].name = "a_b";
  manifest.cameras[0].name = "b_c";
  manifest.cameras[1].name = "c";
  const auto parsed = Manifest::parse(manifest.to_json());
  ASSERT_FALSE(parsed);
  EXPECT_NE(parsed.error().what.find("'a_b_c' twice"), std::string::npos);
}

TEST(Manifest, MoreLightMapsThanAnyoneTakesAreRefused) {
  Manifest manifest = small_manifest();
  manifest.stops.clear();
  for (int i = 0; i < 99'999; ++i) manifest.stops.push_back({i, 0});
  for (int i = 2; i < 6; ++i) {
    manifest.cameras.push_back(manifest.cameras[0]);
    manifest.cameras.back().name += std::to_string(i);
  }
  const auto parsed = Manifest::parse(manifest.to_json());
  ASSERT_FALSE(parsed);
  EXPECT_NE(parsed.error().what.find("at most 1000000"), std::string::npos);
}

TEST(Manifest, AnyBeginningOfItIsInvalidAndNothingWorse) {
  const std::string text = small_manifest().to_json();
  for (std::size_t size = 0; size + 2 < text.size(); ++size) {
    const auto manifest = Manifest::parse(std::string_view(text).substr(0, size));
    ASSERT_FALSE(manifest) << size;
    ASSERT_EQ(manifest.error().code, Code::invalid);
  }
}

}  // namespace
}  // namespace alhazen
