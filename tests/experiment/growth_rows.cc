// Rows of cost: time and memory against levels, maps and threads; votes against their bound.
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <fstream>
#include <string>
#include <utility>

#include "reconstruct/vote/gather.h"
#include "reconstruct/vote/voter.h"
#include "tests/experiment/machine_rate.h"
#include "tests/experiment/mirror.h"

namespace alhazen::experiment {
namespace {

ScanRecipe block_recipe() {
  ScanRecipe recipe;
  recipe.world = "pits11";
  recipe.coding = Coding::gray_phase;
  recipe.level = 8;
  return recipe;
}

/// Of the block's 1056 maps: every n-th stop, the first displays by name.
struct Share {
  int every_stop;
  const char* last_display;
};

Result<Row> grown(const Context& context, const Scan& scan, int level, const Share& share,
                  std::size_t threads) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
  const Measured made =
      ALHAZEN_TRY(measure(context, scan, scan.rig(), level, Options{}, [&](const StackKey& key) {
        return key.stop % share.every_stop == 0 && key.display <= share.last_display;
      }));
  const Octree& octree = made.result.octree;
  std::size_t finest = 0;
  for (const auto& leaf : octree.leaves()) finest += leaf.level == level ? 1U : 0U;
  const double maps = made.figures["light_maps"], time_s = made.figures["time_s"];
  Row row{{"experiment", "growth"}, {"threads", threads}};
  row.update(made.figures);
  row["finest_leaves"] = finest;
  row["cpu_ns_per_leaf_and_map"] = 2e9 * time_s / (static_cast<double>(finest) * maps);
  return row;
}

/// Both axes by decades; one line a series. Sizes in px of an SVG without scripts.
void plot(const std::filesystem::path& file, const std::vector<Row>& rows) {
  constexpr double kWidth = 720, kHeight = 460, kLeft = 70, kBottom = 60, kTop = 30, kRight = 30;
  double low_x = 1e300, high_x = 0, low_y = 1e300, high_y = 0;
  const auto x_of = [](const Row& row) {
    return row["finest_leaves"].get<double>() * row["light_maps"].get<double>();
  };
  const auto y_of = [](const Row& row) { return row["wall_s"].get<double>(); };
  for (const Row& row : rows) {
    low_x = std::min(low_x, x_of(row));
    high_x = std::max(high_x, x_of(row));
    low_y = std::min(low_y, y_of(row));
    high_y = std::max(high_y, y_of(row));
  }
  low_x = std::pow(10, std::floor(std::log10(low_x)));
  high_x = std::pow(10, std::ceil(std::log10(high_x)));
  low_y = std::pow(10, std::floor(std::log10(low_y)));
  high_y = std::pow(10, std::ceil(std::log10(high_y)));
  const auto px = [&](double x) {
    return kLeft + (kWidth - kLeft - kRight) * std::log(x / low_x) / std::log(high_x / low_x);
  };
  const auto py = [&](double y) {
    return kHeight - kBottom -
           (kHeight - kBottom - kTop) * std::log(y / low_y) / std::log(high_y / low_y);
  };
  std::ofstream out(file);
  out << "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 " << kWidth << " " << kHeight
      << "\" font-family=\"sans-serif\" font-size=\"13\" fill=\"#333\">\n"
      << "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n";
  for (double x = low_x; x <= high_x * 1.01; x *= 10) {
    out << "<path d=\"M" << px(x) << " " << kTop << "V" << kHeight - kBottom
        << "\" stroke=\"#ddd\"/><text x=\"" << px(x) << "\" y=\"" << kHeight - kBottom + 18
        << "\" text-anchor=\"middle\">10<tspan dy=\"-5\" font-size=\"9\">" << std::log10(x)
        << "</tspan></text>\n";
  }
  for (double y = low_y; y <= high_y * 1.01; y *= 10) {
    out << "<path d=\"M" << kLeft << " " << py(y) << "H" << kWidth - kRight
        << "\" stroke=\"#ddd\"/><text x=\"" << kLeft - 8 << "\" y=\"" << py(y) + 4
        << "\" text-anchor=\"end\">" << y << " s</text>\n";
  }
  // What growth in proportion would be, through the largest of two threads.
  const Row& anchor = *std::max_element(
      rows.begin(), rows.end(), [&](const Row& a, const Row& b) { return x_of(a) < x_of(b); });
  const double from_x = std::max(low_x, x_of(anchor) * low_y / y_of(anchor));
  out << "<path d=\"M" << px(from_x) << " " << py(y_of(anchor) * from_x / x_of(anchor)) << "L"
      << px(x_of(anchor)) << " " << py(y_of(anchor))
      << "\" stroke=\"#999\" stroke-dasharray=\"4 4\"/>\n";
  for (const Row& row : rows) {
    const bool is_one = row["threads"].get<int>() == 1;
    out << "<circle cx=\"" << px(x_of(row)) << "\" cy=\"" << py(y_of(row)) << "\" r=\"4\" fill=\""
        << (is_one ? "white" : "#1f6fb4") << "\" stroke=\"#1f6fb4\"/><text x=\""
        << px(x_of(row)) + 7 << "\" y=\"" << py(y_of(row)) + 4 << "\" font-size=\"10\">level "
        << row["level"].get<int>() << ", " << row["light_maps"].get<int>() << "</text>\n";
  }
  out << "<text x=\"" << kWidth / 2 << "\" y=\"" << kHeight - 14
      << "\" text-anchor=\"middle\">surface leaves × light maps</text>\n"
      << "<text x=\"" << kLeft << "\" y=\"18\">wall time; filled: two threads, open: one; "
      << "dashed: in proportion</text>\n</svg>\n";
}

Result<std::vector<Row>> growth(const Context& context) {
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, block_recipe(), context.run));
  // Displays by name: above, behind, over, side.
  const Share of_66{4, "above"}, of_132{4, "behind"}, of_264{4, "side"}, of_528{2, "side"},
      of_1056{1, "side"};
  std::vector<Row> rows;
  const auto add = [&](int level, const Share& share, std::size_t threads) -> Status {
    rows.push_back(ALHAZEN_TRY(grown(context, scan, level, share, threads)));
    return {};
  };
  for (const int level : {7, 8, 9, 10, 11}) ALHAZEN_TRY(add(level, of_264, 2));
  for (const Share& share : {of_66, of_132, of_528, of_1056}) ALHAZEN_TRY(add(8, share, 2));
  for (const int level : {8, 9}) ALHAZEN_TRY(add(level, of_264, 1));
  for (Row& one : rows) {
    if (one["threads"] != 1) continue;
    for (const Row& two : rows) {
      if (two["threads"] != 2 || two["level"] != one["level"] ||
          two["light_maps"] != one["light_maps"]) {
        continue;
      }
      one["efficiency_on_two_cores_pct"] =
          100 * one["wall_s"].get<double>() / (2 * two["wall_s"].get<double>());
      one["aim_at_least_efficiency_on_two_cores_pct"] = 90;
    }
  }
  plot(context.out / "growth.svg", rows);
  return rows;
}

double thread_cpu_s() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Votes on the leaves of the finest level, one thread, against the bound of one core: per vote the
/// larger of 60 floating-point operations and four gathers of 4 bytes.
Result<std::vector<Row>> votes(const Context& context) {
  constexpr double kFlops = 60, kGathers = 4;
  const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);
  const Scan scan = ALHAZEN_TRY(simulated_scan(context.cache, block_recipe(), context.run));
  const Measured made = ALHAZEN_TRY(measure(context, scan, scan.rig(), 8));
  const Octree& octree = made.result.octree;
  const Volume volume = scan.manifest().volume;
  Observations observations(scan.rig(), VoteOptions{}, volume.centre_mm);
  for (const StackKey& key : ALHAZEN_TRY(scan.light_maps())) {
    ALHAZEN_TRY(observations.add(ALHAZEN_TRY(scan.load_light_map(key))));
  }
  std::vector<std::uint32_t> leaves;
  for (std::uint32_t i = 0; i < octree.size(); ++i) {
    if (octree.leaves()[i].level == octree.finest_level()) leaves.push_back(i);
  }
  const std::vector<LeafGroup> groups =
      groups_of(octree, leaves, Gatherer::max_reach_mm(observations, volume.centre_mm));
  Gatherer gatherer(observations, VoteOptions{});
  PointBlock block;
  BlockVotes found;
  const auto gather = [&] {
    std::uint64_t looked_up = 0;
    for (const LeafGroup& group : groups) {
      block.reset(group.centre_mm, group.reach_mm);
      for (std::size_t k = group.begin; k < group.end; ++k) {
        block.add(octree.centre_mm(leaves[k]), octree.edge_mm(leaves[k]) * std::sqrt(3.0) / 2);
      }
      looked_up += gatherer.gather(block, found);
    }
    return looked_up;
  };
  std::uint64_t looked_up = gather();
  // The bound next to what it bounds: a machine's rates drift by a tenth within a minute.
  struct Round {
    double share, votes_per_s, bound_votes_per_s;
    MachineRate rate;
  };
  std::array<Round, 5> rounds{};
  for (Round& round : rounds) {
    const double begin_s = thread_cpu_s();
    looked_up = gather();
    const double gather_s = thread_cpu_s() - begin_s;
    round.rate = machine_rate();
    const double bound_s =
        std::max(kFlops / round.rate.flops_per_s, kGathers / round.rate.gathers_per_s);
    round.votes_per_s = static_cast<double>(looked_up) / gather_s;
    round.bound_votes_per_s = 1 / bound_s;
    round.share = round.votes_per_s * bound_s;
  }
  std::sort(rounds.begin(), rounds.end(),
            [](const Round& a, const Round& b) { return a.share < b.share; });
  const Round& median = rounds[rounds.size() / 2];
  const Voter voter(observations, VoteOptions{});
  const double vote_begin_s = thread_cpu_s();
  static_cast<void>(ALHAZEN_TRY(voter.vote(octree, nullptr, context.run)));
  const double vote_s = thread_cpu_s() - vote_begin_s;

  Row row{{"experiment", "votes"},
          {"leaves", leaves.size()},
          {"votes", looked_up},
          {"flops_per_s", median.rate.flops_per_s},
          {"gathers_per_s", median.rate.gathers_per_s},
          {"bound_votes_per_s", median.bound_votes_per_s}};
  row["votes_per_s"] = median.votes_per_s;
  row["share_of_bound"] = median.share;
  row["least_share_of_bound"] = rounds.front().share;
  row["most_share_of_bound"] = rounds.back().share;
  row["must_at_least_share_of_bound"] = 0.3;
  row["aim_at_least_share_of_bound"] = 0.5;
  row["votes_per_s_with_modes"] = static_cast<double>(voter.hypotheses()) / vote_s;
  row["share_of_bound_with_modes"] =
      static_cast<double>(voter.hypotheses()) / vote_s / median.bound_votes_per_s;
  return std::vector<Row>{row};
}

}  // namespace

void add_growth_rows(std::vector<Experiment>& list) {
  list.push_back({"growth", "time and memory by level, maps and threads, on the block", growth});
  list.push_back({"votes", "votes a second and core against their bound", votes});
}

}  // namespace alhazen::experiment
