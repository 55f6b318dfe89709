#include "reconstruct/normals/normal_tables.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <string>

namespace alhazen {
namespace {

using testing::HasSubstr;

TEST(Views, AreReadWithWhatIsLeftOut) {
  const auto views = parse_views(
      "file,camera,stop,angle_deg,axes,mask,noise_deg\n"
      "a.png,left,2,90,opengl,\"m, 1.png\",1.5\n"
      "\n"
      "b.exr,right,,,,,\r\n");
  ASSERT_TRUE(views) << views.error().text();
  ASSERT_EQ(views->size(), 2U);
  const ViewEntry& a = (*views)[0];
  EXPECT_EQ(a.file, "a.png");
  EXPECT_EQ(a.key, (NormalMapKey{2, "left"}));
  EXPECT_DOUBLE_EQ(a.angle_rad, std::numbers::pi / 2);
  EXPECT_EQ(a.format.axes, NormalAxes::opengl);
  EXPECT_EQ(a.format.mask, "m, 1.png");
  EXPECT_DOUBLE_EQ(a.format.noise_rad, 1.5 * std::numbers::pi / 180);
  const ViewEntry& b = (*views)[1];
  EXPECT_EQ(b.key, (NormalMapKey{0, "right"}));
  EXPECT_EQ(b.format.axes, NormalAxes::camera);
  EXPECT_TRUE(b.format.mask.empty());
  EXPECT_EQ(b.line, 4);
}

TEST(Views, AreRefusedByLineAndColumn) {
  const auto complaint = [](const std::string& csv) {
    const auto views = parse_views(csv);
    EXPECT_FALSE(views) << csv;
    return views ? std::string() : views.error().what;
  };
  EXPECT_THAT(complaint(""), HasSubstr("no line names the columns"));
  EXPECT_THAT(complaint("file,camera\n"), HasSubstr("no line beside"));
  EXPECT_THAT(complaint("file\na\n"), HasSubstr("column 'camera' is missing"));
  EXPECT_THAT(complaint("file,camera,colour\na,b,c\n"), HasSubstr("unknown column 'colour'"));
  EXPECT_THAT(complaint("file,camera,file\na,b,c\n"), HasSubstr("twice"));
  EXPECT_THAT(complaint("file,camera\na\n"), HasSubstr("line 2: 1 fields"));
  EXPECT_THAT(complaint("file,camera\n\"a,b\n"), HasSubstr("quote"));
  EXPECT_THAT(complaint("file,camera,axes\na,b,left\n"), HasSubstr("camera, opengl or rig"));
  EXPECT_THAT(complaint("file,camera,angle_deg\na,b,nan\n"), HasSubstr("column 'angle_deg'"));
  EXPECT_THAT(complaint("file,camera,stop\na,b,1.5\n"), HasSubstr("whole number"));
  EXPECT_THAT(complaint("file,camera,noise_deg\na,b,-1\n"), HasSubstr("column 'noise_deg'"));
  EXPECT_THAT(complaint("file,camera\na,b\nc,b\n"), HasSubstr("was in line 2"));
}

TEST(Lights, AreReadInBothAxes) {
  const auto lights = parse_lights(
      "file,x,y,z,kind,axes,intensity\n"
      "a.png,0,0.6,0.8,,opengl,\n"
      "b.png,10,20,30,near,camera,2\n");
  ASSERT_TRUE(lights) << lights.error().text();
  EXPECT_EQ((*lights)[0].light.vector, Eigen::Vector3d(0, -0.6, -0.8));
  EXPECT_FALSE((*lights)[0].light.is_near);
  EXPECT_EQ((*lights)[0].light.intensity, 1);
  EXPECT_TRUE((*lights)[1].light.is_near);
  EXPECT_EQ((*lights)[1].light.intensity, 2);
  EXPECT_FALSE(parse_lights("file,x,y,z\na,0,0,0\n"));
  EXPECT_FALSE(parse_lights("file,x,y,z,kind\na,0,0,1,middle\n"));
  EXPECT_FALSE(parse_lights("file,x,y,z,axes\na,0,0,1,rig\n"));
  EXPECT_FALSE(parse_lights("file,x,y,z,intensity\na,0,0,1,0\n"));
  EXPECT_FALSE(parse_lights("file,x,y,z\na,0,inf,1\n"));
}

}  // namespace
}  // namespace alhazen
