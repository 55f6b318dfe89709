#include "reconstruct/diagnose.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>

#include "reconstruct/reconstruct.h"
#include "tests/support/analytic.h"
#include "tests/support/nobody.h"

namespace alhazen {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const Volume kVolume{};
/// Beside the axis: one on it would look the same to a table that turns the other way.
const analytic::Sphere kSphere{{11, -7, 47}, 17};
constexpr int kStops = 12, kLevel = 6;

struct Recorded {
  Rig rig;
  std::vector<LightMap> maps;
};

/// Gray code, coarse pixels, three displays; two of one size.
const Recorded& recorded() {
  static const Recorded scan = [] {
    Recorded made;
    made.rig = analytic::make_rig({.cameras = 6, .pixel_mm = 0.6, .sensor_px = 160});
    analytic::scan(made.rig, kSphere, kStops, {.gray = true, .outlier_share = 0.01}, {0, 0, 47}, 34,
                   [&](LightMap map) { made.maps.push_back(std::move(map)); });
    return made;
  }();
  return scan;
}

Result<Reconstructed> reconstruct(const Rig& rig, const std::vector<LightMap>& maps) {
  Reconstruction reconstruction = *Reconstruction::make(rig, kVolume, kLevel, {});
  for (const LightMap& map : maps) {
    if (auto added = reconstruction.add(map); !added) return added.error();
  }
  return reconstruction.finish(kNobody);
}

/// What a result, or the error in its place, says is wrong.
std::vector<std::string> faults_of(const Result<Reconstructed>& made) {
  if (made) return made->warnings;
  return {made.error().text()};
}

TEST(Diagnose, AGoodScanHasNoFault) {
  const auto made = reconstruct(recorded().rig, recorded().maps);
  ASSERT_TRUE(made) << made.error().text();
  EXPECT_THAT(made->warnings, IsEmpty());
}

/// The same world seen in a mirror beside the rig (y becomes -y): what calibrating from mirrored
/// pictures gives. Poses stay right-handed, as rig.json demands.
Rig mirrored(Rig rig, bool with_turntable) {
  const auto over = [](Eigen::Vector3d& v) { v.y() = -v.y(); };
  for (CameraModel& camera : rig.cameras) {
    Eigen::Matrix3d& r = camera.camera_from_rig.rotation;
    r.col(1) *= -1;
    r.row(0) *= -1;
    camera.camera_from_rig.translation_mm.x() *= -1;
    camera.cx_px = camera.width_px - 1 - camera.cx_px;
    camera.distortion[3] *= -1;
  }
  for (DisplayModel& display : rig.displays) {
    over(display.origin_mm);
    over(display.u_mm);
    over(display.v_mm);
  }
  over(rig.turntable.point_mm);
  over(rig.turntable.direction);
  if (with_turntable) rig.turntable.direction *= -1;
  return rig;
}

struct Mistake {
  std::string what;
  std::function<void(Rig&)> make;
  std::string says;
};
class Mistakes : public testing::TestWithParam<Mistake> {};

TEST_P(Mistakes, InTheRigAreNamed) {
  Rig rig = recorded().rig;
  GetParam().make(rig);
  const Rig checked = *Rig::parse(rig.to_json());  // it is a rig that could be loaded
  const auto made = reconstruct(checked, recorded().maps);
  EXPECT_THAT(faults_of(made), ElementsAre(HasSubstr(GetParam().says)));
}

void exchange_displays(Rig& rig, std::size_t a, std::size_t b) {
  std::swap(rig.displays[a].name, rig.displays[b].name);
}
void exchange_cameras(Rig& rig, std::size_t a, std::size_t b) {
  std::swap(rig.cameras[a].name, rig.cameras[b].name);
}
void mirror_columns(DisplayModel& display) {
  display.origin_mm += (display.width_px - 1) * display.u_mm;
  display.u_mm *= -1;
}
void mirror_rows(DisplayModel& display) {
  display.origin_mm += (display.height_px - 1) * display.v_mm;
  display.v_mm *= -1;
}

INSTANTIATE_TEST_SUITE_P(
    All, Mistakes,
    testing::Values(
        Mistake{"mirrored", [](Rig& rig) { rig = mirrored(rig, true); },
                "if the rig is mirrored ("},
        Mistake{"mirrored_but_table", [](Rig& rig) { rig = mirrored(rig, false); },
                "the rig is mirrored in all but its turntable's direction"},
        Mistake{"every_display_mirrored",
                [](Rig& rig) {
                  for (DisplayModel& display : rig.displays) mirror_columns(display);
                },
                "every display is mirrored left to right"},
        Mistake{"one_display_mirrored", [](Rig& rig) { mirror_columns(rig.displays[0]); },
                "display 'side' turns its back to the volume"},
        Mistake{"one_display_upside_down", [](Rig& rig) { mirror_rows(rig.displays[2]); },
                "display 'above' is mirrored upside down"},
        Mistake{"one_display_turned",
                [](Rig& rig) {
                  mirror_columns(rig.displays[2]);
                  mirror_rows(rig.displays[2]);
                },
                "display 'above' is turned by half a turn"},
        Mistake{"displays", [](Rig& rig) { exchange_displays(rig, 0, 2); },
                "displays 'above' and 'side' are exchanged"},
        Mistake{"neighbouring_cameras", [](Rig& rig) { exchange_cameras(rig, 2, 3); },
                "cameras 'c03' and 'c04' are exchanged"},
        Mistake{"distant_cameras", [](Rig& rig) { exchange_cameras(rig, 0, 4); },
                "cameras 'c01' and 'c05' are exchanged"},
        Mistake{"camera_moved",
                [](Rig& rig) { rig.cameras[1].camera_from_rig.translation_mm.x() += 3; },
                "camera 'c02' does not fit the rest"},
        Mistake{"another_rig",
                [](Rig& rig) {
                  // Of another laboratory: everything stands somewhere else.
                  double step_mm = 25;
                  for (CameraModel& camera : rig.cameras) {
                    camera.camera_from_rig.translation_mm +=
                        Eigen::Vector3d(step_mm, -step_mm / 2, 2 * step_mm);
                    step_mm = -1.1 * step_mm;
                  }
                  for (DisplayModel& display : rig.displays)
                    display.origin_mm += Eigen::Vector3d(90, -70, 120);
                },
                "hardly agree anywhere"}),
    [](const auto& named) { return named.param.what; });

TEST(Diagnose, TwoDisplaysAreEnough) {
  Rig rig = recorded().rig;
  rig.displays.erase(rig.displays.begin() + 1);
  std::vector<LightMap> maps;
  for (const LightMap& map : recorded().maps) {
    if (map.key.display != "below") maps.push_back(map);
  }
  EXPECT_THAT(faults_of(reconstruct(rig, maps)), IsEmpty());
  exchange_displays(rig, 0, 1);
  EXPECT_THAT(faults_of(reconstruct(rig, maps)),
              ElementsAre(HasSubstr("displays 'above' and 'side' are exchanged")));
}

TEST(Diagnose, AStopOfAnotherAngleIsNamed) {
  std::vector<LightMap> maps = recorded().maps;
  for (LightMap& map : maps) {
    if (map.key.stop == 4) map.angle_rad += 0.2;
  }
  EXPECT_THAT(faults_of(reconstruct(recorded().rig, maps)),
              ElementsAre(HasSubstr("stop 4 does not fit the rest")));
}

TEST(Diagnose, WhatSawNothingIsNamed) {
  std::vector<LightMap> maps = recorded().maps;
  for (LightMap& map : maps) {
    if (map.key.camera != "c02" && map.key.stop != 7) continue;
    for (std::size_t i = 0; i < map.size_px(); ++i) {
      map.label[i] = Label::none;
      map.u_px[i] = map.v_px[i] = std::nanf("");
    }
  }
  EXPECT_THAT(faults_of(reconstruct(recorded().rig, maps)),
              ElementsAre("none of the 36 light maps of camera 'c02' holds a position",
                          "none of the 18 light maps of stop 7 holds a position"));
}

TEST(Diagnose, LeavesTheObservationsAsTheyWere) {
  Rig rig = recorded().rig;
  rig.turntable.direction *= -1;
  Observations observations(rig, {}, kVolume.centre_mm);
  for (const LightMap& map : recorded().maps) ASSERT_TRUE(observations.add(map));
  const std::vector<Observation> before = observations.all();
  ASSERT_TRUE(diagnose(observations, {}, kVolume, nullptr, kNobody));
  EXPECT_EQ(observations.rig().hash(), rig.hash());
  for (std::size_t i = 0; i < before.size(); ++i) {
    const Observation& now = observations.all()[i];
    EXPECT_EQ(now.origin_object_mm, before[i].origin_object_mm);
    EXPECT_EQ(now.u_object_mm, before[i].u_object_mm);
    EXPECT_EQ(now.v_object_mm, before[i].v_object_mm);
    EXPECT_EQ(now.inward_object, before[i].inward_object);
    EXPECT_EQ(now.camera, before[i].camera);
  }
}

TEST(Diagnose, StopsWhenAsked) {
  Rig rig = recorded().rig;
  rig.turntable.direction *= -1;
  Observations observations(rig, {}, kVolume.centre_mm);
  for (const LightMap& map : recorded().maps) ASSERT_TRUE(observations.add(map));
  std::stop_source source;
  const alhazen::Run run{source.get_token(), [&](std::string_view, double share) {
                           if (share > 0.2) source.request_stop();
                         }};
  EXPECT_EQ(diagnose(observations, {}, kVolume, nullptr, run).error().code, Code::cancelled);
  EXPECT_EQ(observations.rig().hash(), rig.hash());
}

}  // namespace
}  // namespace alhazen
