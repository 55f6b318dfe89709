#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "alhazen/result.h"

namespace alhazen {

/// One typed table of a configuration: remembers where each key stood and which keys nobody asked
/// for, so that a typo never becomes a default. Thread-bound.
///
/// Fails, all of them: invalid, naming file, line, key and the allowed range.
class Settings {
 public:
  using Value = std::variant<bool, std::int64_t, double, std::string, std::vector<double>>;

  Settings() = default;
  /// `file` and `table` are for messages; `folder` is what relative paths start from.
  Settings(std::string file, std::string table, std::string folder)
      : file_(std::move(file)), table_(std::move(table)), folder_(std::move(folder)) {}

  void set(std::string key, Value value, int line = 0) {
    entries_.insert_or_assign(std::move(key), Entry{std::move(value), line, false});
  }
  [[nodiscard]] bool has(std::string_view key) const {
    return entries_.find(key) != entries_.end();
  }
  [[nodiscard]] const std::string& folder() const noexcept { return folder_; }

  Result<std::string> text(std::string_view key) const {
    const Entry* entry = find(key);
    if (entry == nullptr) return missing(key, "text");
    if (const auto* text = std::get_if<std::string>(&entry->value)) return *text;
    return wrong(key, *entry, "text in quotes");
  }
  Result<std::string> text_or(std::string_view key, std::string fallback) const {
    return has(key) ? text(key) : Result<std::string>(std::move(fallback));
  }
  /// A path, relative ones taken from the folder of the configuration file.
  Result<std::string> path(std::string_view key) const {
    Result<std::string> given = text(key);
    if (!given) return given;
    if (given->empty()) return wrong(key, *find(key), "a path that is not empty");
    if (given->front() != '/' && !folder_.empty()) *given = folder_ + "/" + *given;
    return given;
  }
  Result<bool> flag_or(std::string_view key, bool fallback) const {
    const Entry* entry = find(key);
    if (entry == nullptr) return fallback;
    if (const auto* flag = std::get_if<bool>(&entry->value)) return *flag;
    return wrong(key, *entry, "true or false");
  }
  Result<double> number(std::string_view key, double min, double max) const {
    const Entry* entry = find(key);
    const std::string range = "a number in [" + shown(min) + ", " + shown(max) + "]";
    if (entry == nullptr) return missing(key, range);
    double value = std::numeric_limits<double>::quiet_NaN();
    if (const auto* whole = std::get_if<std::int64_t>(&entry->value))
      value = static_cast<double>(*whole);
    if (const auto* real = std::get_if<double>(&entry->value)) value = *real;
    if (value >= min && value <= max) return value;  // NaN fails
    return wrong(key, *entry, range);
  }
  Result<double> number_or(std::string_view key, double fallback, double min, double max) const {
    return has(key) ? number(key, min, max) : Result<double>(fallback);
  }
  Result<std::int64_t> integer(std::string_view key, std::int64_t min, std::int64_t max) const {
    const Entry* entry = find(key);
    const std::string range =
        "a whole number in [" + std::to_string(min) + ", " + std::to_string(max) + "]";
    if (entry == nullptr) return missing(key, range);
    if (const auto* whole = std::get_if<std::int64_t>(&entry->value);
        whole && *whole >= min && *whole <= max)
      return *whole;
    return wrong(key, *entry, range);
  }
  Result<std::int64_t> integer_or(std::string_view key, std::int64_t fallback, std::int64_t min,
                                  std::int64_t max) const {
    return has(key) ? integer(key, min, max) : Result<std::int64_t>(fallback);
  }
  /// An array of exactly `count` numbers.
  Result<std::vector<double>> numbers(std::string_view key, std::size_t count) const {
    const Entry* entry = find(key);
    const std::string wanted = "an array of " + std::to_string(count) + " numbers";
    if (entry == nullptr) return missing(key, wanted);
    if (const auto* array = std::get_if<std::vector<double>>(&entry->value);
        array && array->size() == count)
      return *array;
    return wrong(key, *entry, wanted);
  }

  /// Success when every key has been asked for; otherwise names the first that nobody knows.
  Status all_known() const {
    for (const auto& [key, entry] : entries_)
      if (!entry.read)
        return Error{Code::invalid,
                     position(entry.line) + ": unknown key '" + qualified(key) + "'"};
    return {};
  }

 private:
  struct Entry {
    Value value;
    int line = 0;
    mutable bool read = false;
  };

  [[nodiscard]] const Entry* find(std::string_view key) const {
    const auto found = entries_.find(key);
    if (found == entries_.end()) return nullptr;
    found->second.read = true;
    return &found->second;
  }
  [[nodiscard]] std::string qualified(std::string_view key) const {
    return table_.empty() ? std::string(key) : table_ + "." + std::string(key);
  }
  [[nodiscard]] std::string position(int line) const {
    return line > 0 ? file_ + ":" + std::to_string(line) : file_;
  }
  [[nodiscard]] Error missing(std::string_view key, const std::string& wanted) const {
    return {Code::invalid,
            position(0) + ": key '" + qualified(key) + "' is missing; it must be " + wanted};
  }
  [[nodiscard]] Error wrong(std::string_view key, const Entry& entry,
                            const std::string& wanted) const {
    return {Code::invalid, position(entry.line) + ": key '" + qualified(key) + "' is " +
                               shown(entry.value) + "; it must be " + wanted};
  }
  [[nodiscard]] static std::string shown(double value) {
    if (value == std::floor(value) && std::abs(value) < 1e15)
      return std::to_string(static_cast<std::int64_t>(value));
    std::string text = std::to_string(value);
    while (text.back() == '0') text.pop_back();
    return text;
  }
  [[nodiscard]] static std::string shown(const Value& value) {
    if (const auto* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
    if (const auto* whole = std::get_if<std::int64_t>(&value)) return std::to_string(*whole);
    if (const auto* real = std::get_if<double>(&value)) return shown(*real);
    if (const auto* text = std::get_if<std::string>(&value)) return "\"" + *text + "\"";
    return "an array of " + std::to_string(std::get<std::vector<double>>(value).size()) +
           " numbers";
  }

  std::string file_, table_, folder_;
  std::map<std::string, Entry, std::less<>> entries_;
};

}  // namespace alhazen
