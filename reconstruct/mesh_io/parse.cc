#include "reconstruct/mesh_io/parse.h"

#include <algorithm>
#include <charconv>
#include <limits>

namespace alhazen {
namespace {

constexpr std::string_view kBlank = " \t\r\n\f\v";

}  // namespace

std::optional<std::string_view> Text::line() {
  if (at_end()) return std::nullopt;
  read_ = at_;
  const std::size_t end = std::min(bytes_.find('\n', at_), bytes_.size());
  std::string_view found = bytes_.substr(at_, end - at_);
  at_ = std::min(end + 1, bytes_.size());
  if (!found.empty() && found.back() == '\r') found.remove_suffix(1);
  return found;
}

std::optional<std::string_view> Text::word() {
  const std::size_t begin = bytes_.find_first_not_of(kBlank, at_);
  if (begin == std::string_view::npos) {
    at_ = bytes_.size();
    return std::nullopt;
  }
  read_ = begin;
  const std::size_t end = std::min(bytes_.find_first_of(kBlank, begin), bytes_.size());
  at_ = end;
  return bytes_.substr(begin, end - begin);
}

std::size_t Text::line_number() const {
  const auto read = bytes_.substr(0, read_);
  return 1 + static_cast<std::size_t>(std::count(read.begin(), read.end(), '\n'));
}

std::optional<std::string_view> take_word(std::string_view& line) {
  const std::size_t begin = line.find_first_not_of(kBlank);
  if (begin == std::string_view::npos) {
    line = {};
    return std::nullopt;
  }
  const std::size_t end = std::min(line.find_first_of(kBlank, begin), line.size());
  const std::string_view found = line.substr(begin, end - begin);
  line.remove_prefix(end);
  return found;
}

std::optional<double> to_number(std::string_view word) {
  if (word.size() > 1 && word.front() == '+' && word[1] != '-') word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (end != word.data() + word.size()) return std::nullopt;
  if (error == std::errc::result_out_of_range) {
    // from_chars does not say in which direction; only a negative exponent leads to zero.
    const bool is_small =
        word.find("e-") != std::string_view::npos || word.find("E-") != std::string_view::npos;
    return is_small ? 0.0 : std::numeric_limits<double>::infinity();
  }
  if (error != std::errc{}) return std::nullopt;
  return value;
}

std::optional<std::int64_t> to_integer(std::string_view word) {
  if (word.size() > 1 && word.front() == '+' && word[1] != '-') word.remove_prefix(1);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc{} || end != word.data() + word.size()) return std::nullopt;
  return value;
}

std::string shown(std::string_view word) {
  constexpr std::size_t kLongest = 40;
  std::string text = "\"";
  for (const char c : word.substr(0, kLongest)) text += c >= ' ' && c <= '~' ? c : '?';
  return text + (word.size() > kLongest ? "…\"" : "\"");
}

}  // namespace alhazen
