// The report's page in Chromium without a screen: what its script draws, obeys and says.

#include "reconstruct/report/page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "tests/unit/report/shapes.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

constexpr double kRadius_mm = 20;

/// A sphere of which the lower half was not observed.
Mesh half_seen_sphere() {
  Mesh mesh = sphere_mesh(kRadius_mm, {1, 2, 30}, 5);
  for (const auto& n : mesh.normals) mesh.observed.push_back(n.z() > 0 ? 1 : 0);
  return mesh;
}

std::string page_of(const Mesh& mesh) {
  Report report;
  report.provenance.scan_id = "sphere";
  report.mesh = mesh_figures(mesh);
  const auto colourings = colourings_of(report, mesh);
  const auto pictures = draw_pictures(report, mesh, colourings);
  EXPECT_TRUE(pictures) << pictures.error().text();
  return to_page(report, mesh, colourings, *pictures);
}

class PageInABrowser : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::string(ALHAZEN_CHROMIUM).empty())
      GTEST_SKIP() << "there was no Chromium when the build was configured";
    std::string pattern = (fs::temp_directory_path() / "alhazen-page-XXXXXX").string();
    folder_ = ::mkdtemp(pattern.data());
  }
  void TearDown() override { fs::remove_all(folder_); }

  /// What a script finds in a page that has been loaded. The page's own scripts must not throw.
  [[nodiscard]] nlohmann::json ask(const std::string& page, const std::string& script,
                                   const std::string& option = "") {
    std::ofstream(folder_ / "page.html", std::ios::binary) << page;
    std::ofstream(folder_ / "script.js", std::ios::binary) << script;
    const auto file = [this](const char* name) { return "'" + (folder_ / name).string() + "'"; };
    const std::string command = "python3 " ALHAZEN_SOURCE_DIR "/tests/browser/ask_page.py '" +
                                std::string(ALHAZEN_CHROMIUM) + "' " + file("page.html") + " " +
                                file("script.js") + " " + option + " >" + file("answer.json");
    EXPECT_EQ(std::system(command.c_str()), 0);
    std::ifstream in(folder_ / "answer.json");
    const auto answer = nlohmann::json::parse(in, nullptr, false);
    if (!answer.is_object()) return {};
    EXPECT_EQ(answer["exceptions"], nlohmann::json::array());
    return answer["value"];
  }

  fs::path folder_;
};

constexpr const char* kState = R"(({
    view: Object.assign({}, document.getElementById('view').dataset),
    width_px: (document.querySelector('canvas') || {}).width,
    height_px: (document.querySelector('canvas') || {}).height,
    text: document.getElementById('view').innerText,
    pictures: Array.from(document.images).filter((image) => image.naturalWidth > 0).length,
    strange: document.body.dataset.strange || 'did not run',
  }))";

TEST_F(PageInABrowser, DrawsTheWholeSphere) {
  const Mesh mesh = half_seen_sphere();
  const auto state = ask(page_of(mesh), kState);
  ASSERT_EQ(state["view"]["state"], "ready") << state;
  EXPECT_EQ(state["view"]["triangles"], std::to_string(mesh.triangles.size()));
  EXPECT_EQ(state["view"]["colouring"], "Surface");
  // The outline of a sphere, which just fits: its edge lies asin(sin(12°) / 1.04) off the middle.
  const double width_px = state["width_px"], height_px = state["height_px"];
  ASSERT_GT(width_px, height_px);
  const double half_rad = 12 * std::numbers::pi / 180;
  const double radius_px =
      height_px / 2 * std::tan(std::asin(std::sin(half_rad) / 1.04)) / std::tan(half_rad);
  const double share = std::numbers::pi * radius_px * radius_px / (width_px * height_px);
  EXPECT_NEAR(std::stod(state["view"]["filled"].get<std::string>()), share, 0.01 * share);
  for (const char* text : {"Surface", "Coverage", "front", "bottom", "the whole mesh", "5 mm"})
    EXPECT_THAT(state["text"].get<std::string>(), HasSubstr(text));
  EXPECT_EQ(state["pictures"], 12);  // two colourings from six sides
}

TEST_F(PageInABrowser, ObeysMouseKeysAndPanel) {
  const std::string script = R"((async () => {
    const view = document.getElementById('view'), canvas = view.querySelector('canvas');
    const noted = {};
    const frame = () => new Promise(requestAnimationFrame);
    function colour_in_the_middle() {
      const copy = document.createElement('canvas');
      copy.width = canvas.width;
      copy.height = canvas.height;
      const flat = copy.getContext('2d');
      flat.drawImage(canvas, 0, 0);
      return Array.from(flat.getImageData(copy.width / 2, copy.height / 2, 1, 1).data);
    }
    function mouse(kind, x, buttons) {
      canvas.dispatchEvent(new PointerEvent(kind, { pointerId: 1, clientX: x, clientY: 300,
                                                    buttons: buttons }));
    }
    const key = (name) => canvas.dispatchEvent(new KeyboardEvent('keydown', { key: name }));
    const side = (index) => view.querySelectorAll('.sides button')[index].click();
    async function after(name, act) {
      act();
      // A way to another side begins in the next frame and asks for the one after it.
      for (let i = 0; i < 3; ++i) await frame();
      // What is drawn can be read until it is shown: asked for anew, and read in the same frame.
      key('ArrowLeft');
      key('ArrowRight');
      await frame();
      noted[name] = { toward: view.dataset.toward.split(' ').map(Number),
                      colour: colour_in_the_middle(),
                      scale: view.querySelector('.scale').style.width + ' ' +
                             view.querySelector('.scale').textContent };
    }
    canvas.setPointerCapture = () => {};  // there is no pointer to capture
    await after('key', () => key('ArrowRight'));
    await after('drag', () => {
      mouse('pointerdown', 300, 1);
      mouse('pointermove', 350, 1);
      mouse('pointerup', 350, 0);
    });
    await after('hover', () => mouse('pointermove', 500, 0));
    await after('wheel', () => canvas.dispatchEvent(new WheelEvent('wheel', { deltaY: 500 })));
    view.querySelectorAll('.colourings input')[1].click();
    await after('top', () => side(4));
    await after('bottom', () => side(5));
    await after('begin', () => key('0'));
    noted.colouring = view.dataset.colouring;
    return noted;
  })())";
  const auto noted = ask(page_of(half_seen_sphere()), script, "--force-prefers-reduced-motion");
  ASSERT_TRUE(noted.contains("begin")) << noted;
  const auto expect_toward = [&](const char* deed, double turn_rad, double rise_rad) {
    const auto toward = noted[deed]["toward"].get<std::vector<double>>();
    ASSERT_EQ(toward.size(), 3U);
    EXPECT_NEAR(toward[0], std::cos(rise_rad) * std::sin(turn_rad), 2e-3) << deed;
    EXPECT_NEAR(toward[1], -std::cos(rise_rad) * std::cos(turn_rad), 2e-3) << deed;
    EXPECT_NEAR(toward[2], std::sin(rise_rad), 2e-3) << deed;
  };
  expect_toward("key", -0.5, 0.32);
  expect_toward("drag", -0.9, 0.32);  // 50 px of 0.008 rad
  expect_toward("hover", -0.9, 0.32);
  expect_toward("top", 0, std::numbers::pi / 2 - 1e-3);
  expect_toward("bottom", 0, -std::numbers::pi / 2 + 1e-3);
  expect_toward("begin", -0.6, 0.32);
  EXPECT_NE(noted["hover"]["scale"], noted["wheel"]["scale"]);
  EXPECT_EQ(noted["hover"]["scale"], noted["begin"]["scale"]);

  // Seen from above what was measured, from below what was not, each in full light.
  const auto expect_colour = [&](const char* deed, const Colour& colour) {
    const double shaded = 0.30 + 0.68 * 0.75 / std::hypot(0.45, 0.65, 0.75) +
                          0.16 * 0.5 / std::sqrt(0.7 * 0.7 + 0.1 * 0.1 + 0.5 * 0.5);
    const double light = 1 - 0.35 * (1 - shaded);
    const auto seen = noted[deed]["colour"].get<std::vector<double>>();
    ASSERT_EQ(seen.size(), 4U);
    EXPECT_NEAR(seen[0], 255 * light * static_cast<double>(colour.r), 3) << deed;
    EXPECT_NEAR(seen[1], 255 * light * static_cast<double>(colour.g), 3) << deed;
    EXPECT_NEAR(seen[2], 255 * light * static_cast<double>(colour.b), 3) << deed;
    EXPECT_EQ(seen[3], 255) << deed;
  };
  expect_colour("top", kCovered);
  expect_colour("bottom", kUnobserved);
  EXPECT_EQ(noted["colouring"], "Coverage");
}

TEST_F(PageInABrowser, SaysSoWithoutWebGlAndKeepsThePictures) {
  const auto state = ask(page_of(half_seen_sphere()), kState, "--disable-3d-apis");
  EXPECT_EQ(state["view"]["state"], "off");
  EXPECT_THAT(state["text"].get<std::string>(), HasSubstr("This browser offers no WebGL"));
  EXPECT_EQ(state["pictures"], 12);
}

TEST_F(PageInABrowser, RunsNoScriptButItsOwn) {
  std::string page = page_of(half_seen_sphere());
  page.insert(page.rfind("</body>"), "<script>document.body.dataset.strange = 'ran';</script>");
  const auto state = ask(page, kState);
  EXPECT_EQ(state["view"]["state"], "ready");
  EXPECT_EQ(state["strange"], "did not run");
}

}  // namespace
}  // namespace alhazen
