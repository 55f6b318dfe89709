#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/mesh_io/mesh.h"
#include "reconstruct/report/colour.h"

namespace alhazen {

/// A direction to look at an object from, without perspective: right-handed, right × up points at
/// the viewer.
struct ViewDirection {
  const char* name;
  Eigen::Vector3d right, up;
};

/// Object frame, z up: front looks along +y.
[[nodiscard]] std::array<ViewDirection, 6> six_views();

/// Eight-bit red, green, blue, alpha; top row first.
struct Picture8 {
  int width = 0, height = 0;
  std::vector<std::array<std::uint8_t, 4>> pixels;
};

/// What each cell of a view shows: drawn once, coloured several ways. Reentrant.
class DrawnView {
 public:
  /// side_px × side_px; `extent_mm` of the object fit across, `centre_mm` in the middle.
  /// REQUIRES: indices within the vertices.
  DrawnView(const Mesh& mesh, const ViewDirection& view, const Eigen::Vector3d& centre_mm,
            double extent_mm, int side_px);

  /// Lit from above the viewer's left shoulder, edges smooth, clear where there is no object.
  /// `relief` 0 … 1: how much the light models the form (less keeps colours readable).
  /// `colour`: of a vertex.
  [[nodiscard]] Picture8 coloured(const std::function<Colour(std::uint32_t vertex)>& colour,
                                  float relief) const;

 private:
  static constexpr int kSamples = 2;  ///< per pixel and axis
  static constexpr std::uint32_t kNone = 0xffffffff;
  struct Hit {
    std::uint32_t triangle = kNone;
    float weight_b = 0, weight_c = 0;
    float shaded = 0;  ///< how bright light makes it where it models the form fully
  };
  [[nodiscard]] float shaded(const Hit& hit) const;

  const Mesh& mesh_;
  Eigen::Vector3d right_, up_, toward_;
  int side_px_;
  std::vector<Hit> hits_;
};

/// Half as wide and high, each pixel the mean of four. REQUIRES: even width and height.
[[nodiscard]] Picture8 halved(const Picture8& picture);

/// The bytes of a PNG file. Fails: internal, exhausted.
[[nodiscard]] Result<std::string> to_png(const Picture8& picture);

/// RFC 4648, with padding.
[[nodiscard]] std::string base64(std::string_view bytes);

}  // namespace alhazen
