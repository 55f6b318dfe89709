#include "reconstruct/report/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "reconstruct/report/draw.h"
#include "reconstruct/report/embedded.h"
#include "reconstruct/report/page.h"
#include "tests/unit/report/shapes.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;
using ::testing::HasSubstr;
using ::testing::Not;

/// A folder of its own that goes away with the test.
class Folder {
 public:
  Folder() {
    std::string pattern = (fs::temp_directory_path() / "alhazen-report-XXXXXX").string();
    path_ = ::mkdtemp(pattern.data());
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  [[nodiscard]] fs::path operator/(const std::string& name) const { return path_ / name; }
  [[nodiscard]] const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

std::string text_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

constexpr double kRadius_mm = 20;
const Vector3d kCentre_mm(0, 0, 25);

/// A sphere as a reconstruction sees it: consistency on the surface, divergence inside of it.
Reconstructed sphere_reconstructed(int level) {
  Volume volume;
  volume.centre_mm = kCentre_mm;
  volume.edge_mm = 64;
  Reconstructed out{.mesh = sphere_mesh(kRadius_mm, kCentre_mm, 4),
                    .octree = Octree::uniform(volume, level),
                    .field = {},
                    .divergence = {},
                    .indicator = {},
                    .times = {{"vote", 1.5, 0.9}, {"cut", 2.5, 1.4}},
                    .warnings = {"a <warning> & more"},
                    .light_maps = 4,
                    .hypotheses = 12345678901};
  for (std::size_t leaf = 0; leaf < out.octree.size(); ++leaf) {
    const double depth = kRadius_mm - (out.octree.centre_mm(leaf) - kCentre_mm).norm();
    const double consistency = std::exp(-depth * depth / 4);
    out.field.consistency.push_back(static_cast<float>(consistency));
    out.divergence.push_back(static_cast<float>(depth / 2 * consistency));
    out.indicator.u.push_back(depth > 0 ? 1.0F : 0.0F);
  }
  out.indicator.energy = -120.5;
  out.indicator.gap = 0.25;
  out.indicator.iterations = 77;
  for (const auto& n : out.mesh.normals) {
    out.mesh.observed.push_back(n.z() > -0.5F ? 1 : 0);
    out.mesh.consistency.push_back(0.8F);
    out.mesh.depth_sigma_mm.push_back(n.z() > -0.5F ? 0.004F
                                                    : std::numeric_limits<float>::quiet_NaN());
  }
  return out;
}

Manifest manifest() {
  Manifest m;
  m.scan_id = "scan-7";
  m.created_at = "2026-11-22T01:02:03Z";
  m.object_id = "<script>alert('bunny')</script>";
  m.note = "\"><img src=x onerror=alert(1)> \x01 \xff & so on";
  m.operator_name = "A & B";
  m.software_version = "0.1.0";
  m.rig_hash = "0123456789abcdef";
  m.stops = {{0, 0.0}, {1, 0.5}};
  m.displays = {{"side", 64, 32, {Pattern{}}}};
  m.cameras = {{"c0", {Micros(1000), 0, {0, 0, 8, 8}}}, {"c1", {Micros(1000), 0, {0, 0, 8, 8}}}};
  return m;
}

TEST(MeshFigures, OfACubeAreItsOwn) {
  Mesh cube = cube_mesh(2);
  cube.observed = {1, 1, 1, 1, 1, 1, 1, 0};  // corner (2, 2, 2) belongs to three faces
  const MeshFigures figures = mesh_figures(cube);
  EXPECT_EQ(figures.vertices, 8U);
  EXPECT_TRUE(figures.check.closed());
  EXPECT_DOUBLE_EQ(figures.check.volume_mm3, 8);
  EXPECT_DOUBLE_EQ(figures.check.area_mm2, 24);
  // Of its twelve triangles, five or six have that corner.
  std::size_t without = 0;
  for (const auto& t : cube.triangles) without += t[0] != 7 && t[1] != 7 && t[2] != 7 ? 1 : 0;
  EXPECT_DOUBLE_EQ(figures.observed_area_mm2, 2.0 * static_cast<double>(without));
  EXPECT_EQ(figures.low_mm, Vector3d::Zero());
  EXPECT_EQ(figures.high_mm, Vector3d::Constant(2));
  EXPECT_FALSE(figures.median_consistency);
  EXPECT_EQ(mesh_figures({}).vertices, 0U);
}

TEST(Slice, ShowsTheMiddle) {
  const Slice slice = middle_slice(sphere_reconstructed(5));
  ASSERT_EQ(slice.width, 32);
  ASSERT_EQ(slice.height, 32);
  const double cell_mm = 2;
  std::size_t cell = 0;
  for (int row = 0; row < 32; ++row) {
    for (int column = 0; column < 32; ++column, ++cell) {
      // Leaf centres of the layer beside the middle.
      const Vector3d d((column - 15.5) * cell_mm, cell_mm / 2, (15.5 - row) * cell_mm);
      EXPECT_EQ(slice.inside[cell] > 0.5F, d.norm() < kRadius_mm);
      const double depth = kRadius_mm - d.norm();
      EXPECT_NEAR(static_cast<double>(slice.consistency[cell]), std::exp(-depth * depth / 4), 1e-6);
      if (depth > 0.1 && depth < 3) {
        EXPECT_GT(slice.divergence_per_mm[cell], 0);
      }
    }
  }
}

TEST(Slice, FileGivesItBackAndRefusesOthers) {
  const Slice slice = middle_slice(sphere_reconstructed(4));
  const std::string file = to_pfm(slice);
  const auto back = parse_slice(file);
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(back->width, slice.width);
  EXPECT_EQ(back->consistency, slice.consistency);
  EXPECT_EQ(back->divergence_per_mm, slice.divergence_per_mm);
  EXPECT_EQ(back->inside, slice.inside);
  for (std::size_t size = 0; size < file.size(); ++size)
    EXPECT_FALSE(parse_slice(std::string_view(file).substr(0, size)));
  for (const char* wrong : {"PF\n0 4\n-1.0\n", "PF\n1025 1\n-1.0\n", "PF\n-1 1\n-1.0\n",
                            "PF\n99999999999 99999999999\n-1.0\n", "Pf\n1 1\n-1.0\n",
                            "PF\n1 1\n1.0\n123456789012", "PF\n1  1\n-1.0\n"})
    EXPECT_FALSE(parse_slice(wrong)) << wrong;
  std::string nan = file;
  for (int i = 1; i <= 4; ++i) nan[nan.size() - static_cast<std::size_t>(i)] = '\x7f';
  nan[nan.size() - 2] = '\xff';
  EXPECT_FALSE(parse_slice(nan));
}

class ReportOfAScan : public ::testing::Test {
 protected:
  ReportOfAScan() {
    Rig rig;
    auto scan = Scan::create(folder_ / "scan", manifest(), rig);
    if (scan) scan_ = *std::move(scan);
  }
  void SetUp() override { ASSERT_TRUE(scan_); }

  [[nodiscard]] Report make() const {
    auto report = make_report(*scan_, sphere_reconstructed(5), capture_, nullptr, {});
    EXPECT_TRUE(report) << report.error().text();
    return *std::move(report);
  }
  /// Compared with a sphere 20 um larger; once for all tests.
  [[nodiscard]] const Report& compared() const {
    static const Report kReport = [this] {
      const Mesh reference = sphere_mesh(kRadius_mm + 0.02, kCentre_mm, 5);
      auto report = make_report(*scan_, sphere_reconstructed(5), capture_, &reference, {});
      EXPECT_TRUE(report) << report.error().text();
      report->refinement = Refinement{.is_accepted = true,
                                      .refusal = "",
                                      .iterations = 3,
                                      .used_before = {2000, 50000, 5e-4},
                                      .used_after = {2000, 50001, 1.1e-4},
                                      .held_out_before = {1000, 25000, 5.1e-4},
                                      .held_out_after = {999, 24990, 1.2e-4},
                                      .shifts = {{"left", 0.001, 2e-5, 0.0005, 1e-6}}};
      return *std::move(report);
    }();
    return kReport;
  }

  Folder folder_;
  std::optional<Scan> scan_;
  CaptureFigures capture_{.frames = 100,
                          .retakes = 3,
                          .bytes = 123456,
                          .duration_s = 12.5,
                          .times = {{"capture", 10, 5}},
                          .warnings = {"frame retaken"}};
};

TEST_F(ReportOfAScan, GathersWhatThePartsSay) {
  const Report& report = compared();
  EXPECT_EQ(report.provenance.scan_id, "scan-7");
  EXPECT_EQ(report.provenance.light_maps, 4U);
  EXPECT_EQ(report.provenance.light_maps_planned, 4U);
  EXPECT_EQ(report.reconstruction.level, 5);
  EXPECT_DOUBLE_EQ(report.reconstruction.voxel_mm, 2);
  EXPECT_EQ(report.reconstruction.leaves, 32768U);
  ASSERT_TRUE(report.comparison);
  EXPECT_NEAR(report.comparison->bias_mm, -0.02, 0.01);
  EXPECT_TRUE(report.mesh.check.closed());
  EXPECT_NEAR(report.mesh.observed_share, 0.75, 0.02);
  ASSERT_TRUE(report.mesh.median_depth_sigma_mm);
  EXPECT_NEAR(*report.mesh.median_depth_sigma_mm, 0.004, 1e-6);
  EXPECT_THAT(report.brief(), HasSubstr("RMS 0.0"));
  EXPECT_THAT(report.brief(), HasSubstr("3 retakes"));
  EXPECT_THAT(report.brief(), HasSubstr("refined     yes; held-out votes disagree by 0.120 mrad"));
}

TEST_F(ReportOfAScan, JsonGivesItBack) {
  for (const Report& report : {make(), compared()}) {
    const std::string json = report.to_json();
    const auto back = Report::parse(json);
    ASSERT_TRUE(back) << back.error().text();
    EXPECT_EQ(back->to_json(), json);
    EXPECT_EQ(back->reconstruction.hypotheses, 12345678901U);
    EXPECT_EQ(back->comparison.has_value(), report.comparison.has_value());
  }
}

TEST_F(ReportOfAScan, EveryKeyIsCheckedWhenRead) {
  const auto whole = nlohmann::json::parse(compared().to_json());
  std::size_t refused = 0;
  const auto flat = whole.flatten();
  for (const auto& [path, value] : flat.items()) {
    const nlohmann::json::json_pointer at(path);
    // A list's entry may go; a key may not, and nothing may change its kind.
    auto changed = whole;
    changed[at] = nlohmann::json::object();
    const auto other_kind = Report::parse(changed.dump());
    EXPECT_FALSE(other_kind) << path;
    if (!other_kind) {
      EXPECT_EQ(other_kind.error().code, Code::corrupt);
    }
    changed = whole;
    if (changed[at.parent_pointer()].is_array()) continue;
    changed[at.parent_pointer()].erase(at.back());
    EXPECT_FALSE(Report::parse(changed.dump())) << path;
    ++refused;
  }
  EXPECT_GT(refused, 60U);
  for (const char* text : {"", "[]", "null", "{}", "{\"format\":2}", "\xff"})
    EXPECT_FALSE(Report::parse(text));
}

TEST_F(ReportOfAScan, IsWrittenAndReadAgain) {
  const Reconstructed reconstructed = sphere_reconstructed(5);
  const Report report = make();
  const auto written = write_report(report, reconstructed.mesh, folder_.path());
  ASSERT_TRUE(written) << written.error().text();
  EXPECT_THAT(text_of(folder_ / "report.html"), HasSubstr("</html>"));
  const auto back = read_report(folder_.path());
  ASSERT_TRUE(back) << back.error().text();
  EXPECT_EQ(back->to_json(), report.to_json());
  ASSERT_TRUE(back->slice);
  EXPECT_EQ(back->slice->consistency, report.slice->consistency);
  EXPECT_FALSE(read_report(folder_ / "nowhere"));
}

std::string page_of(const Report& report, const Mesh& mesh) {
  const auto colourings = colourings_of(report, mesh);
  const auto pictures = draw_pictures(report, mesh, colourings);
  EXPECT_TRUE(pictures) << pictures.error().text();
  return to_page(report, mesh, colourings, *pictures);
}

std::size_t count_of(const std::string& text, std::string_view part) {
  std::size_t count = 0;
  for (auto at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

TEST_F(ReportOfAScan, PageEscapesEveryStringAndFetchesNothing) {
  Report report = compared();
  report.reference = "<b onclick='x'>truth</b>";
  LightMapSample sample;
  sample.map.key = {0, "a\"><i>", "c0"};
  sample.map.region = {0, 0, 1, 1};
  sample.map.resize_lists();
  sample.map.label[0] = Label::none;
  report.light_maps = {sample};
  std::string page = page_of(report, sphere_reconstructed(5).mesh);
  EXPECT_THAT(page, Not(HasSubstr("<i>\"")));
  EXPECT_THAT(page, HasSubstr("a&quot;&gt;&lt;i&gt;"));
  EXPECT_THAT(page, Not(HasSubstr("<img src=x")));
  EXPECT_THAT(page, Not(HasSubstr("<b onclick")));
  EXPECT_THAT(page, Not(HasSubstr("<warning>")));
  EXPECT_EQ(page.find('\x01'), std::string::npos);
  EXPECT_THAT(page, HasSubstr("&lt;script&gt;alert(&#39;bunny&#39;)&lt;/script&gt;"));
  EXPECT_THAT(page, HasSubstr("A &amp; B"));
  // Two blocks of data, two scripts: the program's own, allowed by their digests alone.
  EXPECT_EQ(count_of(page, "<script"), 4U);
  EXPECT_EQ(count_of(page, "</script"), 4U);
  EXPECT_EQ(count_of(page, "'sha256-"), 2U);
  EXPECT_THAT(page, HasSubstr("default-src 'none'; img-src data:;"));
  EXPECT_THAT(page, Not(HasSubstr("unsafe-eval")));
  // Each picture is inside: five rows of six views, two slices, a light map's u and v.
  EXPECT_EQ(count_of(page, "<img"), 34U);
  EXPECT_EQ(count_of(page, "src=\"data:image/png;base64,"), 34U);
  // three.js knows addresses (of XML's vocabularies); nothing else has one.
  const auto library = page.find(three_js().text);
  ASSERT_NE(library, std::string::npos);
  page.erase(library, three_js().text.size());
  for (const char* outside : {"http:", "https:", "url(", "href=", "import(", "@import", "<link"})
    EXPECT_THAT(page, Not(HasSubstr(outside)));
}

TEST_F(ReportOfAScan, PageOfAnEmptyMeshSaysSo) {
  Report report = make();
  report.mesh = mesh_figures({});
  const std::string page = page_of(report, {});
  EXPECT_THAT(page, HasSubstr("The mesh is empty"));
  EXPECT_THAT(page, Not(HasSubstr("<script")));
}

TEST_F(ReportOfAScan, PicturesAreFilesToo) {
  const Reconstructed reconstructed = sphere_reconstructed(5);
  const auto names = [&] {
    std::set<std::string> found;
    for (const auto& file : fs::directory_iterator(folder_ / "pictures"))
      found.insert(file.path().filename().string());
    return found;
  };
  ASSERT_TRUE(write_report(compared(), reconstructed.mesh, folder_.path()));
  EXPECT_EQ(names().size(), 32U);
  for (const char* name : {"surface_front.png", "error_top.png", "standard_deviation_left.png",
                           "consistency_back.png", "coverage_bottom.png", "slice_divergence.png"})
    EXPECT_TRUE(names().contains(name)) << name;

  const auto middle_of = [&](const std::string& name) {
    const cv::Mat picture =
        cv::imread((folder_ / "pictures" / name).string(), cv::IMREAD_UNCHANGED);
    EXPECT_EQ(picture.channels(), 4);
    return picture.at<cv::Vec4b>(picture.rows / 2, picture.cols / 2);  // blue green red alpha
  };
  // Below nothing was observed: grey. Above it was, and lies inside the reference: blue.
  const auto below = middle_of("coverage_bottom.png"), above = middle_of("coverage_top.png");
  EXPECT_LT(std::abs(below[0] - below[2]), 6);
  EXPECT_GT(above[1], above[2] + 50);
  EXPECT_EQ(above[3], 255);
  const auto error = middle_of("error_top.png");
  EXPECT_GT(error[0], error[2] + 30);

  // Without a reference there is no error; what else lies in the folder is nobody's business.
  std::ofstream(folder_ / "pictures" / "light_map_000_old_c0_u.png") << "old";
  std::ofstream(folder_ / "pictures" / "holiday.png") << "sea";
  ASSERT_TRUE(write_report(make(), reconstructed.mesh, folder_.path()));
  EXPECT_EQ(names().size(), 27U);
  EXPECT_FALSE(names().contains("error_top.png"));
  EXPECT_FALSE(names().contains("light_map_000_old_c0_u.png"));
  EXPECT_EQ(text_of(folder_ / "pictures" / "holiday.png"), "sea");
}

/// A light map of 3 × 2 pixels with so many positions, from u = 0 on.
LightMap small_map(const StackKey& key, std::size_t positions) {
  LightMap map;
  map.key = key;
  map.region = {0, 0, 3, 2};
  map.resize_lists();
  for (std::size_t i = 0; i < 6; ++i) {
    const bool is_position = i < positions;
    const float none = std::numeric_limits<float>::quiet_NaN();
    map.label[i] = is_position ? Label::mirror : Label::saturated;
    map.u_px[i] = is_position ? static_cast<float>(i) * 63 / 5 : none;
    map.v_px[i] = is_position ? 31.0F : none;
    map.sigma_u_px[i] = map.sigma_v_px[i] = Imath::half(is_position ? 0.5F : none);
    map.contrast[i] = 100;
    map.bit_u[i] = map.bit_v[i] = is_position ? 0 : 6;
  }
  return map;
}

TEST_F(ReportOfAScan, ShowsALightMapOfEachDisplay) {
  const auto none = light_map_samples(*scan_);
  ASSERT_TRUE(none);
  EXPECT_TRUE(none->empty());
  ASSERT_TRUE(scan_->commit(small_map({1, "side", "c0"}, 6), {}));
  ASSERT_TRUE(scan_->commit(small_map({0, "side", "c1"}, 3), {}));
  ASSERT_TRUE(scan_->commit(small_map({0, "side", "c0"}, 6), {}));
  const auto samples = light_map_samples(*scan_);
  ASSERT_TRUE(samples) << samples.error().text();
  ASSERT_EQ(samples->size(), 1U);
  const LightMapSample& sample = samples->front();
  EXPECT_EQ(sample.map.key, (StackKey{0, "side", "c0"}));
  EXPECT_EQ(sample.display_width_px, 64);

  Report report = make();
  ASSERT_EQ(report.light_maps.size(), 1U);
  LightMap& shown = report.light_maps.front().map;
  shown = small_map({0, "side", "c0"}, 5);
  shown.label[4] = Label::direct_sight;
  ASSERT_TRUE(write_report(report, sphere_reconstructed(5).mesh, folder_.path()));
  const auto picture_of = [&](const std::string& axis) {
    return cv::imread((folder_ / "pictures/light_map_000_side_c0_").string() + axis + ".png",
                      cv::IMREAD_UNCHANGED);
  };
  const auto expect_pixel = [](const cv::Mat& picture, int row, int column, const Colour& colour) {
    const auto pixel = picture.at<cv::Vec4b>(row, column);
    EXPECT_NEAR(pixel[2], 255 * static_cast<double>(colour.r), 0.6);
    EXPECT_NEAR(pixel[1], 255 * static_cast<double>(colour.g), 0.6);
    EXPECT_NEAR(pixel[0], 255 * static_cast<double>(colour.b), 0.6);
    EXPECT_EQ(pixel[3], 255);
  };
  const cv::Mat u = picture_of("u"), v = picture_of("v");
  ASSERT_EQ(u.size(), cv::Size(3, 2));
  for (int i = 0; i < 4; ++i) {
    expect_pixel(u, i / 3, i % 3, at_share(kPlaces, static_cast<float>(i) / 5));
    expect_pixel(v, i / 3, i % 3, kPlaces.back());
  }
  expect_pixel(u, 1, 1, kDirect);
  EXPECT_EQ(u.at<cv::Vec4b>(1, 2)[3], 0);
}

TEST_F(ReportOfAScan, CaptureFiguresComeFromTheDirectory) {
  // The file's own grammar is tested with the scan; here only what is made of it.
  std::vector<FrameRecord> records(3);
  for (std::size_t i = 0; i < records.size(); ++i) {
    records[i].step = i;
    records[i].camera = "c0";
    records[i].display = "side";
    records[i].settings = manifest().cameras[0].settings;
    records[i].exposure_begin_us = 1'000'000 + 500'000 * static_cast<std::int64_t>(i);
    records[i].attempt = i == 1 ? 3 : 1;
    records[i].checksum = "0123456789abcdef";
  }
  std::ofstream log(folder_ / "scan/frames.jsonl");
  for (const FrameRecord& record : records) log << to_line(record) << "\n";
  log.close();
  const auto figures = capture_figures(*scan_);
  ASSERT_TRUE(figures) << figures.error().text();
  EXPECT_EQ(figures->frames, 3U);
  EXPECT_EQ(figures->retakes, 2U);
  EXPECT_DOUBLE_EQ(figures->duration_s, 1.0);
  std::uint64_t bytes = 0;
  for (const char* file : {"manifest.json", "rig.json", "frames.jsonl"})
    bytes += fs::file_size(folder_ / "scan" / file);
  EXPECT_EQ(figures->bytes, bytes);
}

TEST(Draw, SphereFillsTheRightDisc) {
  const Mesh mesh = sphere_mesh(10, {5, 6, 7}, 5);
  for (const ViewDirection& view : six_views()) {
    const DrawnView drawn(mesh, view, {5, 6, 7}, 40, 100);
    // Red where the vertex faces the viewer: every seen cell must be red.
    const Vector3d toward = view.right.cross(view.up);
    const Picture8 picture = drawn.coloured(
        [&](std::uint32_t i) {
          return mesh.normals[i].cast<double>().dot(toward) > -0.1 ? Colour{1, 0, 0}
                                                                   : Colour{0, 1, 0};
        },
        0);
    double area_px = 0;
    for (const auto& [r, g, b, a] : picture.pixels) {
      area_px += a / 255.0;
      if (a > 0) {
        EXPECT_EQ(r, 255) << view.name;
        EXPECT_EQ(g, 0) << view.name;
      }
    }
    EXPECT_NEAR(area_px, 3.14159 * 25 * 25, 20) << view.name;
  }
}

TEST(Draw, PutsRightRightAndUpUp) {
  // A small triangle beside the centre must appear on the view's right and upper side.
  for (const ViewDirection& view : six_views()) {
    Mesh mesh;
    for (const auto& [x, y] : {std::pair{2.0, 2.0}, {3.0, 2.0}, {2.0, 3.0}})
      mesh.vertices_mm.emplace_back(x * view.right + y * view.up);
    mesh.triangles = {{0, 1, 2}};
    const Picture8 picture =
        DrawnView(mesh, view, {0, 0, 0}, 10, 50).coloured([](std::uint32_t) { return kClay; }, 1);
    std::size_t seen = 0;
    for (std::size_t i = 0; i < picture.pixels.size(); ++i) {
      if (picture.pixels[i][3] == 0) continue;
      ++seen;
      EXPECT_GE(i % 50, 34U) << view.name;
      EXPECT_LE(i / 50, 15U) << view.name;
    }
    EXPECT_NEAR(static_cast<double>(seen), 12.5, 8) << view.name;
  }
}

TEST(Draw, HalvedIsTheMeanOfWhatCovers) {
  Picture8 picture{4, 2, {}};
  picture.pixels.resize(8);
  picture.pixels[0] = picture.pixels[1] = {200, 100, 0, 255};
  picture.pixels[4] = {0, 100, 200, 255};  // its fourth neighbour covers nothing
  const Picture8 half = halved(picture);
  ASSERT_EQ(half.width, 2);
  ASSERT_EQ(half.height, 1);
  EXPECT_EQ(half.pixels[0], (std::array<std::uint8_t, 4>{133, 100, 67, 191}));
  EXPECT_EQ(half.pixels[1], (std::array<std::uint8_t, 4>{0, 0, 0, 0}));
}

TEST(Draw, Base64IsThatOfTheStandard) {
  // Test vectors of RFC 4648, section 10.
  EXPECT_EQ(base64(""), "");
  EXPECT_EQ(base64("f"), "Zg==");
  EXPECT_EQ(base64("fo"), "Zm8=");
  EXPECT_EQ(base64("foo"), "Zm9v");
  EXPECT_EQ(base64("foob"), "Zm9vYg==");
  EXPECT_EQ(base64("foobar"), "Zm9vYmFy");
}

}  // namespace
}  // namespace alhazen
