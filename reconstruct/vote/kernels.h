#pragma once

#include <cstddef>
#include <cstdint>

/// The inner loops of voting, for every instruction set of the machine it was built for, chosen at
/// run time (Highway); its scalar target is the reference. All lists that a kernel reads or writes
/// have kPadding elements more than the count says. Reentrant.
namespace alhazen::kernels {

/// The most lanes any target works on together.
constexpr std::size_t kPadding = 16;

/// Where points near a centre are seen by one camera: the second order Taylor polynomial of the
/// pixel in the offset (x, y, z) from the centre. Order of terms: 1 x y z xx yy zz xy xz yz.
struct LocalProjection {
  float x_px[10], y_px[10];
};

/// Writes the pixels of `count` offsets; the padding gets pixels that no map has.
void project(const LocalProjection& projection, const float* x_mm, const float* y_mm,
             const float* z_mm, std::size_t count, float* x_px, float* y_px);

/// What look_up() needs of one observation. Vectors relative to the same centre.
struct MapView {
  const float* uv_px = nullptr;
  const std::int32_t* row_pair = nullptr;  ///< as in Observation
  const std::uint32_t* cells = nullptr;
  float box_x = 0, box_y = 0;
  int width = 0, height = 0;
  float origin_mm[3], u_mm[3], v_mm[3];  ///< of the display
  float eye_mm[3];
  float min_cosine = 0;
};

/// Votes of one observation, in the order of the points.
struct VoteList {
  std::uint32_t* point = nullptr;
  float *x = nullptr, *y = nullptr, *z = nullptr;  ///< unit normals, object frame
};

/// The hypotheses n = norm(l + v) of all points whose pixel lies in a valid cell, the light map
/// interpolated bilinearly; without those seen at an incidence whose cosine is below min_cosine.
/// `scratch`: 3 (count + kPadding) floats. Returns the number of votes.
std::size_t look_up(const MapView& map, const float* x_mm, const float* y_mm, const float* z_mm,
                    const float* x_px, const float* y_px, std::size_t count, float* scratch,
                    const VoteList& votes);

/// A mode of the density of unit vectors.
struct Mode {
  float x = 0, y = 0, z = 0;
  float support = 0;  ///< Σ k(|n_v − N|), 1 for a vote at the mode itself
};

/// The highest mode of Σ k(|n_v − n|) over `count` unit vectors, k Gaussian: mean shift from the
/// vote of highest density among at most 32 evenly picked ones, and from the best one beyond 3h of
/// it. The lists are overwritten beyond `count` (padding). Nothing above `min_support` at any seed:
/// the best seed itself.
Mode mean_shift(float* x, float* y, float* z, std::size_t count, float bandwidth_rad,
                float min_support);
/// The same with Epanechnikov's kernel, whose mean shift is the mean of what lies within √6 h.
Mode mean_shift_epanechnikov(float* x, float* y, float* z, std::size_t count, float bandwidth_rad,
                             float min_support);

/// The mean of the votes in the fullest cell; its support is their number. Cells are squares of 2h
/// of the octahedral map of the sphere onto a square (Cigolle et al., JCGT 3(2), 2014), so they are
/// not equally large on the sphere. `scratch` holds `count` words.
Mode histogram_mode(const float* x, const float* y, const float* z, std::size_t count,
                    float bandwidth_rad, std::uint64_t* scratch);

}  // namespace alhazen::kernels
