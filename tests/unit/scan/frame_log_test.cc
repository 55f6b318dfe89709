#include "reconstruct/scan/frame_log.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/unit/scan/small_scan.h"

namespace alhazen {
namespace {

TEST(FrameLog, RecordsComeBackAsTheyWere) {
  FrameRecord record = small_record(7);
  record.file = "frames/001_north_left_004_try2.png";
  for (int round = 0; round < 2; ++round) {
    const FrameRecord back = *parse_frame_record(to_line(record));
    EXPECT_EQ(to_line(back), to_line(record));
    EXPECT_EQ(back.angle_rad, record.angle_rad);
    EXPECT_EQ(back.device_counter, record.device_counter);
    EXPECT_EQ(back.file, record.file);
    EXPECT_EQ(back.settings, record.settings);
    record.file.reset();
  }
}

TEST(FrameLog, ATornLastLineIsCutOff) {
  std::string whole;
  for (std::uint64_t step = 0; step < 3; ++step) whole += to_line(small_record(step)) + "\n";
  const std::size_t line = whole.size() / 3;
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    const FrameLog log = *parse_frame_log(std::string_view(whole).substr(0, size));
    ASSERT_EQ(log.records.size(), size / line);
    ASSERT_EQ(log.valid_bytes, size / line * line);
  }
}

TEST(FrameLog, ADamagedLastLineIsCutOffAnEarlierOneIsNot) {
  const std::string good = to_line(small_record(0)) + "\n";
  EXPECT_EQ(parse_frame_log(good + "{\"step\":\n")->valid_bytes, good.size());
  EXPECT_EQ(parse_frame_log(good + "\n")->valid_bytes, good.size());
  const auto log = parse_frame_log(good + "{\"step\":1}\n" + good);
  ASSERT_FALSE(log);
  EXPECT_EQ(log.error().text(), "corrupt: key 'camera' is missing (line 2)");
}

TEST(FrameLog, EveryComplaintNamesTheKey) {
  const std::string good = to_line(small_record(1));
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return parse_frame_record(text.replace(at, from.size(), to));
  };
  for (const auto& [from, to, key] : {std::tuple{"\"step\":1", "\"step\":-1", "step"},
                                      {"\"stop\":1", "\"stop\":1e3", "stop"},
                                      {"\"pattern\":4", "\"pattern\":99999999999", "pattern"},
                                      {"\"attempt\":2", "\"attempt\":0", "attempt"},
                                      {"[5,7,4,3]", "[5,7,4]", "region"},
                                      {"[5,7,4,3]", "[5,7,4,70000]", "region"},
                                      {"\"00ff00ff00ff00ff\"", "\"00ff\"", "checksum"},
                                      {"\"00ff00ff00ff00ff\"", "\"00FF00ff00ff00ff\"", "checksum"},
                                      {"\"file\":null", "\"file\":\"/etc/passwd\"", "file"},
                                      {"\"file\":null", "\"file\":\"frames/../../x\"", "file"},
                                      {"\"file\":null", "\"file\":\"a\\u0000b\"", "file"},
                                      {"\"camera\":\"left\"", "\"camera\":[]", "camera"},
                                      {"\"file\":null", "\"file\":null,\"more\":1", "more"}}) {
    const auto record = with(from, to);
    ASSERT_FALSE(record) << to;
    EXPECT_EQ(record.error().code, Code::corrupt);
    EXPECT_NE(record.error().what.find("key '" + std::string(key) + "'"), std::string::npos)
        << record.error().what;
  }
  EXPECT_FALSE(parse_frame_record("[]"));
  EXPECT_FALSE(parse_frame_record(""));
}

}  // namespace
}  // namespace alhazen
