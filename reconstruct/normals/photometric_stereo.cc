#include "reconstruct/normals/photometric_stereo.h"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <string>
#include <utility>

namespace alhazen {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// The median of absolute values of Gaussian noise, times this, is its standard deviation; Tukey's
/// constant for 95 % efficiency.
constexpr double kMad = 1.4826, kTukey = 4.685;
/// Σ w r² / Σ w of Gaussian residuals, Tukey's weights taken: 1 − 6/c² + 15/c⁴ over 1 − 2/c² +
/// 3/c⁴.
constexpr double kClipped = 0.828;
/// Reweighting has settled where the normal turns by less than this.
constexpr double kSettled_rad = 1e-5;

Error invalid(std::string what) { return {Code::invalid, std::move(what)}; }

Status check(const StereoOptions& options) {
  struct Allowed {
    const char* name;
    double value, low, high;
  };
  const Allowed all[] = {{"saturated", options.saturated, 1e-6, 1},
                         {"dark_share", options.dark_share, 0, 0.99},
                         {"bright_share", options.bright_share, 0, 0.5},
                         {"rounds", static_cast<double>(options.rounds), 0, 50},
                         {"noise", options.noise, 0, 1},
                         {"min_lights", static_cast<double>(options.min_lights), 3, 1000},
                         {"max_condition", options.max_condition, 1, 1e12}};
  for (const Allowed& option : all) {
    if (option.value >= option.low && option.value <= option.high) continue;
    return invalid(std::string("stereo.") + option.name + " is " + std::to_string(option.value) +
                   ", allowed " + std::to_string(option.low) + " to " +
                   std::to_string(option.high));
  }
  return {};
}

Status check(const LightStack& stack) {
  const auto size = static_cast<std::size_t>(stack.width) * static_cast<std::size_t>(stack.height);
  if (stack.width < 1 || stack.height < 1) return invalid("the pictures are empty");
  if (stack.lights.size() < 3 || stack.lights.size() > 65535) {
    return invalid(std::to_string(stack.lights.size()) +
                   " lights; photometric stereo needs 3 to 65535");
  }
  if (stack.intensity.size() != stack.lights.size()) {
    return invalid(std::to_string(stack.intensity.size()) + " pictures for " +
                   std::to_string(stack.lights.size()) + " lights");
  }
  if (stack.mask.size() != size) {
    return invalid("the mask has " + std::to_string(stack.mask.size()) + " pixels, not " +
                   std::to_string(size));
  }
  if (std::all_of(stack.mask.begin(), stack.mask.end(), [](std::uint8_t m) { return m == 0; })) {
    return invalid("the mask holds no object pixel");
  }
  bool has_near = false;
  for (std::size_t k = 0; k < stack.lights.size(); ++k) {
    const Light& light = stack.lights[k];
    const std::string name = "light " + std::to_string(k);
    if (!light.vector.allFinite() || !(light.vector.norm() > 1e-12)) {
      return invalid(name + ": its vector must be finite and not zero");
    }
    if (!(light.intensity > 0 && std::isfinite(light.intensity))) {
      return invalid(name + ": its intensity is " + std::to_string(light.intensity) +
                     ", it must be above 0");
    }
    if (stack.intensity[k].size() != size) {
      return invalid(name + ": its picture has " + std::to_string(stack.intensity[k].size()) +
                     " pixels, not " + std::to_string(size));
    }
    for (std::size_t i = 0; i < size; ++i) {
      if (stack.mask[i] != 0 && !std::isfinite(stack.intensity[k][i])) {
        return invalid(name + ": pixel " + std::to_string(i) + " is not finite");
      }
    }
    has_near = has_near || light.is_near;
  }
  if (has_near && stack.point_mm.size() != size) {
    return invalid("a near light needs to know where each pixel's surface lies, " +
                   std::to_string(size) + " points; there are " +
                   std::to_string(stack.point_mm.size()));
  }
  if (has_near) {
    for (std::size_t i = 0; i < size; ++i) {
      if (stack.mask[i] != 0 && !stack.point_mm[i].allFinite()) {
        return invalid("point " + std::to_string(i) + " is not finite");
      }
    }
  }
  return {};
}

/// The lights as one pixel sees them, in units of what arrives at the middle of all points.
class LightField {
 public:
  explicit LightField(const LightStack& stack) : stack_(stack) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < stack.point_mm.size(); ++i) {
      if (stack.mask[i] == 0) continue;
      middle_ += stack.point_mm[i].cast<double>();
      ++count;
    }
    if (count > 0) middle_ /= static_cast<double>(count);
    for (const Light& light : stack.lights) {
      far_.push_back(light.intensity * light.vector.normalized());
    }
  }
  void at(std::size_t pixel, std::vector<Vector3d>& lights) const {
    lights = far_;
    for (std::size_t k = 0; k < lights.size(); ++k) {
      const Light& light = stack_.lights[k];
      if (!light.is_near) continue;
      const Vector3d away = light.vector - stack_.point_mm[pixel].cast<double>();
      const double reach2 = (light.vector - middle_).squaredNorm();
      lights[k] = light.intensity * reach2 / away.squaredNorm() * away.normalized();
    }
  }

 private:
  const LightStack& stack_;
  Vector3d middle_ = Vector3d::Zero();
  std::vector<Vector3d> far_;
};

/// ρn of one pixel, and how each light counted.
struct Fit {
  bool is_good = false;
  Vector3d b = Vector3d::Zero();
  Matrix3d information = Matrix3d::Zero();  ///< Σ w l lᵀ
  double sigma = 0;                         ///< of an intensity
  double residual = 0;                      ///< RMS of those that count
  int counted = 0;
};

/// Working memory of one thread.
struct Pixel {
  std::vector<Vector3d> light;
  std::vector<double> intensity, weight, residual, scratch;
};

/// Weighted least squares. False where the lights lie in a plane.
bool solve(const Pixel& pixel, double max_condition, Fit& fit) {
  fit.information.setZero();
  Vector3d right = Vector3d::Zero();
  for (std::size_t k = 0; k < pixel.light.size(); ++k) {
    if (pixel.weight[k] <= 0) continue;
    fit.information += pixel.weight[k] * pixel.light[k] * pixel.light[k].transpose();
    right += pixel.weight[k] * pixel.intensity[k] * pixel.light[k];
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(fit.information, Eigen::EigenvaluesOnly);
  const Vector3d& values = eigen.eigenvalues();
  if (!(values[0] > 0) || values[2] > max_condition * values[0]) return false;
  fit.b = fit.information.ldlt().solve(right);
  return fit.b.allFinite() && fit.b.squaredNorm() > 0;
}

Fit fit_pixel(Pixel& pixel, const StereoOptions& options) {
  Fit fit;
  const std::size_t lights = pixel.light.size();
  pixel.weight.assign(lights, 0);
  pixel.residual.assign(lights, 0);
  // What a light of unit strength would give.
  const auto shade = [&](std::size_t k) { return pixel.intensity[k] / pixel.light[k].norm(); };
  double brightest = 0;
  for (std::size_t k = 0; k < lights; ++k) {
    if (pixel.intensity[k] < options.saturated) brightest = std::max(brightest, shade(k));
  }
  if (brightest <= options.noise) return fit;
  for (std::size_t k = 0; k < lights; ++k) {
    const bool is_usable =
        pixel.intensity[k] < options.saturated && shade(k) > options.dark_share * brightest;
    pixel.weight[k] = is_usable ? 1 : 0;
  }
  const std::vector<double> usable = pixel.weight;
  const auto counted = [&] {
    return static_cast<int>(
        std::count_if(pixel.weight.begin(), pixel.weight.end(), [](double w) { return w > 0.01; }));
  };
  fit.counted = counted();
  if (fit.counted < options.min_lights || !solve(pixel, options.max_condition, fit)) return fit;

  // Too bright: left out as long as enough remain.
  const auto glossy = std::min(static_cast<int>(options.bright_share * fit.counted),
                               fit.counted - options.min_lights);
  if (glossy > 0) {
    std::vector<std::pair<double, std::size_t>> over;
    for (std::size_t k = 0; k < lights; ++k) {
      if (usable[k] > 0) over.emplace_back(pixel.light[k].dot(fit.b) - pixel.intensity[k], k);
    }
    std::nth_element(over.begin(), over.begin() + (glossy - 1), over.end());
    for (int i = 0; i < glossy; ++i) pixel.weight[over[static_cast<std::size_t>(i)].second] = 0;
    if (!solve(pixel, options.max_condition, fit)) return fit;
  }

  const auto measure = [&] {
    for (std::size_t k = 0; k < lights; ++k) {
      pixel.residual[k] = pixel.intensity[k] - pixel.light[k].dot(fit.b);
    }
  };
  for (int round = 0; round < options.rounds; ++round) {
    measure();
    pixel.scratch.clear();
    for (std::size_t k = 0; k < lights; ++k) {
      if (usable[k] > 0) pixel.scratch.push_back(std::abs(pixel.residual[k]));
    }
    const auto middle =
        pixel.scratch.begin() + static_cast<std::ptrdiff_t>(pixel.scratch.size() / 2);
    std::nth_element(pixel.scratch.begin(), middle, pixel.scratch.end());
    // Three unknowns were fitted to so few that residuals are too small.
    const auto usable_count = static_cast<double>(pixel.scratch.size());
    const double spread = std::sqrt(usable_count / std::max(usable_count - 3, 1.0));
    const double bound = kTukey * std::max({kMad * spread * *middle, options.noise, 1e-9});
    for (std::size_t k = 0; k < lights; ++k) {
      const double r = pixel.residual[k] / bound;
      const bool is_lit = pixel.light[k].dot(fit.b) > 0;
      pixel.weight[k] = usable[k] > 0 && is_lit && r * r < 1 ? (1 - r * r) * (1 - r * r) : 0;
    }
    const Vector3d before = fit.b.normalized();
    if (counted() < options.min_lights || !solve(pixel, options.max_condition, fit)) return fit;
    if ((fit.b.normalized() - before).norm() < kSettled_rad) break;
  }
  measure();
  double weights = 0, squares = 0;
  for (std::size_t k = 0; k < lights; ++k) {
    weights += pixel.weight[k];
    squares += pixel.weight[k] * pixel.residual[k] * pixel.residual[k];
  }
  fit.counted = counted();
  fit.residual = std::sqrt(squares / weights);
  const double clipped = options.rounds > 0 ? kClipped : 1;
  fit.sigma = std::max(std::sqrt(squares / clipped / std::max(weights - 3, 1.0)), options.noise);
  fit.is_good = true;
  return fit;
}

void load(const LightStack& stack, const LightField& field, std::size_t i, Pixel& pixel) {
  field.at(i, pixel.light);
  pixel.intensity.resize(stack.lights.size());
  for (std::size_t k = 0; k < stack.lights.size(); ++k) pixel.intensity[k] = stack.intensity[k][i];
}

}  // namespace

Result<StereoMap> photometric_stereo(const LightStack& stack, const StereoOptions& options,
                                     const Run& run) {
  ALHAZEN_TRY(check(options));
  ALHAZEN_TRY(check(stack));
  const LightField field(stack);
  StereoMap result;
  NormalMap& map = result.map;
  map.region = {0, 0, stack.width, stack.height};
  map.normal.assign(map.size_px(), Eigen::Vector3f::Zero());
  map.label.assign(map.size_px(), NormalLabel::background);
  for (std::vector<float>* list : {&result.albedo, &result.residual, &result.sigma_rad}) {
    list->assign(map.size_px(), 0);
  }
  result.lights.assign(map.size_px(), 0);
  const auto width = static_cast<std::size_t>(stack.width);
  std::atomic<int> rows_done = 0;
  tbb::parallel_for(0, stack.height, [&](int y) {
    if (run.stopped()) return;
    Pixel pixel;
    for (std::size_t x = 0; x < width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * width + x;
      if (stack.mask[i] == 0) continue;
      map.label[i] = NormalLabel::unknown;
      load(stack, field, i, pixel);
      const Fit fit = fit_pixel(pixel, options);
      if (!fit.is_good) continue;
      map.label[i] = NormalLabel::object;
      const double albedo = fit.b.norm();
      const Vector3d n = fit.b / albedo;
      map.normal[i] = n.cast<float>();
      result.albedo[i] = static_cast<float>(albedo);
      result.residual[i] = static_cast<float>(fit.residual / albedo);
      const Matrix3d across = Matrix3d::Identity() - n * n.transpose();
      const Matrix3d turn = across * fit.information.inverse() * across;
      result.sigma_rad[i] = static_cast<float>(fit.sigma / albedo * std::sqrt(turn.trace() / 2));
      result.lights[i] = static_cast<std::uint16_t>(fit.counted);
    }
    const int done = ++rows_done;
    run.tell("photometric stereo", static_cast<double>(done) / stack.height);
  });
  if (run.stopped()) return Error{Code::cancelled, "photometric stereo was stopped"};
  std::vector<float> sigma;
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    if (map.label[i] == NormalLabel::object) sigma.push_back(result.sigma_rad[i]);
  }
  if (sigma.empty()) return invalid("no pixel has enough lights that agree");
  const auto middle = sigma.begin() + static_cast<std::ptrdiff_t>(sigma.size() / 2);
  std::nth_element(sigma.begin(), middle, sigma.end());
  map.noise_rad = std::min(1.0, static_cast<double>(*middle));
  return result;
}

Result<std::vector<Light>> lights_of_mirror_ball(int width, int height,
                                                 const std::vector<std::vector<float>>& intensity,
                                                 const std::vector<std::uint8_t>& mask) {
  const auto size =
      static_cast<std::size_t>(std::max(width, 0)) * static_cast<std::size_t>(std::max(height, 0));
  if (size == 0 || mask.size() != size) return invalid("the mask is not of the pictures' size");
  double area = 0;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  const auto place = [&](std::size_t i) {
    const std::size_t row = i / static_cast<std::size_t>(width);
    return Eigen::Vector2d(static_cast<double>(i % static_cast<std::size_t>(width)),
                           static_cast<double>(row));
  };
  for (std::size_t i = 0; i < size; ++i) {
    if (mask[i] == 0) continue;
    centre += place(i);
    area += 1;
  }
  if (area < 100) return invalid("the mask holds no ball of 100 px or more");
  centre /= area;
  const double radius = std::sqrt(area / 3.14159265358979323846);
  std::vector<Light> lights;
  for (std::size_t k = 0; k < intensity.size(); ++k) {
    const std::string name = "picture " + std::to_string(k) + " of the mirror ball: ";
    if (intensity[k].size() != size) return invalid(name + "it is not of the mask's size");
    float brightest = 0;
    for (std::size_t i = 0; i < size; ++i) {
      if (mask[i] != 0) brightest = std::max(brightest, intensity[k][i]);
    }
    // The highlight: what is nearly as bright as the brightest, weighted by how much.
    const float least = 0.9F * brightest;
    if (!(brightest > 0.1F)) return invalid(name + "it has no highlight");
    Eigen::Vector2d at = Eigen::Vector2d::Zero();
    double weight = 0, pixels = 0;
    for (std::size_t i = 0; i < size; ++i) {
      if (mask[i] == 0 || intensity[k][i] < least) continue;
      const double w = intensity[k][i] - 0.8 * brightest;
      at += w * place(i);
      weight += w;
      ++pixels;
    }
    if (pixels > 0.1 * area) return invalid(name + "a tenth of it and more is as bright");
    const Eigen::Vector2d off = (at / weight - centre) / radius;
    if (!(off.squaredNorm() < 1)) return invalid(name + "its highlight lies off the ball");
    const Vector3d n(off.x(), off.y(), -std::sqrt(1 - off.squaredNorm()));
    const Vector3d viewer(0, 0, -1);
    lights.push_back({2 * n.dot(viewer) * n - viewer, false, 1});
  }
  return lights;
}

}  // namespace alhazen
