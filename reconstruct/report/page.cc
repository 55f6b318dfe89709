#include "reconstruct/report/page.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <span>
#include <string_view>
#include <utility>

#include "alhazen/check.h"
#include "reconstruct/report/colour.h"
#include "reconstruct/report/draw.h"

namespace alhazen {
namespace {

constexpr int kView_px = 340;   // shown at about half of it: sharp on fine screens
constexpr int kSlice_px = 520;  // at least

constexpr std::string_view kStyle = R"(
:root{--ink:#1d2429;--soft:#5d6970;--line:#dfe3e4;--pale:#f5f6f5;--accent:#1c6c72}
*{box-sizing:border-box}
body{margin:0;background:#fff;color:var(--ink);font:14px/1.45 system-ui,"Segoe UI","DejaVu Sans",sans-serif}
main{max-width:1240px;margin:0 auto;padding:26px 30px 30px}
header{display:flex;align-items:baseline;gap:16px;flex-wrap:wrap;border-bottom:2px solid var(--ink);padding-bottom:8px}
h1{font-size:25px;font-weight:600;margin:0;letter-spacing:-.01em;overflow-wrap:anywhere}
h2{font-size:12px;font-weight:600;margin:22px 0 8px;text-transform:uppercase;letter-spacing:.08em;color:var(--soft)}
p{margin:6px 0}.soft{color:var(--soft)}.text{overflow-wrap:anywhere}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:1px;background:var(--line);border-bottom:1px solid var(--line)}
.tile{background:#fff;padding:13px 10px 11px 12px}.tile:first-child{padding-left:0}
.tile b{display:block;font-size:23px;font-weight:600;letter-spacing:-.02em;font-variant-numeric:tabular-nums}
.tile span{color:var(--soft);font-size:12.5px}
.views{display:grid;grid-template-columns:112px repeat(6,minmax(0,1fr));gap:4px 2px;align-items:center;margin-top:14px}
.views img{width:100%;display:block}
.views .head{font-size:12px;color:var(--soft);text-align:center}
.name{font-size:13px;font-weight:600}.name small{display:block;font-weight:400;font-size:11.5px;color:var(--soft);line-height:1.3}
.bar{display:flex;gap:6px;margin-top:6px;font-size:11px;font-weight:400;color:var(--soft);font-variant-numeric:tabular-nums}
.bar i{width:11px;height:82px;flex:none;border-radius:2px}
.bar div{display:flex;flex-direction:column;justify-content:space-between;line-height:1}
.columns{display:grid;grid-template-columns:minmax(0,1.06fr) minmax(0,1fr);gap:34px}
.slices{display:grid;grid-template-columns:1fr 1fr;gap:14px}
figure{margin:0}figure img{width:100%;display:block;border:1px solid var(--line)}
figcaption{font-size:12px;color:var(--soft);margin-top:5px}
.flat{height:8px;border-radius:2px;margin-top:6px}.ends{display:flex;justify-content:space-between;font-size:11px;color:var(--soft)}
table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
td,th{padding:3px 0 3px 10px;border-bottom:1px solid var(--line);text-align:right;font-weight:400;vertical-align:top}
th{color:var(--soft);font-size:12px}td:first-child,th:first-child{text-align:left;padding-left:0;color:var(--soft);white-space:nowrap}
table.text td{overflow-wrap:anywhere}
.time{display:flex;height:20px;border-radius:3px;overflow:hidden;gap:1px;background:#fff}
.time i{min-width:2px}
.key{display:flex;flex-wrap:wrap;gap:3px 20px;margin-top:8px;font-size:12.5px}
.key i{display:inline-block;width:10px;height:10px;border-radius:2px;margin-right:6px}
.warn{border-left:3px solid #b4531f;padding:2px 0 2px 10px;margin:6px 0}
.two{display:grid;grid-template-columns:1fr 1fr;gap:0 34px}
@media (max-width:900px){.columns,.two{grid-template-columns:1fr}}
@media print{main{padding:0}h2{margin-top:14px}}
)";

/// Text that a page shows and never obeys.
std::string escaped(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      case '\'':
        out += "&#39;";
        break;
      default: {
        const auto code = static_cast<unsigned char>(c);
        out += code < 0x20 || code == 0x7f ? ' ' : c;
      }
    }
  }
  return out;
}

std::string fixed(double value, int decimals) {
  std::array<char, 400> text{};
  std::snprintf(text.data(), text.size(), "%.*f", decimals, value);
  return text.data();
}

/// A length with the unit that suits it.
std::string length(double mm) {
  const double size = std::abs(mm);
  if (size < 0.1) return fixed(mm * 1000, size < 0.01 ? 2 : 1) + " µm";
  return fixed(mm, size < 10 ? 3 : 1) + " mm";
}

std::string share(double value) { return fixed(100 * value, 1) + " %"; }

/// 1234567 as 1 234 567, with thin spaces.
std::string whole(std::uint64_t value) {
  const std::string digits = std::to_string(value);
  std::string out;
  for (std::size_t i = 0; i < digits.size(); ++i) {
    if (i > 0 && (digits.size() - i) % 3 == 0) out += "&#8239;";
    out += digits[i];
  }
  return out;
}

std::string bytes(std::uint64_t count) {
  if (count < 1'000'000) return fixed(static_cast<double>(count) / 1e3, 1) + " kB";
  if (count < 1'000'000'000) return fixed(static_cast<double>(count) / 1e6, 1) + " MB";
  return fixed(static_cast<double>(count) / 1e9, 2) + " GB";
}

std::string seconds(double s) {
  if (s < 120) return fixed(s, s < 10 ? 2 : 1) + " s";
  if (s < 7200) return fixed(s / 60, 1) + " min";
  return fixed(s / 3600, 1) + " h";
}

/// The least of 1, 2, 5 × 10ⁿ that is not below a value: the ends of a colour bar.
double round_limit(double value) {
  if (!(value > 0)) return 1;
  const double ten = std::pow(10, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (value <= step * ten * (1 + 1e-9)) return step * ten;
  }
  return 10 * ten;
}

std::string gradient(std::string_view direction, std::span<const Colour> stops) {
  std::string css = "linear-gradient(" + std::string(direction);
  for (const Colour& c : stops) {
    const auto byte = [](float x) { return std::to_string(std::lround(x * 255)); };
    css += ",rgb(" + byte(c.r) + "," + byte(c.g) + "," + byte(c.b) + ")";
  }
  return css + ")";
}

std::string tile(const std::string& value, std::string_view name) {
  return "<div class=\"tile\"><b>" + value + "</b><span>" + std::string(name) + "</span></div>\n";
}

std::string tiles(const Report& report) {
  std::string out;
  if (report.comparison) {
    const Comparison& c = *report.comparison;
    if (c.observed) {
      out += tile(length(c.observed->rms_mm), "RMS of observed vertices");
      out += tile(length(c.observed->p90_mm), "90 % of them within");
      out += tile(length(c.observed->p99_mm), "99 % of them within");
    }
    out += tile(share(c.completeness_0_3mm), "of the truth within 0.3 mm, observed");
    out += tile(share(c.coverage_1mm), "of the truth within 1 mm, closed");
    if (c.observed_normals)
      out += tile(fixed(c.observed_normals->mean_deg, 2) + "°", "mean error of normals");
  } else {
    out += tile(share(report.mesh.observed_share), "of the surface observed");
    if (report.mesh.median_depth_sigma_mm)
      out += tile(length(*report.mesh.median_depth_sigma_mm), "median deviation of depth");
    if (report.mesh.median_consistency)
      out += tile(fixed(*report.mesh.median_consistency, 2), "median consistency");
    out += tile(fixed(report.mesh.check.area_mm2 / 100, 1) + " cm²", "area");
    out += tile(fixed(report.mesh.check.volume_mm3 / 1000, 1) + " cm³", "volume");
  }
  out += tile(length(report.reconstruction.voxel_mm), "voxel");
  return "<div class=\"tiles\">\n" + out + "</div>\n";
}

/// One row of six pictures with its name and colour bar.
struct Row {
  std::string name, explained, bar;
  std::function<Colour(std::uint32_t)> colour;
  float relief = 1;
};

std::string upright_bar(std::span<const Colour> stops, const std::string& top,
                        const std::string& middle, const std::string& bottom) {
  return "<div class=\"bar\"><i style=\"background:" + gradient("to top", stops) +
         "\"></i><div><span>" + top + "</span><span>" + middle + "</span><span>" + bottom +
         "</span></div></div>";
}

std::vector<Row> rows_of(const Report& report, const Mesh& mesh) {
  const auto is_observed = [&mesh](std::uint32_t i) {
    return mesh.observed.empty() || mesh.observed[i] != 0;
  };
  std::vector<Row> rows;
  rows.push_back({"Surface", "the mesh as it is", "", [](std::uint32_t) { return kClay; }, 1.0F});
  if (report.comparison && !report.comparison->signed_mm.empty()) {
    const Comparison& c = *report.comparison;
    ALHAZEN_CHECK(c.signed_mm.size() == mesh.vertices_mm.size());
    const double limit_mm = round_limit((c.observed ? *c.observed : c.all).p99_mm);
    rows.push_back({"Error", "signed distance to the reference; grey: not observed",
                    upright_bar(kDiverging, "+" + length(limit_mm) + " outside", "0",
                                "−" + length(limit_mm) + " inside"),
                    [&c, is_observed, limit_mm](std::uint32_t i) {
                      if (!is_observed(i)) return kUnobserved;
                      const auto limit = static_cast<float>(limit_mm);
                      return at_share(kDiverging, 0.5F + 0.5F * c.signed_mm[i] / limit);
                    },
                    0.35F});
  }
  if (!mesh.observed.empty() || !mesh.consistency.empty()) {
    const bool has_consistency = !mesh.consistency.empty();
    rows.push_back({"Coverage",
                    has_consistency ? "consistency where observed; grey: closed, not measured"
                                    : "dark: observed; grey: closed, not measured",
                    has_consistency ? upright_bar(kSequential, "1", "0.5", "0") : "",
                    [&mesh, is_observed, has_consistency](std::uint32_t i) {
                      if (!is_observed(i)) return kUnobserved;
                      return at_share(kSequential, has_consistency ? mesh.consistency[i] : 0.66F);
                    },
                    0.35F});
  }
  return rows;
}

Result<std::string> views(const Report& report, const Mesh& mesh) {
  if (mesh.vertices_mm.empty()) return std::string("<p>The mesh is empty.</p>\n");
  Eigen::Vector3d low = mesh.vertices_mm.front(), high = low;
  for (const auto& p : mesh.vertices_mm) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const double extent_mm = std::max(1.04 * (high - low).maxCoeff(), 1e-6);
  const std::vector<Row> rows = rows_of(report, mesh);
  const auto six = six_views();
  std::vector<std::vector<std::string>> pictures(rows.size());
  for (const ViewDirection& view : six) {
    const DrawnView drawn(mesh, view, (low + high) / 2, extent_mm, kView_px);
    for (std::size_t row = 0; row < rows.size(); ++row)
      pictures[row].push_back(
          ALHAZEN_TRY(to_data_uri(drawn.coloured(rows[row].colour, rows[row].relief))));
  }
  std::string out = "<div class=\"views\">\n<span></span>";
  for (const ViewDirection& view : six)
    out += "<span class=\"head\">" + std::string(view.name) + "</span>";
  out += "\n";
  for (std::size_t row = 0; row < rows.size(); ++row) {
    out += "<div class=\"name\">" + rows[row].name + "<small>" + rows[row].explained + "</small>" +
           rows[row].bar + "</div>\n";
    for (std::size_t i = 0; i < six.size(); ++i)
      out += "<img alt=\"" + rows[row].name + ", " + six[i].name + "\" src=\"" + pictures[row][i] +
             "\">\n";
  }
  return out + "</div>\n<p class=\"soft\">Each view is " + fixed(extent_mm, 1) +
         " mm wide; z is up, front looks along +y.</p>\n";
}

/// One cell a square of `scale` pixels; where the inside begins, a line.
Picture8 slice_picture(const Slice& slice, const Colour& line_colour,
                       const std::function<Colour(std::size_t cell)>& colour) {
  const int scale = std::max(1, (kSlice_px + slice.width - 1) / slice.width);
  Picture8 picture{slice.width * scale, slice.height * scale, {}};
  picture.pixels.reserve(static_cast<std::size_t>(picture.width) *
                         static_cast<std::size_t>(picture.height));
  const auto cell_at = [&](int row, int column) {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(slice.width) +
           static_cast<std::size_t>(column);
  };
  for (int y = 0; y < picture.height; ++y) {
    for (int x = 0; x < picture.width; ++x) {
      const int row = y / scale, column = x / scale;
      const std::size_t cell = cell_at(row, column);
      const bool is_inside = slice.inside[cell] >= 0.5F;
      const bool is_edge = (x % scale == 0 && column > 0 &&
                            is_inside != (slice.inside[cell_at(row, column - 1)] >= 0.5F)) ||
                           (y % scale == 0 && row > 0 &&
                            is_inside != (slice.inside[cell_at(row - 1, column)] >= 0.5F));
      const Colour c = is_edge ? line_colour : colour(cell);
      const auto byte = [](float v) { return static_cast<std::uint8_t>(std::lround(v * 255)); };
      picture.pixels.push_back({byte(c.r), byte(c.g), byte(c.b), 255});
    }
  }
  return picture;
}

std::string slice_figure(const std::string& uri, std::string_view name,
                         std::span<const Colour> stops, const std::string& left,
                         const std::string& middle, const std::string& right) {
  return "<figure><img alt=\"slice of " + std::string(name) + "\" src=\"" + uri +
         "\"><div class=\"flat\" style=\"background:" + gradient("to right", stops) +
         "\"></div><div class=\"ends\"><span>" + left + "</span><span>" + middle + "</span><span>" +
         right + "</span></div><figcaption>" + std::string(name) + "</figcaption></figure>\n";
}

Result<std::string> slices(const Slice& slice, double edge_mm) {
  std::vector<float> sizes;
  for (const float d : slice.divergence_per_mm) {
    if (d != 0) sizes.push_back(std::abs(d));
  }
  double limit = 1;
  if (!sizes.empty()) {
    // A few cells on crossing surfaces reach far beyond the rest.
    const auto at = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() * 98 / 100);
    std::nth_element(sizes.begin(), at, sizes.end());
    limit = round_limit(static_cast<double>(*at));
  }
  const std::string consistency =
      ALHAZEN_TRY(to_data_uri(slice_picture(slice, {0.86F, 0.33F, 0.10F}, [&](std::size_t cell) {
        return at_share(kSequential, slice.consistency[cell]);
      })));
  const std::string divergence =
      ALHAZEN_TRY(to_data_uri(slice_picture(slice, {0.10F, 0.10F, 0.12F}, [&](std::size_t cell) {
        const auto at = static_cast<float>(limit);
        return at_share(kDiverging, 0.5F + 0.5F * slice.divergence_per_mm[cell] / at);
      })));
  std::array<char, 32> end{};
  std::snprintf(end.data(), end.size(), "%g", limit);
  return "<h2>Slice through the middle</h2>\n<div class=\"slices\">\n" +
         slice_figure(consistency, "Surface consistency c", kSequential, "0", "0.5", "1") +
         slice_figure(divergence, "Divergence of cN, 1/mm: positive just inside", kDiverging,
                      "−" + std::string(end.data()), "0", "+" + std::string(end.data())) +
         "</div>\n<p class=\"soft\">Vertical plane y = middle of the volume, " + fixed(edge_mm, 1) +
         " mm wide; the line is where the indicator passes ½.</p>\n";
}

/// A table row: name, value.
std::string line(std::string_view name, const std::string& value) {
  return "<tr><td>" + std::string(name) + "</td><td>" + value + "</td></tr>\n";
}

std::string distances(const Comparison& c) {
  const auto row = [](std::string_view name, const DistanceFigures& f) {
    return "<tr><td>" + std::string(name) + "</td><td>" + length(f.rms_mm) + "</td><td>" +
           length(f.p90_mm) + "</td><td>" + length(f.p99_mm) + "</td><td>" + length(f.max_mm) +
           "</td></tr>\n";
  };
  std::string out =
      "<table><tr><th>Distances</th><th>RMS</th><th>90 %</th><th>99 %</th><th>max</th></tr>\n";
  if (c.observed) out += row("observed → reference", *c.observed);
  out += row("all → reference", c.all) + row("reference → mesh", c.reference_to_mesh);
  out += "</table>\n<table>";
  out += line("Hausdorff distance", length(c.hausdorff_mm));
  if (c.observed) out += line("mean signed distance, observed", length(c.bias_mm));
  if (c.observed_normals)
    out += line("error of normals, mean · 90 %", fixed(c.observed_normals->mean_deg, 2) + "° · " +
                                                     fixed(c.observed_normals->p90_deg, 2) + "°");
  out += line("complete within 0.3 mm (observed)", share(c.completeness_0_3mm));
  out += line("complete within 1 mm (closed)", share(c.coverage_1mm));
  return out + "</table>\n";
}

std::string numbers(const Report& report) {
  std::string out = "<h2>Numbers</h2>\n";
  if (report.comparison) {
    out += distances(*report.comparison);
    if (!report.reference.empty())
      out += "<p class=\"soft text\">Reference: " + escaped(report.reference) +
             ", no alignment.</p>\n";
  }
  const MeshFigures& m = report.mesh;
  out += "<table>";
  out += line("vertices · triangles", whole(m.vertices) + " · " + whole(m.triangles));
  out += line("closed, manifold, oriented",
              m.check.closed() ? "yes"
                               : "no: " + whole(m.check.boundary_edges) + " open, " +
                                     whole(m.check.non_manifold_edges) + " crowded, " +
                                     whole(m.check.inconsistent_edges) + " twisted edges, " +
                                     whole(m.check.degenerate_triangles) + " empty triangles");
  out += line("components · Euler number",
              whole(m.check.components) + " · " + std::to_string(m.check.euler));
  out += line("size", fixed(m.high_mm.x() - m.low_mm.x(), 2) + " × " +
                          fixed(m.high_mm.y() - m.low_mm.y(), 2) + " × " +
                          fixed(m.high_mm.z() - m.low_mm.z(), 2) + " mm");
  out += line("area · volume", fixed(m.check.area_mm2 / 100, 2) + " cm² · " +
                                   fixed(m.check.volume_mm3 / 1000, 2) + " cm³");
  out += line("observed share of the area", share(m.observed_share));
  if (m.median_depth_sigma_mm)
    out += line("median deviation of depth, observed", length(*m.median_depth_sigma_mm));
  return out + "</table>\n";
}

std::string timings(const Report& report) {
  struct Part {
    std::string name;
    const StageTime* time;
  };
  std::vector<Part> parts;
  double sum_s = 0;
  for (const auto& [group, times] : {std::pair{"scan", &report.capture.times},
                                     {"reconstruction", &report.reconstruction.times}}) {
    for (const StageTime& time : *times) {
      parts.push_back({std::string(group) + ": " + escaped(time.stage), &time});
      sum_s += time.cpu_s;
    }
  }
  if (parts.empty()) return "";
  constexpr std::array<const char*, 8> kColours{"#1c6c72", "#d98a4b", "#6d8fb5", "#a9b665",
                                                "#8a5a83", "#4f9a94", "#c9665c", "#8c8c86"};
  std::string bar, key;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const std::string colour = kColours[i % kColours.size()];
    bar += "<i style=\"background:" + colour +
           ";flex:" + fixed(sum_s > 0 ? 1000 * parts[i].time->cpu_s / sum_s : 1, 2) + " 0 0\"></i>";
    key += "<span><i style=\"background:" + colour + "\"></i>" + parts[i].name + " <b>" +
           seconds(parts[i].time->cpu_s) + "</b> <span class=\"soft\">(" +
           seconds(parts[i].time->wall_s) + " by the clock)</span></span>\n";
  }
  return "<h2>CPU time: " + seconds(sum_s) + "</h2>\n<div class=\"time\">" + bar +
         "</div>\n<div class=\"key\">\n" + key + "</div>\n";
}

std::string provenance(const Report& report) {
  const Provenance& p = report.provenance;
  const CaptureFigures& c = report.capture;
  const ReconstructionFigures& r = report.reconstruction;
  std::string out = "<h2>Provenance</h2>\n<div class=\"two\">\n<table class=\"text\">";
  out += line("scan", escaped(p.scan_id));
  out += line("begun", escaped(p.created_at));
  out += line("operator", escaped(p.operator_name));
  out += line("software", escaped(p.software_version));
  out += line("calibration of the rig", escaped(p.rig_hash));
  if (report.refinement) {
    const Refinement& how = *report.refinement;
    out += line("refined from its reflections",
                std::string(how.is_accepted ? "yes" : "no, kept") +
                    "; votes at points not used disagree by " +
                    fixed(1000 * how.held_out_after.median_rad, 3) + " mrad, before " +
                    fixed(1000 * how.held_out_before.median_rad, 3));
  }
  out += line("plan", whole(p.cameras) + " cameras × " + whole(p.stops) + " stops × " +
                          whole(p.displays) + " displays, " + escaped(p.coding));
  out += "</table>\n<table>";
  out += line("frames · taken again", whole(c.frames) + " · " + whole(c.retakes));
  out += line("light maps", whole(p.light_maps) + " of " + whole(p.light_maps_planned));
  if (p.normal_maps > 0) out += line("normal maps", whole(p.normal_maps));
  out += line("duration of the capture", seconds(c.duration_s));
  out += line("scan directory", bytes(c.bytes));
  out += line("volume · leaves", fixed(r.volume.edge_mm, 1) + " mm, level " +
                                     std::to_string(r.level) + " · " + whole(r.leaves));
  out +=
      line("hypotheses · cut",
           whole(r.hypotheses) + " · " + std::to_string(r.cut_iterations) + " iterations, gap " +
               fixed(r.cut_energy != 0 ? 100 * r.cut_gap / std::abs(r.cut_energy) : 0, 3) + " %");
  return out + "</table>\n</div>\n";
}

std::string warnings(const Report& report) {
  constexpr std::size_t kShown = 20;  // the rest stands in report.json
  std::string out;
  std::size_t count = 0;
  for (const auto* list : {&report.capture.warnings, &report.reconstruction.warnings}) {
    for (const std::string& warning : *list) {
      if (++count <= kShown) out += "<p class=\"warn text\">" + escaped(warning) + "</p>\n";
    }
  }
  if (count > kShown) out += "<p class=\"soft\">and " + whole(count - kShown) + " more</p>\n";
  return out;
}

}  // namespace

Result<std::string> to_page(const Report& report, const Mesh& mesh) {
  const Provenance& p = report.provenance;
  const std::string title = escaped(p.object_id.empty() ? p.scan_id : p.object_id);
  std::string page =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; "
      "style-src 'unsafe-inline'\">\n"
      "<meta name=\"viewport\" content=\"width=device-width\">\n<title>" +
      title + " · Alhazen</title>\n<style>" + std::string(kStyle) +
      "</style></head>\n<body><main>\n";
  page += "<header><h1>" + title + "</h1><span class=\"soft text\">scanned by Alhazen · " +
          escaped(p.scan_id) + " · " + escaped(p.created_at) + "</span></header>\n";
  if (!p.note.empty()) page += "<p class=\"text\">" + escaped(p.note) + "</p>\n";
  page += tiles(report) + warnings(report) + ALHAZEN_TRY(views(report, mesh));
  page += "<div class=\"columns\">\n<section>";
  if (report.slice)
    page += ALHAZEN_TRY(slices(*report.slice, report.reconstruction.volume.edge_mm));
  page += "</section>\n<section>" + numbers(report) + "</section>\n</div>\n";
  page += timings(report) + provenance(report);
  return page + "</main></body></html>\n";
}

}  // namespace alhazen
