#include "reconstruct/scan/frame_table.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

namespace alhazen {
namespace {

enum Column : std::size_t {
  file,
  camera,
  display,
  stop,
  angle_deg,
  exposure_us,
  kind,
  axis,
  bit,
  inverted,
  period_px,
  step,
  steps,
  kColumns
};
constexpr std::array<std::string_view, kColumns> kNames = {
    "file", "camera", "display",  "stop",      "angle_deg", "exposure_us", "kind",
    "axis", "bit",    "inverted", "period_px", "step",      "steps"};
// Tables of Gray code need no columns of phase.
constexpr std::size_t kNeeded = period_px;

constexpr std::size_t kMostLines = 10'000'000, kLongestName = 64;
constexpr double kMaxAngle_deg = 1e6, kMaxExposure_us = 3.6e9;
constexpr int kMaxStop = 1'000'000, kMaxBit = 13, kMaxPeriod_px = 16'384, kMaxSteps = 64;

/// One line, split at commas; "…" holds commas, "" inside it a quote (RFC 4180, without line ends
/// inside quotes). Nothing where a quote is not closed.
std::optional<std::vector<std::string>> split(std::string_view line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (c == '"' && quoted && i + 1 < line.size() && line[i + 1] == '"') {
      fields.back() += c;
      ++i;
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      fields.emplace_back();
    } else {
      fields.back() += c;
    }
  }
  if (quoted) return std::nullopt;
  for (std::string& field : fields) {
    const std::size_t first = field.find_first_not_of(" \t");
    const std::size_t last = field.find_last_not_of(" \t");
    field = first == std::string::npos ? "" : field.substr(first, last - first + 1);
  }
  return fields;
}

/// The fields of one line by column; complaints name line, column and range.
class Line {
 public:
  Line(int number, const std::vector<std::string>& fields,
       const std::array<std::optional<std::size_t>, kColumns>& position)
      : number_(number), fields_(&fields), position_(&position) {}

  /// Empty where the table has no such column.
  [[nodiscard]] std::string_view text(Column column) const {
    const std::optional<std::size_t>& at = (*position_)[column];
    return at ? std::string_view((*fields_)[*at]) : std::string_view();
  }
  [[nodiscard]] Error complaint(Column column, std::string_view must_be) const {
    constexpr std::size_t kShown = 60;  // bytes of a wrong value that a message repeats
    return {Code::invalid, "line " + std::to_string(number_) + ": column '" +
                               std::string(kNames[column]) + "' is '" +
                               std::string(text(column).substr(0, kShown)) + "'; it must be " +
                               std::string(must_be)};
  }
  [[nodiscard]] Result<double> number(Column column, double lowest, double highest) const {
    const std::string_view field = text(column);
    double value = 0;
    const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), value);
    if (error != std::errc() || end != field.data() + field.size() || field.empty() ||
        !(value >= lowest && value <= highest)) {
      return complaint(
          column, "a number in [" + std::to_string(lowest) + ", " + std::to_string(highest) + "]");
    }
    return value;
  }
  [[nodiscard]] Result<int> integer(Column column, int lowest, int highest) const {
    const std::string_view field = text(column);
    int value = 0;
    const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), value);
    if (error != std::errc() || end != field.data() + field.size() || field.empty() ||
        value < lowest || value > highest) {
      return complaint(column, "a whole number in [" + std::to_string(lowest) + ", " +
                                   std::to_string(highest) + "]");
    }
    return value;
  }
  /// Device names become parts of file names.
  [[nodiscard]] Result<std::string> name(Column column) const {
    const std::string_view field = text(column);
    const bool good = !field.empty() && field.size() <= kLongestName && field.front() != '.' &&
                      std::ranges::all_of(field, [](char c) {
                        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                               (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
                      });
    if (!good) {
      return complaint(column, "1 to 64 of a-z A-Z 0-9 - _ . and not begin with a dot");
    }
    return std::string(field);
  }
  [[nodiscard]] Result<bool> flag(Column column) const {
    const std::string_view field = text(column);
    for (const std::string_view word : {"1", "true", "True", "TRUE"}) {
      if (field == word) return true;
    }
    for (const std::string_view word : {"0", "false", "False", "FALSE"}) {
      if (field == word) return false;
    }
    return complaint(column, "0, 1, false or true");
  }

 private:
  int number_;
  const std::vector<std::string>* fields_;
  const std::array<std::optional<std::size_t>, kColumns>* position_;
};

Result<Pattern> read_pattern(const Line& line) {
  Pattern pattern;
  const std::string_view word = line.text(kind);
  if (word == "white" || word == "black") {
    pattern.kind = word == "white" ? PatternKind::white : PatternKind::black;
    if (!line.text(axis).empty() && line.text(axis) != "-") {
      return line.complaint(axis, "- for white and black");
    }
    if (!line.text(bit).empty()) return line.complaint(bit, "empty for white and black");
    return pattern;
  }
  if (word != "gray" && word != "phase") {
    return line.complaint(kind, "one of gray, phase, white, black");
  }
  pattern.kind = word == "gray" ? PatternKind::gray : PatternKind::phase;
  if (line.text(axis) != "u" && line.text(axis) != "v") return line.complaint(axis, "u or v");
  pattern.axis = line.text(axis) == "u" ? Axis::u : Axis::v;
  if (pattern.kind == PatternKind::gray) {
    pattern.bit = ALHAZEN_TRY(line.integer(bit, 0, kMaxBit));
    pattern.inverted = ALHAZEN_TRY(line.flag(inverted));
  } else {
    pattern.period_px = ALHAZEN_TRY(line.integer(period_px, 2, kMaxPeriod_px));
    pattern.steps = ALHAZEN_TRY(line.integer(steps, 3, kMaxSteps));
    pattern.step = ALHAZEN_TRY(line.integer(step, 0, pattern.steps - 1));
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

Result<TableFrame> read_line(const Line& line) {
  TableFrame frame;
  if (line.text(file).empty()) return line.complaint(file, "the name of a picture");
  frame.file = std::string(line.text(file));
  frame.key.camera = ALHAZEN_TRY(line.name(camera));
  frame.key.display = ALHAZEN_TRY(line.name(display));
  frame.key.stop = ALHAZEN_TRY(line.integer(stop, 0, kMaxStop));
  frame.angle_rad =
      ALHAZEN_TRY(line.number(angle_deg, -kMaxAngle_deg, kMaxAngle_deg)) * std::numbers::pi / 180;
  frame.exposure = Micros(std::llround(ALHAZEN_TRY(line.number(exposure_us, 0, kMaxExposure_us))));
  frame.pattern = ALHAZEN_TRY(read_pattern(line));
  return frame;
}

}  // namespace

Result<std::vector<TableFrame>> parse_frame_table(std::string_view csv) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (csv.starts_with(kByteOrderMark)) csv.remove_prefix(kByteOrderMark.size());
  std::vector<TableFrame> frames;
  std::optional<std::array<std::optional<std::size_t>, kColumns>> position;
  std::size_t columns = 0;
  std::map<StackKey, std::pair<int, double>> angles;  // line and angle of a stack's first frame
  std::map<std::tuple<StackKey, decltype(order_of({}))>, int> seen;
  for (std::size_t number = 1, begin = 0; begin < csv.size(); ++number) {
    if (number > kMostLines) return Error{Code::invalid, "a table of over 10000000 lines"};
    const std::size_t end = std::min(csv.find('\n', begin), csv.size());
    std::string_view text = csv.substr(begin, end - begin);
    begin = end + 1;
    if (text.ends_with('\r')) text.remove_suffix(1);
    if (text.find_first_not_of(" \t") == std::string_view::npos) continue;
    const std::string where = "line " + std::to_string(number) + ": ";
    const std::optional<std::vector<std::string>> fields = split(text);
    if (!fields) return Error{Code::invalid, where + "a quote is not closed"};

    if (!position) {
      position.emplace();
      columns = fields->size();
      for (std::size_t i = 0; i < columns; ++i) {
        const auto found = std::ranges::find(kNames, std::string_view((*fields)[i]));
        if (found == kNames.end()) {
          return Error{Code::invalid, where + "unknown column '" + (*fields)[i].substr(0, 60) +
                                          "'; the first line must name the columns"};
        }
        auto& place = (*position)[static_cast<std::size_t>(found - kNames.begin())];
        if (place) return Error{Code::invalid, where + "column '" + (*fields)[i] + "' twice"};
        place = i;
      }
      for (std::size_t column = 0; column < kNeeded; ++column) {
        if (!(*position)[column]) {
          return Error{Code::invalid,
                       where + "column '" + std::string(kNames[column]) + "' is missing"};
        }
      }
      continue;
    }
    if (fields->size() != columns) {
      return Error{Code::invalid, where + std::to_string(fields->size()) +
                                      " fields; there must be " + std::to_string(columns)};
    }
    TableFrame frame = ALHAZEN_TRY(read_line(Line(static_cast<int>(number), *fields, *position)));
    frame.line = static_cast<int>(number);
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
  if (!position) return Error{Code::invalid, "line 1: no line names the columns"};
  if (frames.empty()) return Error{Code::invalid, "the table names no frame"};
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
