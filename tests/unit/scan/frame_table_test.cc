#include "reconstruct/scan/frame_table.h"

#include <gtest/gtest.h>

#include <numbers>
#include <string>
#include <vector>

namespace alhazen {
namespace {

const std::string kHead =
    "file,camera,display,stop,angle_deg,exposure_us,kind,axis,bit,inverted,period_px,step,steps\n";

TEST(FrameTable, ReadsEveryKind) {
  const auto frames =
      parse_frame_table("\xEF\xBB\xBF" + kHead +
                        "a.png,left,north,3,90,1000,white,-,,,,,\r\n"
                        "\n"
                        "\"b, \"\"c\"\".png\", left ,north,3,90,1000.4,gray,v,9,1,,,\n"
                        "d.png,left,north,3,90,1e3,gray,u,0,false,,,\n"
                        "e.png,left,north,3,90,1000,phase,u,,,64,2,5");
  ASSERT_TRUE(frames) << frames.error().text();
  ASSERT_EQ(frames->size(), 4U);
  EXPECT_EQ((*frames)[0].pattern, Pattern{.kind = PatternKind::white});
  EXPECT_EQ((*frames)[0].key, (StackKey{3, "north", "left"}));
  EXPECT_NEAR((*frames)[0].angle_rad, std::numbers::pi / 2, 1e-15);
  EXPECT_EQ((*frames)[1].file, "b, \"c\".png");
  EXPECT_EQ((*frames)[1].exposure, Micros(1000));
  EXPECT_EQ((*frames)[1].line, 4);
  EXPECT_EQ((*frames)[1].pattern,
            (Pattern{.kind = PatternKind::gray, .axis = Axis::v, .bit = 9, .inverted = true}));
  EXPECT_EQ((*frames)[3].pattern,
            (Pattern{.kind = PatternKind::phase, .period_px = 64, .step = 2, .steps = 5}));
}

TEST(FrameTable, ColumnsStandInAnyOrderAndThoseOfPhaseMayLack) {
  const auto frames = parse_frame_table(
      "kind,axis,bit,inverted,file,camera,display,stop,angle_deg,exposure_us\n"
      "gray,u,2,0,a.png,c,d,0,0,0\n");
  ASSERT_TRUE(frames) << frames.error().text();
  EXPECT_EQ((*frames)[0].pattern.bit, 2);
}

TEST(FrameTable, EveryComplaintNamesTheLine) {
  const std::string good = "a.png,left,north,0,0,1000,white,-,,,,,\n";
  const std::pair<std::string, const char*> wrongs[] = {
      {"", "line 1: no line names the columns"},
      {kHead, "the table has no line beside its names"},
      {"file,colour\n", "line 1: unknown column 'colour'"},
      {"file,file\n", "line 1: column 'file' twice"},
      {"file,camera\n", "line 1: column 'display' is missing"},
      {kHead + good + "a,b\n", "line 3: 2 fields; there must be 13"},
      {kHead + "\"a.png,left,north,0,0,1,white,-,,,,,\n", "line 2: a quote is not closed"},
      {kHead + ",left,north,0,0,1,white,-,,,,,\n", "line 2: column 'file' is ''"},
      {kHead + "a,le/ft,north,0,0,1,white,-,,,,,\n", "column 'camera' is 'le/ft'; it must be 1 to"},
      {kHead + "a,left,,0,0,1,white,-,,,,,\n", "line 2: column 'display' is ''"},
      {kHead + "a,left,north,-1,0,1,white,-,,,,,\n",
       "'stop' is '-1'; it must be a whole number in"},
      {kHead + "a,left,north,0x,0,1,white,-,,,,,\n", "column 'stop' is '0x'"},
      {kHead + "a,left,north,99999999999,0,1,white,-,,,,,\n", "column 'stop' is '99999999999'"},
      {kHead + "a,left,north,0,nan,1,white,-,,,,,\n", "column 'angle_deg' is 'nan'"},
      {kHead + "a,left,north,0,inf,1,white,-,,,,,\n", "column 'angle_deg' is 'inf'"},
      {kHead + "a,left,north,0,,1,white,-,,,,,\n", "column 'angle_deg' is ''"},
      {kHead + "a,left,north,0,0,-5,white,-,,,,,\n", "column 'exposure_us' is '-5'"},
      {kHead + "a,left,north,0,0,1,grey,-,,,,,\n", "it must be one of gray, phase, white, black"},
      {kHead + "a,left,north,0,0,1,white,u,,,,,\n", "it must be - for white and black"},
      {kHead + "a,left,north,0,0,1,black,-,3,,,,\n", "it must be empty for white and black"},
      {kHead + "a,left,north,0,0,1,gray,-,3,0,,,\n", "column 'axis' is '-'; it must be u or v"},
      {kHead + "a,left,north,0,0,1,gray,u,14,0,,,\n", "'bit' is '14'; it must be a whole number"},
      {kHead + "a,left,north,0,0,1,gray,u,3,maybe,,,\n", "it must be 0, 1, false or true"},
      {kHead + "a,left,north,0,0,1,phase,u,,,1,0,4\n", "column 'period_px' is '1'"},
      {kHead + "a,left,north,0,0,1,phase,u,,,16,4,4\n", "'step' is '4'; it must be a whole number"},
      {kHead + good + "b.png,left,north,0,1,1000,black,-,,,,,\n",
       "line 3: column 'angle_deg' differs from line 2"},
      {kHead + good + good, "line 3: the same pattern as in line 2"},
  };
  for (const auto& [table, message] : wrongs) {
    const auto frames = parse_frame_table(table);
    ASSERT_FALSE(frames) << table;
    EXPECT_EQ(frames.error().code, Code::invalid);
    EXPECT_NE(frames.error().what.find(message), std::string::npos) << frames.error().what;
  }
}

TEST(FrameTable, StacksBeginWithWhiteAndBlackAndKeepPairsTogether) {
  std::string table = kHead;
  for (const char* camera : {"right", "left"}) {
    for (int bit = 0; bit < 3; ++bit) {
      for (const char* inverted : {"1", "0"}) {
        for (const char* axis : {"v", "u"}) {
          table += std::string("x,") + camera + ",north,1,0,0,gray," + axis + "," +
                   std::to_string(bit) + "," + inverted + ",,,\n";
        }
      }
    }
    table += std::string("x,") + camera + ",north,1,0,0,black,-,,,,,\n";
    table += std::string("x,") + camera + ",north,1,0,0,white,-,,,,,\n";
  }
  const std::vector<TableStack> stacks = stacks_of(*parse_frame_table(table));
  ASSERT_EQ(stacks.size(), 2U);
  EXPECT_EQ(stacks[0].key.camera, "left");
  for (const TableStack& stack : stacks) {
    ASSERT_EQ(stack.frames.size(), 14U);
    EXPECT_EQ(stack.frames[0].pattern.kind, PatternKind::white);
    EXPECT_EQ(stack.frames[1].pattern.kind, PatternKind::black);
    for (std::size_t i = 2; i < 14; i += 2) {
      EXPECT_EQ(stack.frames[i].pattern.bit, stack.frames[i + 1].pattern.bit);
      EXPECT_EQ(stack.frames[i].pattern.axis, stack.frames[i + 1].pattern.axis);
      EXPECT_TRUE(!stack.frames[i].pattern.inverted && stack.frames[i + 1].pattern.inverted);
    }
  }
}

}  // namespace
}  // namespace alhazen
