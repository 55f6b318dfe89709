#pragma once

#include <cstddef>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/result.h"

namespace alhazen {

/// A table of outside origin: comma-separated, the first line names the columns in any order; "…"
/// holds commas, "" in it a quote; LF or CRLF; empty lines are skipped. Complaints name line,
/// column and allowed range. Reentrant.
class CsvTable {
 public:
  /// Fails: invalid (a needed column missing, an unknown one, one twice, a line of another length,
  /// an open quote, no line beside the names, more than 1e6 lines).
  [[nodiscard]] static Result<CsvTable> parse(std::string_view csv,
                                              std::initializer_list<std::string_view> needed,
                                              std::initializer_list<std::string_view> optional);

  [[nodiscard]] std::size_t size() const noexcept { return rows_.size(); }
  /// Of the file, from 1.
  [[nodiscard]] int line(std::size_t row) const { return rows_[row].line; }
  /// Empty where the table has no such column.
  [[nodiscard]] std::string_view text(std::size_t row, std::string_view column) const;
  /// A number within [lowest, highest]; where the field is empty or there is no such column,
  /// `other` if given.
  [[nodiscard]] Result<double> number(std::size_t row, std::string_view column, double lowest,
                                      double highest, std::optional<double> other = {}) const;
  /// The same, without a fraction.
  [[nodiscard]] Result<int> integer(std::size_t row, std::string_view column, int lowest,
                                    int highest, std::optional<int> other = {}) const;
  /// "line 3: column 'x' is 'abc'; it must be …".
  [[nodiscard]] Error complaint(std::size_t row, std::string_view column,
                                std::string_view must_be) const;

 private:
  struct Row {
    int line = 0;
    std::vector<std::string> fields;
  };
  std::vector<std::string> columns_;
  std::vector<Row> rows_;
};

}  // namespace alhazen
