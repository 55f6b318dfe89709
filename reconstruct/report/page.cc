#include "reconstruct/report/page.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>
#include <utility>

#include "reconstruct/report/colour.h"
#include "reconstruct/report/draw.h"
#include "reconstruct/report/embedded.h"
#include "reconstruct/report/number_text.h"
#include "reconstruct/report/scene.h"

namespace alhazen {
namespace {

// Of the mesh that can be turned: two megabytes of a page, and smooth on modest graphics.
constexpr std::size_t kMostTriangles = 150'000;

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
.view{display:grid;grid-template-columns:minmax(0,1fr) 232px;margin:18px 0 22px;border:1px solid var(--line);border-radius:8px;overflow:hidden}
.stage{position:relative;min-height:520px;background:radial-gradient(120% 95% at 50% 38%,#fff 0,#f3f5f4 55%,#e3e7e6 100%)}
.stage canvas{position:absolute;inset:0;width:100%;height:100%;cursor:grab;touch-action:none;outline:none}
.stage canvas:active{cursor:grabbing}.stage canvas:focus-visible{box-shadow:inset 0 0 0 2px var(--accent)}
.scale{position:absolute;left:16px;bottom:12px;border:1px solid var(--soft);border-top:0;height:6px;font-size:11px;line-height:1;color:var(--soft);display:flex;justify-content:center;align-items:flex-end;padding-bottom:9px;pointer-events:none;font-variant-numeric:tabular-nums}
.panel{padding:4px 18px 14px;border-left:1px solid var(--line);background:#fff;display:flex;flex-direction:column}
.panel h2{margin:14px 0 6px}.panel p{font-size:12px;line-height:1.4}
.colourings label{display:flex;align-items:center;gap:8px;padding:3px 0;cursor:pointer}
.colourings input{accent-color:var(--accent);margin:0}
.legend .flat{height:10px}.legend .ends{margin-top:3px;gap:6px}.legend .ends span:last-child{text-align:right}
.grey{font-size:11px;color:var(--soft);margin-top:6px}.grey i{display:inline-block;width:10px;height:10px;border-radius:2px;margin-right:6px;background:#787579}
.sides{display:grid;grid-template-columns:repeat(3,1fr);gap:4px}
.sides button{font:inherit;font-size:12px;color:var(--ink);background:var(--pale);border:1px solid var(--line);border-radius:4px;padding:3px 0;cursor:pointer}
.sides button:hover{border-color:var(--accent);color:var(--accent)}
.sides button:focus-visible,.colourings input:focus-visible{outline:2px solid var(--accent);outline-offset:1px}
.help{margin:10px 0 0}.legend.none{visibility:hidden}
[hidden]{display:none!important}
.view[data-state=ready] .off{display:none}
.view:not([data-state=ready]){display:block}.view:not([data-state=ready]) .stage,.view:not([data-state=ready]) .panel{display:none}
.off{margin:0;padding:14px 18px;background:var(--pale)}
.maps{display:grid;grid-template-columns:repeat(auto-fill,minmax(180px,1fr));gap:14px}
.maps img{aspect-ratio:1;object-fit:contain}
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
@media (max-width:900px){.columns,.two,.view{grid-template-columns:1fr}.stage{min-height:min(520px,72vh)}.panel{border-left:0;border-top:1px solid var(--line)}}
@media print{main{padding:0}h2{margin-top:14px}.view{display:none}}
)";

// three.js asks that every copy carries this; its packaged text does not.
constexpr std::string_view kThreeLicence = R"(<!-- The script that follows is three.js.
The MIT License. Copyright © 2010-2019 three.js authors
Permission is hereby granted, free of charge, to any person obtaining a copy of this software and associated documentation files (the "Software"), to deal in the Software without restriction, including without limitation the rights to use, copy, modify, merge, publish, distribute, sublicense, and/or sell copies of the Software, and to permit persons to whom the Software is furnished to do so, subject to the following conditions:
The above copyright notice and this permission notice shall be included in all copies or substantial portions of the Software.
THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY, FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM, OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE SOFTWARE.
-->
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

std::string image(const Pictures& pictures, const std::string& name, const std::string& shows) {
  const StillPicture& picture = pictures.at(name);
  return "<img alt=\"" + shows + "\" src=\"data:image/png;base64," +
         base64(picture.small.empty() ? picture.file : picture.small) + "\">";
}

/// The colours of a row from top to bottom, with their meaning.
std::string upright_bar(const Colouring& colouring) {
  if (colouring.stops.empty()) return "";
  return "<div class=\"bar\"><i style=\"background:" + gradient("to top", colouring.stops) +
         "\"></i><div><span>" + colouring.labels[2] + "</span><span>" + colouring.labels[1] +
         "</span><span>" + colouring.labels[0] + "</span></div></div>";
}

/// A script as a page's policy names it.
std::string allowed(const EmbeddedScript& script) {
  std::string digest;
  for (std::size_t i = 0; i + 1 < script.sha256.size(); i += 2)
    digest += static_cast<char>(std::stoi(std::string(script.sha256.substr(i, 2)), nullptr, 16));
  return "'sha256-" + base64(digest) + "'";
}

/// The mesh to turn, with its data and the scripts that draw it.
std::string turnable(const Mesh& mesh, std::span<const Colouring> colourings) {
  const DisplayMesh shown = simplified(mesh, kMostTriangles);
  const Scene scene = scene_of(mesh, shown, colourings);
  std::string detail = whole(shown.triangles.size()) + " triangles";
  if (shown.cell_mm > 0) {
    detail = "Simplified for display: " + detail + " of " + whole(mesh.triangles.size()) +
             ", vertices within " + length(shown.cell_mm) + " merged.";
  } else {
    detail += ", the whole mesh.";
  }
  return R"(<figure id="view" class="view">
<div class="stage"><span class="scale"></span></div>
<p class="off soft">The object can be turned here where scripts are allowed to run; the pictures below show it from six sides.</p>
<div class="panel">
<h2>Colours</h2>
<div class="colourings" role="radiogroup" aria-label="Colours"></div>
<p class="explained soft"></p>
<div class="legend"><div class="flat"></div><div class="ends"><span></span><span></span><span></span></div>
<div class="grey"><i></i>never measured, closed</div></div>
<h2>Sides</h2>
<div class="sides"></div>
<p class="soft help">Drag or arrow keys turn, with shift they move; pinch, + − or, after a click, the wheel zoom; 0 or a double click brings it back.</p>
<p class="soft help">)" +
         detail + R"(</p>
</div>
</figure>
<script type="application/json" id="scene-facts">)" +
         scene.facts + "</script>\n<script type=\"text/plain\" id=\"scene-data\">" +
         base64(scene.data) + "</script>\n" + std::string(kThreeLicence) + "<script>" +
         std::string(three_js().text) + "</script>\n<script>" + std::string(view_js().text) +
         "</script>\n";
}

std::string views(const Report& report, std::span<const Colouring> colourings,
                  const Pictures& pictures) {
  const auto six = six_views();
  std::string out = "<div class=\"views\">\n<span></span>";
  for (const ViewDirection& view : six)
    out += "<span class=\"head\">" + std::string(view.name) + "</span>";
  out += "\n";
  for (const Colouring& colouring : colourings) {
    out += "<div class=\"name\">" + colouring.name + "<small>" + colouring.explained + "</small>" +
           upright_bar(colouring) + "</div>\n";
    for (const ViewDirection& view : six)
      out +=
          image(pictures, view_name(colouring.file, view.name), colouring.name + ", " + view.name) +
          "\n";
  }
  return out + "</div>\n<p class=\"soft\">Each picture is " + fixed(views_extent_mm(report), 1) +
         " mm wide; z is up, front looks along +y. Grey was never measured and is closed.</p>\n";
}

/// A picture with the colours it is drawn in, their meaning, and a name.
std::string figure(const std::string& picture, std::span<const Colour> stops,
                   const std::array<std::string, 3>& labels, const std::string& name) {
  return "<figure>" + picture +
         "<div class=\"flat\" style=\"background:" + gradient("to right", stops) +
         "\"></div><div class=\"ends\"><span>" + labels[0] + "</span><span>" + labels[1] +
         "</span><span>" + labels[2] + "</span></div><figcaption>" + name +
         "</figcaption></figure>\n";
}

std::string slices(const Slice& slice, double edge_mm, const Pictures& pictures) {
  std::array<char, 32> end{};
  std::snprintf(end.data(), end.size(), "%g", divergence_limit_per_mm(slice));
  return "<h2>Slice through the middle</h2>\n<div class=\"slices\">\n" +
         figure(image(pictures, "slice_consistency", "slice of the consistency"), kSequential,
                {"0", "0.5", "1"}, "Surface consistency c") +
         figure(image(pictures, "slice_divergence", "slice of the divergence"), kDiverging,
                {"−" + std::string(end.data()), "0", "+" + std::string(end.data())},
                "Divergence of cN, 1/mm: positive just inside") +
         "</div>\n<p class=\"soft\">Vertical plane y = middle of the volume, " + fixed(edge_mm, 1) +
         " mm wide; the line is where the indicator passes ½.</p>\n";
}

std::string light_maps(std::span<const LightMapSample> samples, const Pictures& pictures) {
  if (samples.empty()) return "";
  std::string out = "<h2>Light maps</h2>\n<div class=\"maps\">\n";
  for (const LightMapSample& sample : samples) {
    const StackKey& key = sample.map.key;
    for (const char axis : {'u', 'v'}) {
      const int last_px = (axis == 'u' ? sample.display_width_px : sample.display_height_px) - 1;
      out += figure(image(pictures, light_map_picture_name(key, axis),
                          std::string("light map, ") + axis + " on " + escaped(key.display)),
                    kPlaces, {"0", std::string(1, axis), std::to_string(last_px) + " px"},
                    escaped(key.display) + " as " + escaped(key.camera) + " saw it");
    }
  }
  return out +
         "</div>\n<p class=\"soft\">Which column u and row v of a display each camera pixel " +
         "saw in the mirror at stop " + std::to_string(samples.front().map.key.stop) +
         ", by the camera that saw most. Grey: the display itself; white: nothing decoded.</p>\n";
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

std::string to_page(const Report& report, const Mesh& mesh, std::span<const Colouring> colourings,
                    const Pictures& pictures) {
  const Provenance& p = report.provenance;
  const std::string title = escaped(p.object_id.empty() ? p.scan_id : p.object_id);
  std::string page =
      "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; "
      "style-src 'unsafe-inline'; script-src " +
      allowed(three_js()) + " " + allowed(view_js()) +
      "\">\n<meta name=\"viewport\" content=\"width=device-width\">\n<title>" + title +
      " · Alhazen</title>\n<style>" + std::string(kStyle) + "</style></head>\n<body><main>\n";
  page += "<header><h1>" + title + "</h1><span class=\"soft text\">scanned by Alhazen · " +
          escaped(p.scan_id) + " · " + escaped(p.created_at) + "</span></header>\n";
  if (!p.note.empty()) page += "<p class=\"text\">" + escaped(p.note) + "</p>\n";
  page += tiles(report) + warnings(report);
  if (mesh.triangles.empty()) {
    page += "<p>The mesh is empty.</p>\n";
  } else {
    page += turnable(mesh, colourings) + views(report, colourings, pictures);
  }
  page += "<div class=\"columns\">\n<section>";
  if (report.slice) page += slices(*report.slice, report.reconstruction.volume.edge_mm, pictures);
  page += "</section>\n<section>" + numbers(report) + "</section>\n</div>\n";
  page += light_maps(report.light_maps, pictures) + timings(report) + provenance(report);
  if (!mesh.triangles.empty()) {
    page +=
        "<p class=\"soft\">The view that can be turned is drawn by three.js, © 2010–2019 "
        "three.js authors; its MIT licence stands in the source of this page.</p>\n";
  }
  return page + "</main></body></html>\n";
}

}  // namespace alhazen
