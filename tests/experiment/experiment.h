#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/run.h"

namespace alhazen::experiment {

/// One line of the printed table: keys carry their units; "experiment" names it.
using Row = nlohmann::ordered_json;

/// Where an experiment reads and writes.
struct Context {
  std::filesystem::path out;    ///< reports, one folder a row
  std::filesystem::path cache;  ///< simulated scans, kept for the next run
  std::filesystem::path data;   ///< meshes, photographs (see CONTRIBUTING.md)
  Run run;
};

/// One experiment of the table, by its name on the command line.
struct Experiment {
  const char* name;
  const char* what;  ///< one line for people
  std::function<Result<std::vector<Row>>(const Context&)> measure;
};

/// All of them in the table's order. Each source of rows adds its own.
[[nodiscard]] std::vector<Experiment> experiments();

/// Light maps of mirrors: sphere, bunny (mirror_rows.cc).
void add_mirror_rows(std::vector<Experiment>& list);
/// Block with pits, sharp and thin shapes (shape_rows.cc).
void add_shape_rows(std::vector<Experiment>& list);
/// Time and memory against levels, maps and threads, votes against their bound (growth_rows.cc).
void add_growth_rows(std::vector<Experiment>& list);
/// Normal maps and photometric stereo (normals_rows.cc).
void add_normal_rows(std::vector<Experiment>& list);

/// A wrong calibration and its refinement (refine_rows.cc).
void add_refine_rows(std::vector<Experiment>& list);

}  // namespace alhazen::experiment
