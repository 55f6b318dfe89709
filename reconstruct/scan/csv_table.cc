#include "reconstruct/scan/csv_table.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <utility>

#include "reconstruct/scan/limits.h"

namespace alhazen {
namespace {

constexpr int kMostLines = 1'000'000;

/// One line, split at commas (RFC 4180, without line ends inside quotes). Nothing where a quote is
/// not closed.
std::optional<std::vector<std::string>> split(std::string_view line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"' && quoted && i + 1 < line.size() && line[i + 1] == '"') {
      fields.back() += line[i++];
    } else if (line[i] == '"') {
      quoted = !quoted;
    } else if (line[i] == ',' && !quoted) {
      fields.emplace_back();
    } else {
      fields.back() += line[i];
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

bool contains(std::initializer_list<std::string_view> list, std::string_view name) {
  return std::find(list.begin(), list.end(), name) != list.end();
}

}  // namespace

Result<CsvTable> CsvTable::parse(std::string_view csv,
                                 std::initializer_list<std::string_view> needed,
                                 std::initializer_list<std::string_view> optional) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (csv.starts_with(kByteOrderMark)) csv.remove_prefix(kByteOrderMark.size());
  CsvTable table;
  std::size_t begin = 0;
  for (int number = 1; begin < csv.size(); ++number) {
    if (number > kMostLines) return Error{Code::invalid, "a table of over 1000000 lines"};
    const std::size_t end = std::min(csv.find('\n', begin), csv.size());
    std::string_view text = csv.substr(begin, end - begin);
    begin = end + 1;
    if (text.ends_with('\r')) text.remove_suffix(1);
    if (text.find_first_not_of(" \t") == std::string_view::npos) continue;
    const std::string where = "line " + std::to_string(number) + ": ";
    std::optional<std::vector<std::string>> fields = split(text);
    if (!fields) return Error{Code::invalid, where + "a quote is not closed"};
    if (!table.columns_.empty()) {
      if (fields->size() != table.columns_.size()) {
        return Error{Code::invalid, where + std::to_string(fields->size()) +
                                        " fields; there must be " +
                                        std::to_string(table.columns_.size())};
      }
      table.rows_.push_back({number, std::move(*fields)});
      continue;
    }
    for (const std::string& name : *fields) {
      if (!contains(needed, name) && !contains(optional, name)) {
        return Error{Code::invalid, where + "unknown column '" +
                                        name.substr(0, limits::kShownBytes) +
                                        "'; the first line must name the columns"};
      }
      if (std::count(fields->begin(), fields->end(), name) > 1) {
        return Error{Code::invalid, where + "column '" + name + "' twice"};
      }
    }
    for (const std::string_view name : needed) {
      if (std::find(fields->begin(), fields->end(), name) == fields->end()) {
        return Error{Code::invalid, where + "column '" + std::string(name) + "' is missing"};
      }
    }
    table.columns_ = std::move(*fields);
  }
  if (table.columns_.empty()) return Error{Code::invalid, "line 1: no line names the columns"};
  if (table.rows_.empty()) return Error{Code::invalid, "the table has no line beside its names"};
  return table;
}

std::string_view CsvTable::text(std::size_t row, std::string_view column) const {
  const auto found = std::find(columns_.begin(), columns_.end(), column);
  if (found == columns_.end()) return {};
  return rows_[row].fields[static_cast<std::size_t>(found - columns_.begin())];
}

Error CsvTable::complaint(std::size_t row, std::string_view column,
                          std::string_view must_be) const {
  return {Code::invalid, "line " + std::to_string(line(row)) + ": column '" + std::string(column) +
                             "' is '" +
                             std::string(text(row, column).substr(0, limits::kShownBytes)) +
                             "'; it must be " + std::string(must_be)};
}

Result<double> CsvTable::number(std::size_t row, std::string_view column, double lowest,
                                double highest, std::optional<double> other) const {
  const std::string_view field = text(row, column);
  if (field.empty() && other) return *other;
  double value = 0;
  const auto [end, error] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (error != std::errc() || end != field.data() + field.size() || field.empty() ||
      !(value >= lowest && value <= highest)) {
    return complaint(
        row, column,
        "a number in [" + std::to_string(lowest) + ", " + std::to_string(highest) + "]");
  }
  return value;
}

Result<int> CsvTable::integer(std::size_t row, std::string_view column, int lowest, int highest,
                              std::optional<int> other) const {
  const auto value = number(row, column, lowest, highest, other);
  if (!value || *value != std::floor(*value)) {
    return complaint(
        row, column,
        "a whole number in [" + std::to_string(lowest) + ", " + std::to_string(highest) + "]");
  }
  return static_cast<int>(*value);
}

}  // namespace alhazen
