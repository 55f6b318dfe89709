// alhazen-experiment: measures the rows of the table in docs/accuracy.md.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <fstream>
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

/// The figures that the thesis has, or the issue bounds, beside ours.
void print_table(const std::vector<Row>& rows) {
  std::printf("\n%-24s %-22s %12s %12s %12s %12s\n", "experiment", "figure", "measured", "thesis",
              "must", "aim");
  for (const Row& row : rows) {
    for (const auto& [key, value] : row.items()) {
      const auto beside = [&](const char* prefix) {
        const auto found = row.find(prefix + key);
        if (found == row.end()) return std::string("-");
        char text[32];
        std::snprintf(text, sizeof text, "%.4g", found->get<double>());
        return std::string(text);
      };
      if (!value.is_number()) continue;
      const std::string thesis = beside("thesis_"), must = beside("must_"), aim = beside("aim_");
      if (thesis == "-" && must == "-" && aim == "-") continue;
      std::printf("%-24s %-22s %12.4g %12s %12s %12s\n",
                  row["experiment"].get<std::string>().c_str(), key.c_str(), value.get<double>(),
                  thesis.c_str(), must.c_str(), aim.c_str());
    }
  }
}

int measure(const std::vector<Experiment>& chosen, const Context& context) {
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
  if (chosen.size() > 1) print_table(rows);
  return failed;
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
  app.add_option("--out", context.out, "folder of meshes, pictures and rows.json");
  app.add_option("--cache", context.cache, "folder of simulated scans, kept for the next run");
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
  return measure(chosen, context);
}
