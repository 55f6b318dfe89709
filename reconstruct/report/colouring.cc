#include "reconstruct/report/colouring.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "alhazen/check.h"
#include "reconstruct/report/number_text.h"

namespace alhazen {
namespace {

constexpr float kReadable = 0.35F;  // relief that leaves colours comparable
constexpr float kNoShare = std::numeric_limits<float>::quiet_NaN();

/// The value below which a share of the finite ones lies; 0 where there is none.
double quantile(std::vector<float> values, double share) {
  std::erase_if(values, [](float value) { return !std::isfinite(value); });
  if (values.empty()) return 0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return static_cast<double>(*at);
}

template <class Stops>
std::vector<Colour> list(const Stops& stops) {
  return {stops.begin(), stops.end()};
}

}  // namespace

std::vector<Colouring> colourings_of(const Report& report, const Mesh& mesh) {
  const std::size_t vertices = mesh.vertices_mm.size();
  const auto is_observed = [&mesh](std::size_t i) {
    return mesh.observed.empty() || mesh.observed[i] != 0;
  };
  const auto add = [&](std::vector<Colouring>& to, Colouring made, auto&& share_of) {
    made.relief = kReadable;
    made.share.reserve(vertices);
    for (std::size_t i = 0; i < vertices; ++i)
      made.share.push_back(is_observed(i) ? share_of(i) : kNoShare);
    to.push_back(std::move(made));
  };

  std::vector<Colouring> all;
  all.push_back({"Surface", "surface", "the mesh as it is", {}, {}, {}, 1});
  if (report.comparison && !report.comparison->signed_mm.empty()) {
    const Comparison& c = *report.comparison;
    ALHAZEN_CHECK(c.signed_mm.size() == vertices);
    const double limit_mm = round_limit((c.observed ? *c.observed : c.all).p99_mm);
    const std::string end = round_length(limit_mm);
    add(all,
        {"Error",
         "error",
         "signed distance to the reference",
         list(kDiverging),
         {"−" + end + " inside", "0", "+" + end + " outside"},
         {},
         1},
        [&](std::size_t i) {
          return std::clamp(0.5F + 0.5F * c.signed_mm[i] / static_cast<float>(limit_mm), 0.0F,
                            1.0F);
        });
  }
  if (!mesh.depth_sigma_mm.empty()) {
    ALHAZEN_CHECK(mesh.depth_sigma_mm.size() == vertices);
    const double limit_mm = round_limit(quantile(mesh.depth_sigma_mm, 0.95));
    add(all,
        {"Standard deviation",
         "standard_deviation",
         "of the depth that the votes give",
         list(kHeat),
         {"0", round_length(limit_mm / 2), round_length(limit_mm) + " or more"},
         {},
         1},
        [&](std::size_t i) {
          return std::min(mesh.depth_sigma_mm[i] / static_cast<float>(limit_mm), 1.0F);
        });
  }
  if (!mesh.consistency.empty()) {
    ALHAZEN_CHECK(mesh.consistency.size() == vertices);
    add(all,
        {"Consistency",
         "consistency",
         "how far the votes agree",
         list(kSequential),
         {"0", "0.5", "1"},
         {},
         1},
        [&](std::size_t i) { return std::clamp(mesh.consistency[i], 0.0F, 1.0F); });
  }
  if (!mesh.observed.empty()) {
    ALHAZEN_CHECK(mesh.observed.size() == vertices);
    add(all,
        {"Coverage",
         "coverage",
         "what was measured",
         {kCovered, kCovered},
         {"", "measured", ""},
         {},
         1},
        [](std::size_t) { return 1.0F; });
  }
  return all;
}

}  // namespace alhazen
