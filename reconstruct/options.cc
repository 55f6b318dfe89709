#include "reconstruct/options.h"

#include <cmath>
#include <string>
#include <string_view>

namespace alhazen {
namespace {

/// A range of numbers; open ends are written with a bound just beyond.
struct Allowed {
  std::string_view name;
  double value, low, high;
  bool is_low_excluded;
  std::string_view unit;
};

std::string number(double value) {
  std::string text = std::to_string(value);
  while (text.find('.') != std::string::npos && (text.back() == '0' || text.back() == '.')) {
    const bool was_point = text.back() == '.';
    text.pop_back();
    if (was_point) break;
  }
  return text;
}

}  // namespace

Options Options::for_normal_maps() {
  Options options;
  options.vote.bandwidth_rad = 0.06;
  options.vote.min_cosine = 0.15;
  options.depth.first_cone_rad = 0.3;
  options.depth.cone_rad = 0.15;
  options.depth.max_residual_rad = 0.03;
  return options;
}

Status Options::is_valid() const {
  const Allowed all[] = {
      {"adapt.start_level", static_cast<double>(adapt.start_level), 4, 8, false, ""},
      {"adapt.adaptions", static_cast<double>(adapt.adaptions), 1, 10, false, ""},
      {"adapt.band_leaves", static_cast<double>(adapt.band_leaves), 1, 20, false, ""},
      {"adapt.min_consistency", adapt.min_consistency, 0, 1, true, ""},
      {"vote.bandwidth_rad", vote.bandwidth_rad, 0, 0.5, true, " rad"},
      {"vote.bandwidth_edge_mm", vote.bandwidth_edge_mm, 0, 1000, true, " mm"},
      {"vote.bandwidth_ratio", vote.bandwidth_ratio, 0, 1, true, ""},
      {"vote.bandwidth_noises", vote.bandwidth_noises, 0, 10, false, ""},
      {"vote.lone_support", vote.lone_support, 1, 10, false, ""},
      {"vote.prior_votes", vote.prior_votes, 0, 100, false, ""},
      {"vote.min_cosine", vote.min_cosine, 0, 0.99, false, ""},
      {"vote.jump_rad", vote.jump_rad, 0, 3, true, " rad"},
      {"vote.normal_jump_rad", vote.normal_jump_rad, 0, 3, true, " rad"},
      {"depth.rounds", static_cast<double>(depth.rounds), 1, 10, false, ""},
      {"depth.first_step_mm", depth.first_step_mm, 0, 10, true, " mm"},
      {"depth.step_mm", depth.step_mm, 0, 10, true, " mm"},
      {"depth.first_cone_rad", depth.first_cone_rad, 0, 1, true, " rad"},
      {"depth.cone_rad", depth.cone_rad, 0, 1, true, " rad"},
      {"depth.tukey_rounds", static_cast<double>(depth.tukey_rounds), 0, 20, false, ""},
      {"depth.min_votes", static_cast<double>(depth.min_votes), 3, 100, false, ""},
      {"depth.max_residual_rad", depth.max_residual_rad, 0, 1, true, " rad"},
      {"depth.max_residual_noises", depth.max_residual_noises, 0, 10, false, ""},
      {"depth.max_last_step_mm", depth.max_last_step_mm, 0, 10, true, " mm"},
      {"depth.max_offset_edges", depth.max_offset_edges, 0, 10, true, ""},
      {"depth.max_sigma_edges", depth.max_sigma_edges, 0, 10, true, ""},
      {"surface.lambda", surface.lambda, 0, 100, true, ""},
      {"surface.beta", surface.beta, 0, 20, true, ""},
      {"surface.g_min", surface.g_min, 0, 1, true, ""},
      {"surface.relative_gap", surface.relative_gap, 0, 1, true, ""},
      {"surface.max_iterations", static_cast<double>(surface.max_iterations), 1, 100000, false, ""},
      {"surface.data_weight", surface.data_weight, 0, 1e6, true, ""},
      {"surface.cut_weight", surface.cut_weight, 0, 1, true, ""},
      {"refine.camera_px", refine.camera_px, 0, 100, true, " px"},
      {"refine.camera_mm", refine.camera_mm, 0, 100, true, " mm"},
      {"refine.display_mm", refine.display_mm, 0, 100, true, " mm"},
      {"refine.display_rad", refine.display_rad, 0, 0.5, true, " rad"},
      {"refine.axis_mm", refine.axis_mm, 0, 100, true, " mm"},
      {"refine.axis_rad", refine.axis_rad, 0, 0.5, true, " rad"},
      {"refine.points", static_cast<double>(refine.points), 30, 1000000, false, ""},
      {"refine.held_out_share", refine.held_out_share, 0.05, 0.5, false, ""},
      {"refine.min_points", static_cast<double>(refine.min_points), 10, 100000, false, ""},
      {"refine.cone_rad", refine.cone_rad, 0, 1, true, " rad"},
      {"refine.min_votes", static_cast<double>(refine.min_votes), 3, 100, false, ""},
      {"refine.depth_mm", refine.depth_mm, 0, 10, true, " mm"},
      {"refine.iterations", static_cast<double>(refine.iterations), 1, 50, false, ""},
  };
  for (const Allowed& option : all) {
    const bool is_above =
        option.is_low_excluded ? option.value > option.low : option.value >= option.low;
    if (is_above && option.value <= option.high) continue;
    return Error{Code::invalid, std::string(option.name) + " is " + number(option.value) +
                                    std::string(option.unit) + ", allowed " +
                                    (option.is_low_excluded ? "above " : "") + number(option.low) +
                                    " to " + number(option.high) + std::string(option.unit)};
  }
  return {};
}

}  // namespace alhazen
