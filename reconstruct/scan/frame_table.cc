#include "reconstruct/scan/frame_table.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <string>
#include <tuple>
#include <utility>

#include "reconstruct/scan/csv_table.h"
#include "reconstruct/scan/limits.h"

namespace alhazen {
namespace {

constexpr double kMaxAngle_deg = 1e6;
constexpr int kMaxStop = 1'000'000, kMaxBit = 13, kMaxPeriod_px = 16'384, kMaxSteps = 64;

/// Device names become parts of file names.
Result<std::string> name(const CsvTable& table, std::size_t row, std::string_view column) {
  const std::string_view field = table.text(row, column);
  const bool good = !field.empty() && field.size() <= limits::kNameBytes && field.front() != '.' &&
                    std::ranges::all_of(field, [](char c) {
                      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                             (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
                    });
  if (!good) {
    return table.complaint(row, column, "1 to 64 of a-z A-Z 0-9 - _ . and not begin with a dot");
  }
  return std::string(field);
}

Result<bool> flag(const CsvTable& table, std::size_t row, std::string_view column) {
  const std::string_view field = table.text(row, column);
  for (const std::string_view word : {"1", "true", "True", "TRUE"}) {
    if (field == word) return true;
  }
  for (const std::string_view word : {"0", "false", "False", "FALSE"}) {
    if (field == word) return false;
  }
  return table.complaint(row, column, "0, 1, false or true");
}

Result<Pattern> read_pattern(const CsvTable& table, std::size_t row) {
  Pattern pattern;
  const std::string_view word = table.text(row, "kind");
  if (word == "white" || word == "black") {
    pattern.kind = word == "white" ? PatternKind::white : PatternKind::black;
    if (!table.text(row, "axis").empty() && table.text(row, "axis") != "-") {
      return table.complaint(row, "axis", "- for white and black");
    }
    if (!table.text(row, "bit").empty())
      return table.complaint(row, "bit", "empty for white and black");
    return pattern;
  }
  if (word != "gray" && word != "phase") {
    return table.complaint(row, "kind", "one of gray, phase, white, black");
  }
  pattern.kind = word == "gray" ? PatternKind::gray : PatternKind::phase;
  if (table.text(row, "axis") != "u" && table.text(row, "axis") != "v")
    return table.complaint(row, "axis", "u or v");
  pattern.axis = table.text(row, "axis") == "u" ? Axis::u : Axis::v;
  if (pattern.kind == PatternKind::gray) {
    pattern.bit = ALHAZEN_TRY(table.integer(row, "bit", 0, kMaxBit));
    pattern.inverted = ALHAZEN_TRY(flag(table, row, "inverted"));
  } else {
    pattern.period_px = ALHAZEN_TRY(table.integer(row, "period_px", 2, kMaxPeriod_px));
    pattern.steps = ALHAZEN_TRY(table.integer(row, "steps", 3, kMaxSteps));
    pattern.step = ALHAZEN_TRY(table.integer(row, "step", 0, pattern.steps - 1));
  }
  return pattern;
}

/// White, black, then by axis from the most significant bit, each pattern before its inverse.
auto order_of(const Pattern& pattern) {
  const int group = pattern.kind == PatternKind::white   ? 0
                    : pattern.kind == PatternKind::black ? 1
                    : pattern.kind == PatternKind::gray  ? 2
                                                         : 3;
  return std::tuple(group, pattern.axis, -pattern.bit, pattern.inverted, pattern.period_px,
                    pattern.steps, pattern.step);
}

Result<TableFrame> read_frame(const CsvTable& table, std::size_t row) {
  TableFrame frame;
  if (table.text(row, "file").empty()) {
    return table.complaint(row, "file", "the name of a picture");
  }
  frame.file = std::string(table.text(row, "file"));
  frame.line = table.line(row);
  frame.key.camera = ALHAZEN_TRY(name(table, row, "camera"));
  frame.key.display = ALHAZEN_TRY(name(table, row, "display"));
  frame.key.stop = ALHAZEN_TRY(table.integer(row, "stop", 0, kMaxStop));
  frame.angle_rad = ALHAZEN_TRY(table.number(row, "angle_deg", -kMaxAngle_deg, kMaxAngle_deg)) *
                    std::numbers::pi / 180;
  frame.exposure = Micros(std::llround(
      ALHAZEN_TRY(table.number(row, "exposure_us", 0, static_cast<double>(limits::kExposure_us)))));
  frame.pattern = ALHAZEN_TRY(read_pattern(table, row));
  return frame;
}

}  // namespace

Result<std::vector<TableFrame>> parse_frame_table(std::string_view csv) {
  // Tables of Gray code need no columns of phase.
  const CsvTable table =
      ALHAZEN_TRY(CsvTable::parse(csv,
                                  {"file", "camera", "display", "stop", "angle_deg", "exposure_us",
                                   "kind", "axis", "bit", "inverted"},
                                  {"period_px", "step", "steps"}));
  std::vector<TableFrame> frames;
  std::map<StackKey, std::pair<int, double>> angles;  // line and angle of a stack's first frame
  std::map<std::tuple<StackKey, decltype(order_of({}))>, int> seen;
  for (std::size_t row = 0; row < table.size(); ++row) {
    TableFrame frame = ALHAZEN_TRY(read_frame(table, row));
    const std::string where = "line " + std::to_string(frame.line) + ": ";
    const auto& [first, angle_rad] =
        angles.try_emplace(frame.key, frame.line, frame.angle_rad).first->second;
    if (angle_rad != frame.angle_rad) {
      return Error{Code::invalid, where + "column 'angle_deg' differs from line " +
                                      std::to_string(first) +
                                      "; a stop of one camera and display has one angle"};
    }
    const auto [twin, is_new] =
        seen.try_emplace(std::tuple(frame.key, order_of(frame.pattern)), frame.line);
    if (!is_new) {
      return Error{Code::invalid, where + "the same pattern as in line " +
                                      std::to_string(twin->second) +
                                      "; a stack has each pattern once"};
    }
    frames.push_back(std::move(frame));
  }
  return frames;
}

std::vector<TableStack> stacks_of(std::vector<TableFrame> frames) {
  std::map<StackKey, TableStack> by_key;
  for (TableFrame& frame : frames) {
    TableStack& stack = by_key[frame.key];
    stack.key = frame.key;
    stack.angle_rad = frame.angle_rad;
    stack.frames.push_back(std::move(frame));
  }
  std::vector<TableStack> stacks;
  for (auto& [key, stack] : by_key) {
    std::ranges::sort(stack.frames, {},
                      [](const TableFrame& frame) { return order_of(frame.pattern); });
    stacks.push_back(std::move(stack));
  }
  return stacks;
}

}  // namespace alhazen
