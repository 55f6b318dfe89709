#include "reconstruct/report/draw.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string_view>

#include "alhazen/caught.h"

namespace alhazen {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Brightness of a surface that turns `n` (viewer's frame: x right, y up, z to the viewer).
float light_on(const Vector3d& n) {
  static const Vector3d kKey = Vector3d(-0.45, 0.65, 0.75).normalized();
  static const Vector3d kFill = Vector3d(0.7, -0.1, 0.5).normalized();
  const double key = std::max(0.0, n.dot(kKey)), fill = std::max(0.0, n.dot(kFill));
  const double rim = std::pow(1 - std::clamp(n.z(), 0.0, 1.0), 3);
  return static_cast<float>(std::clamp(0.30 + 0.68 * key + 0.16 * fill - 0.12 * rim, 0.0, 1.1));
}

std::uint8_t to_byte(float value) {
  return static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0F, 1.0F) * 255));
}

}  // namespace

std::array<ViewDirection, 6> six_views() {
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  return {{{"front", x, z},
           {"right", y, z},
           {"back", -x, z},
           {"left", -y, z},
           {"top", x, y},
           {"bottom", x, -y}}};
}

DrawnView::DrawnView(const Mesh& mesh, const ViewDirection& view, const Vector3d& centre_mm,
                     double extent_mm, int side_px)
    : mesh_(mesh),
      right_(view.right),
      up_(view.up),
      toward_(view.right.cross(view.up)),
      side_px_(side_px) {
  const int side = side_px * kSamples;
  const auto cells = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
  hits_.resize(cells);
  std::vector<double> height(cells, -std::numeric_limits<double>::infinity());
  const double scale = side / std::max(extent_mm, 1e-9);

  std::vector<Vector3d> placed;  // cells to the right, cells down, mm to the viewer
  placed.reserve(mesh.vertices_mm.size());
  for (const Vector3d& p : mesh.vertices_mm) {
    const Vector3d d = p - centre_mm;
    placed.emplace_back(side / 2.0 + scale * d.dot(right_), side / 2.0 - scale * d.dot(up_),
                        d.dot(toward_));
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vector3d& a = placed[mesh.triangles[t][0]];
    const Vector3d& b = placed[mesh.triangles[t][1]];
    const Vector3d& c = placed[mesh.triangles[t][2]];
    const Vector2d ab = (b - a).head<2>(), ac = (c - a).head<2>();
    const double twice_area = cross(ab, ac);
    if (!(std::abs(twice_area) > 0)) continue;
    const Vector3d low = a.cwiseMin(b).cwiseMin(c), high = a.cwiseMax(b).cwiseMax(c);
    const auto first = [side](double x) {
      return static_cast<int>(std::clamp(std::ceil(x - 0.5), 0.0, static_cast<double>(side)));
    };
    const auto last = [side](double x) {
      return static_cast<int>(std::clamp(std::floor(x - 0.5), -1.0, side - 1.0));
    };
    for (int row = first(low.y()); row <= last(high.y()); ++row) {
      for (int column = first(low.x()); column <= last(high.x()); ++column) {
        const Vector2d d(column + 0.5 - a.x(), row + 0.5 - a.y());
        const double weight_b = cross(d, ac) / twice_area, weight_c = cross(ab, d) / twice_area;
        if (!(weight_b >= 0 && weight_c >= 0 && weight_b + weight_c <= 1)) continue;
        const double z = a.z() + weight_b * (b.z() - a.z()) + weight_c * (c.z() - a.z());
        const auto cell = static_cast<std::size_t>(row) * static_cast<std::size_t>(side) +
                          static_cast<std::size_t>(column);
        if (z <= height[cell]) continue;
        height[cell] = z;
        hits_[cell] = {static_cast<std::uint32_t>(t), static_cast<float>(weight_b),
                       static_cast<float>(weight_c), 0};
      }
    }
  }
  for (Hit& hit : hits_) {
    if (hit.triangle != kNone) hit.shaded = shaded(hit);
  }
}

float DrawnView::shaded(const Hit& hit) const {
  const auto& [a, b, c] = mesh_.triangles[hit.triangle];
  Vector3d n;
  if (mesh_.normals.empty()) {
    n = (mesh_.vertices_mm[b] - mesh_.vertices_mm[a])
            .cross(mesh_.vertices_mm[c] - mesh_.vertices_mm[a]);
  } else {
    n = ((1 - hit.weight_b - hit.weight_c) * mesh_.normals[a] + hit.weight_b * mesh_.normals[b] +
         hit.weight_c * mesh_.normals[c])
            .cast<double>();
  }
  n.normalize();
  return light_on({n.dot(right_), n.dot(up_), n.dot(toward_)});
}

Picture8 DrawnView::coloured(const std::function<Colour(std::uint32_t vertex)>& colour,
                             float relief) const {
  std::vector<Colour> of_vertex;
  of_vertex.reserve(mesh_.vertices_mm.size());
  for (std::size_t i = 0; i < mesh_.vertices_mm.size(); ++i)
    of_vertex.push_back(colour(static_cast<std::uint32_t>(i)));

  const auto lit = [&](const Hit& hit) {
    const auto& [a, b, c] = mesh_.triangles[hit.triangle];
    const float weight_a = 1 - hit.weight_b - hit.weight_c;
    const float light = 1 - relief * (1 - hit.shaded);
    const Colour &p = of_vertex[a], &q = of_vertex[b], &r = of_vertex[c];
    return Colour{light * (weight_a * p.r + hit.weight_b * q.r + hit.weight_c * r.r),
                  light * (weight_a * p.g + hit.weight_b * q.g + hit.weight_c * r.g),
                  light * (weight_a * p.b + hit.weight_b * q.b + hit.weight_c * r.b)};
  };

  Picture8 picture{side_px_, side_px_, {}};
  const auto side = static_cast<std::size_t>(side_px_);
  const auto samples = static_cast<std::size_t>(kSamples);
  picture.pixels.resize(side * side);
  for (std::size_t row = 0; row < side; ++row) {
    for (std::size_t column = 0; column < side; ++column) {
      Colour sum;
      int seen = 0;
      for (std::size_t s = 0; s < samples * samples; ++s) {
        const std::size_t y = row * samples + s / samples, x = column * samples + s % samples;
        const Hit& hit = hits_[y * side * samples + x];
        if (hit.triangle == kNone) continue;
        const Colour sample = lit(hit);
        sum = {sum.r + sample.r, sum.g + sample.g, sum.b + sample.b};
        ++seen;
      }
      if (seen == 0) continue;
      const auto count = static_cast<float>(seen);
      picture.pixels[row * side + column] = {
          to_byte(sum.r / count), to_byte(sum.g / count), to_byte(sum.b / count),
          to_byte(count / static_cast<float>(kSamples * kSamples))};
    }
  }
  return picture;
}

Picture8 halved(const Picture8& picture) {
  Picture8 half{picture.width / 2, picture.height / 2, {}};
  half.pixels.reserve(picture.pixels.size() / 4);
  const auto width = static_cast<std::size_t>(picture.width);
  for (std::size_t row = 0; row + 1 < static_cast<std::size_t>(picture.height); row += 2) {
    for (std::size_t column = 0; column + 1 < width; column += 2) {
      const std::size_t first = row * width + column;
      std::array<unsigned, 3> sum{};  // of colours by how much of a pixel they cover
      unsigned cover = 0;
      for (const std::size_t from : {first, first + 1, first + width, first + width + 1}) {
        const unsigned alpha = picture.pixels[from][3];
        cover += alpha;
        for (std::size_t k = 0; k < 3; ++k) sum[k] += alpha * picture.pixels[from][k];
      }
      std::array<std::uint8_t, 4> mean{};
      if (cover > 0) {
        for (std::size_t k = 0; k < 3; ++k)
          mean[k] = static_cast<std::uint8_t>((sum[k] + cover / 2) / cover);
      }
      mean[3] = static_cast<std::uint8_t>((cover + 2) / 4);
      half.pixels.push_back(mean);
    }
  }
  return half;
}

std::string base64(std::string_view bytes) {
  constexpr std::string_view kLetters =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k)
      group = group << 8U | (k < count ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      text += k <= count ? kLetters[group >> (18 - 6 * k) & 63U] : '=';
  }
  return text;
}

Result<std::string> to_png(const Picture8& picture) {
  return caught(Code::internal, "encoding a picture", [&]() -> Result<std::string> {
    cv::Mat image(picture.height, picture.width, CV_8UC4);
    for (int row = 0; row < picture.height; ++row) {
      for (int column = 0; column < picture.width; ++column) {
        const auto& [r, g, b, a] =
            picture.pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(picture.width) +
                           static_cast<std::size_t>(column)];
        image.at<cv::Vec4b>(row, column) = {b, g, r, a};
      }
    }
    std::vector<unsigned char> png;
    const std::vector<int> settings{cv::IMWRITE_PNG_COMPRESSION,
                                    6};  // 9: 4 % smaller in twice the time
    if (!cv::imencode(".png", image, png, settings))
      return Error{Code::internal, "a picture has no PNG"};
    return std::string(reinterpret_cast<const char*>(png.data()), png.size());
  });
}

}  // namespace alhazen
