#include "reconstruct/scan/shortcomings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "tests/unit/scan/small_scan.h"
#include "tests/unit/scan/temporary_folder.h"

namespace alhazen {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kTurn = 2 * std::numbers::pi;

class Shortcomings : public testing::Test {
 protected:
  Shortcomings() {
    CameraModel camera;
    camera.width_px = camera.height_px = 20;
    camera.fx_px = camera.fy_px = 30;
    for (const char* name : {"left", "right"}) {
      camera.name = name;
      rig_.cameras.push_back(camera);
    }
    DisplayModel display;
    display.width_px = 8;
    display.height_px = 4;
    for (const char* name : {"north", "below"}) {
      display.name = name;
      rig_.displays.push_back(display);
    }
    manifest_ = small_manifest();
    manifest_.rig_hash = rig_.hash();
    manifest_.stops = {{0, 0}, {1, 0.5}, {2, 1}};
  }
  /// What is said of a scan of which the maps for which `is_there(key)` are present.
  template <class IsThere>
  [[nodiscard]] std::vector<std::string> of(const IsThere& is_there) const {
    const TemporaryFolder folder;
    const Scan scan = *Scan::create(folder.path() / "scan", manifest_, rig_);
    std::vector<StackKey> present;
    for (const Stop& stop : manifest_.stops) {
      for (const char* display : {"below", "north"}) {
        for (const char* camera : {"left", "right"}) {
          const StackKey key{stop.index, display, camera};
          if (is_there(key)) present.push_back(key);
        }
      }
    }
    return shortcomings(scan, present);
  }
  static bool all(const StackKey& /*key*/) { return true; }

  Rig rig_;
  Manifest manifest_;
};

TEST_F(Shortcomings, AWholeScanHasNone) { EXPECT_THAT(of(all), IsEmpty()); }

TEST_F(Shortcomings, MissingLightMapsAreNamedByWhatTheyShare) {
  EXPECT_THAT(of([](const StackKey& key) { return key.stop != 1; }),
              ElementsAre("4 of 12 light maps are missing: all of stop 1"));
  EXPECT_THAT(of([](const StackKey& key) { return key.display != "north"; }),
              ElementsAre("6 of 12 light maps are missing: all of display north"));
  EXPECT_THAT(of([](const StackKey& key) { return key.camera != "left" && key.stop != 2; }),
              ElementsAre("8 of 12 light maps are missing: all of stop 2, all of camera left"));
  EXPECT_THAT(of([](const StackKey& key) {
                return key != StackKey{1, "below", "left"};
              }),
              ElementsAre("1 of 12 light maps are missing: stop 1 display below camera left"));
  EXPECT_THAT(of([](const StackKey& key) { return (key.camera == "left") == (key.stop == 0); }),
              ElementsAre(HasSubstr("6 of 12 light maps are missing: stop 0 display")));
  EXPECT_THAT(of([](const StackKey& /*key*/) { return false; }),
              ElementsAre(HasSubstr("12 of 12 light maps are missing: all of stop 0, 1, 2")));
}

TEST_F(Shortcomings, StopsAtOneAngleAreNamed) {
  manifest_.stops = {{0, 0}, {1, 0.5}, {2, 0.5}};
  EXPECT_THAT(of(all), ElementsAre("stops 1 and 2 are at the same angle, 28.648 deg: what they see "
                                   "counts twice"));
  manifest_.stops = {{0, 0}, {1, 2}, {2, kTurn}};
  EXPECT_THAT(of(all), ElementsAre(HasSubstr("stops 0 and 2 are at the same angle")));
  manifest_.stops = {{0, 0.00003}, {1, 2}, {2, -kTurn - 0.00003}};
  EXPECT_THAT(of(all), ElementsAre(HasSubstr("stops 0 and 2 are at the same angle")));
  manifest_.stops = {{0, 0.3}};
  EXPECT_THAT(of(all), IsEmpty());
}

TEST_F(Shortcomings, AnotherRigIsNamed) {
  manifest_.rig_hash = "0123456789abcdef";
  EXPECT_THAT(of(all), ElementsAre(HasSubstr("the manifest says 0123456789abcdef")));
}

}  // namespace
}  // namespace alhazen
