// alhazen-experiment: measures the rows of the table in docs/accuracy.md.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>

#include "daemon/base/exit_code.h"
#include "tests/experiment/experiment.h"

namespace alhazen::experiment {

std::vector<Experiment> experiments() {
  std::vector<Experiment> list;
  add_mirror_rows(list);
  add_shape_rows(list);
  add_refine_rows(list);
  add_normal_rows(list);
  add_growth_rows(list);
  return list;
}

namespace {

/// What a figure is held to: "must_X" is the most that X may be, "must_at_least_X" the least.
struct Bound {
  double value = 0;
  bool is_least = false;
  [[nodiscard]] bool holds(double measured) const {
    return is_least ? measured >= value : measured <= value;
  }
};
std::optional<Bound> bound_of(const Row& row, const std::string& kind, const std::string& figure) {
  for (const bool is_least : {false, true}) {
    const auto found = row.find(kind + (is_least ? "_at_least_" : "_") + figure);
    if (found != row.end()) return Bound{found->get<double>(), is_least};
  }
  return std::nullopt;
}

/// The figures that the thesis has, or the issue bounds, beside ours. Returns how many miss what
/// they must hold.
int print_table(const std::vector<Row>& rows) {
  int missed = 0;
  std::printf("\n%-24s %-28s %12s %12s %12s %12s\n", "experiment", "figure", "measured", "thesis",
              "must", "aim");
  for (const Row& row : rows) {
    for (const auto& [key, value] : row.items()) {
      if (!value.is_number()) continue;
      const auto thesis = bound_of(row, "thesis", key), must = bound_of(row, "must", key),
                 aim = bound_of(row, "aim", key);
      if (!thesis && !must && !aim) continue;
      const auto text = [](const std::optional<Bound>& bound) {
        if (!bound) return std::string("-");
        char digits[32];
        std::snprintf(digits, sizeof digits, "%s%.4g", bound->is_least ? ">= " : "", bound->value);
        return std::string(digits);
      };
      const double measured = value.get<double>();
      const bool is_missed = must && !must->holds(measured);
      missed += is_missed ? 1 : 0;
      std::printf("%-24s %-28s %12.4g %12s %12s %12s%s\n",
                  row["experiment"].get<std::string>().c_str(), key.c_str(), measured,
                  text(thesis).c_str(), text(must).c_str(), text(aim).c_str(),
                  is_missed ? "  does not hold" : "");
    }
  }
  return missed;
}

/// `is_held`: a figure that misses what it must hold is a failure.
int measure_all(const std::vector<Experiment>& chosen, const Context& context, bool is_held) {
  std::vector<Row> rows;
  int failed = 0;
  for (const Experiment& experiment : chosen) {
    const auto measured = experiment.measure(context);
    if (!measured) {
      std::fprintf(stderr, "alhazen-experiment: %s: %s\n", experiment.name,
                   measured.error().text().c_str());
      failed = exit_code(measured.error().code);
      continue;
    }
    for (const Row& row : *measured) {
      std::printf("%s\n", row.dump().c_str());
      std::fflush(stdout);
      rows.push_back(row);
    }
  }
  std::ofstream(context.out / "rows.json") << Row(rows).dump(1) << "\n";
  const int missed = chosen.size() > 1 || is_held ? print_table(rows) : 0;
  return failed == 0 && is_held && missed > 0 ? 1 : failed;
}

}  // namespace
}  // namespace alhazen::experiment

int main(int argc, char** argv) {
  using namespace alhazen;
  using namespace alhazen::experiment;
  const std::vector<Experiment> list = experiments();
  std::string names = "\nExperiments:\n";
  for (const Experiment& experiment : list)
    names += "  " + std::string(experiment.name) + "  " + experiment.what + "\n";
  CLI::App app{"Measures rows of the table in docs/accuracy.md; one JSON object a row."};
  app.footer(names);
  std::vector<std::string> wanted;
  Context context;
  context.out = "build/experiment";
  context.cache = "build/experiment/scans";
  const char* data = std::getenv("ALHAZEN_DATA");
  context.data = data != nullptr ? data : "../shared/data";
  app.add_option("NAME", wanted, "experiments, or all")->required();
  app.add_option("--out", context.out, "folder of report pages, pictures and rows.json");
  app.add_option("--cache", context.cache, "folder of simulated scans, kept for the next run");
  bool is_held = false;
  app.add_flag("--held", is_held, "fails where a figure misses what it must hold");
  app.add_option("--data", context.data, "folder of meshes and photographs");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& wrong) {
    return app.exit(wrong) == 0 ? 0 : exit_code(Code::invalid);
  }
  std::vector<Experiment> chosen;
  for (const std::string& name : wanted) {
    bool is_known = name == "all";
    for (const Experiment& experiment : list) {
      if (name != "all" && name != experiment.name) continue;
      is_known = true;
      chosen.push_back(experiment);
    }
    if (!is_known) {
      std::fprintf(stderr, "alhazen-experiment: there is no experiment \"%s\"%s", name.c_str(),
                   names.c_str());
      return exit_code(Code::invalid);
    }
  }
  std::error_code failed;
  std::filesystem::create_directories(context.out, failed);
  if (failed) {
    std::fprintf(stderr, "alhazen-experiment: %s: %s\n", context.out.c_str(),
                 failed.message().c_str());
    return exit_code(Code::unavailable);
  }
  return measure_all(chosen, context, is_held);
}
