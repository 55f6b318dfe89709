#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/normals/normal_map.h"
#include "reconstruct/run.h"

namespace alhazen {

/// A light by which one picture was taken, camera frame.
struct Light {
  /// Towards the light (any length but zero), or where it is, mm.
  Eigen::Vector3d vector = -Eigen::Vector3d::UnitZ();
  bool is_near = false;  ///< true: `vector` is a position
  double intensity = 1;  ///< relative; above 0
};

/// Pictures of one camera that stands still, one a light. Every list is height × width, row-major.
struct LightStack {
  int width = 0, height = 0;
  std::vector<Light> lights;
  /// Per light: linear intensities, 1 = full scale.
  std::vector<std::vector<float>> intensity;
  std::vector<std::uint8_t> mask;  ///< 1: object
  /// Camera frame, mm: about where each object pixel's surface lies. Needed where a light is near;
  /// empty otherwise.
  std::vector<Eigen::Vector3f> point_mm;
};

/// Tunables of photometric_stereo().
struct StereoOptions {
  /// Too bright: at or above this the sensor may have been full. Share of full scale, (0, 1].
  double saturated = 0.98;
  /// Too dark: intensities below this share of the pixel's brightest are shadow. [0, 1).
  double dark_share = 0.08;
  /// Too bright: this share of a pixel's remaining lights, the brightest against what a first fit
  /// expects, is left out as gloss before the robust rounds. [0, 0.5].
  double bright_share = 0.1;
  /// Rounds of reweighting by Tukey's biweight; 0: plain least squares on what was not rejected.
  /// 0 … 50.
  int rounds = 10;
  /// Standard deviation that an intensity has at least. Share of full scale, [0, 1].
  double noise = 0.002;
  /// A normal needs so many lights that agree. 3 … 1000.
  int min_lights = 4;
  /// … and lights that are not all in one plane: largest condition of Σ w l lᵀ. Above 1.
  double max_condition = 400;
};

/// Normals with what else is found.
struct StereoMap {
  NormalMap map;                      ///< region: the whole picture; noise_rad: median of sigma_rad
  std::vector<float> albedo;          ///< relative; 0 where there is no normal
  std::vector<float> residual;        ///< RMS of the intensities that count, share of the albedo
  std::vector<float> sigma_rad;       ///< standard deviation of the normal by the residual
  std::vector<std::uint16_t> lights;  ///< that count
};

/// Normals from shading: I_k = ρ n·l_k for each pixel, by least squares over the lights that are
/// neither too dark (shadow) nor too bright (gloss, full pixels), then reweighted by Tukey's
/// biweight. A near light at p arrives from p − x with intensity · (D/|p − x|)², D being its
/// distance from the middle of all points.
/// Pixels without enough lights are labelled unknown, pixels outside the mask background.
///
/// Fails: invalid (fewer than three lights, lists of another length, an intensity or light that is
/// not finite, near lights without points, no object pixel, options out of range), cancelled.
/// Reentrant; uses the caller's TBB arena; the result does not depend on the number of threads.
/// Source: Woodham, Optical Engineering 19(1), 1980; rejection of too bright and too dark
/// intensities after M. Weinmann's thesis, chapter 5.
[[nodiscard]] Result<StereoMap> photometric_stereo(const LightStack& stack,
                                                   const StereoOptions& options, const Run& run);

/// The directional light by which each picture of a mirror ball was taken, from its highlight: seen
/// from afar (parallel sight lines along +z). `intensity`: per picture, height × width, row-major;
/// `mask`: 1 on the ball, whose outline must be whole. Lights have intensity 1.
/// Fails: invalid (lists of another length, no ball, a picture without a highlight, naming it).
[[nodiscard]] Result<std::vector<Light>> lights_of_mirror_ball(
    int width, int height, const std::vector<std::vector<float>>& intensity,
    const std::vector<std::uint8_t>& mask);

}  // namespace alhazen
