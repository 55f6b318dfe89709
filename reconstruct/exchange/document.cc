#include "reconstruct/exchange/document.h"

#include <algorithm>
#include <charconv>
#include <string>
#include <utility>
#include <vector>

#include "alhazen/caught.h"

namespace alhazen {
namespace {

using Json = nlohmann::json;

constexpr int kDeepest = 32;
constexpr std::string_view kBlanks = " \t\r\n";

Error at_line(std::size_t number, const std::string& what) {
  return {Code::invalid, "line " + std::to_string(number) + ": " + what};
}

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

/// A word as what it says: in quotes a text, else a number where it is one.
Json scalar(std::string_view word) {
  if (word.size() >= 2 && (word.front() == '"' || word.front() == '\'') &&
      word.back() == word.front()) {
    const char quote = word.front();
    std::string text;
    for (std::size_t i = 1; i + 1 < word.size(); ++i) {
      const bool escapes = quote == '"' ? word[i] == '\\' : word[i] == quote;
      if (escapes && i + 2 < word.size()) ++i;
      text += word[i];
    }
    return text;
  }
  const std::string_view digits = word.starts_with('+') ? word.substr(1) : word;
  double number = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
  if (!digits.empty() && error == std::errc() && end == digits.data() + digits.size())
    return number;
  return std::string(word);
}

/// Follows quotes through a text, character by character.
class Quotes {
 public:
  /// Whether `c` belongs to a quoted text.
  bool holds(char c) {
    if (quote_ == 0) {
      if (c == '"' || c == '\'') quote_ = c;
      return quote_ != 0;
    }
    if (is_escaped_) {
      is_escaped_ = false;
    } else if (c == '\\' && quote_ == '"') {
      is_escaped_ = true;
    } else if (c == quote_) {
      quote_ = 0;
    }
    return true;
  }

 private:
  char quote_ = 0;
  bool is_escaped_ = false;
};

/// [a, b, …] and {key: value, …} of YAML, already on one line.
class Flow {
 public:
  Flow(std::string_view text, std::size_t line) : text_(text), line_(line) {}

  Result<Json> read() {
    Json out = ALHAZEN_TRY(value(0));
    if (!rest().empty()) return at_line(line_, "something follows the closing bracket");
    return out;
  }

 private:
  std::string_view rest() {
    at_ = std::min(text_.find_first_not_of(kBlanks, at_), text_.size());
    return text_.substr(at_);
  }
  bool take(char c) {
    if (!rest().starts_with(c)) return false;
    ++at_;
    return true;
  }
  std::string_view word(std::string_view ends) {
    static_cast<void>(rest());
    const std::size_t begin = at_;
    Quotes quotes;
    while (at_ < text_.size() &&
           (quotes.holds(text_[at_]) || ends.find(text_[at_]) == std::string_view::npos)) {
      ++at_;
    }
    return trimmed(text_.substr(begin, at_ - begin));
  }
  Result<Json> value(int depth) {
    if (depth > kDeepest) return at_line(line_, "nested deeper than 32");
    if (take('[')) {
      Json list = Json::array();
      while (!take(']')) {
        list.push_back(ALHAZEN_TRY(value(depth + 1)));
        if (!take(',') && !rest().starts_with(']'))
          return at_line(line_, "a list that does not end");
      }
      return list;
    }
    if (take('{')) {
      Json object = Json::object();
      while (!take('}')) {
        const Json key = scalar(word(":,{}[]"));
        if (!take(':')) return at_line(line_, "a key without a value");
        object[key.is_string() ? key.get<std::string>() : key.dump()] =
            ALHAZEN_TRY(value(depth + 1));
        if (!take(',') && !rest().starts_with('}'))
          return at_line(line_, "an object that does not end");
      }
      return object;
    }
    const std::string_view text = word(",[]{}");
    if (text.empty()) return at_line(line_, "a value is missing");
    return scalar(text);
  }

  std::string_view text_;
  std::size_t line_, at_ = 0;
};

/// The subset of YAML that calibration files are written in.
class Yaml {
 public:
  explicit Yaml(std::string_view text) {
    for (std::size_t number = 1, begin = 0; begin < text.size(); ++number) {
      const std::size_t end = std::min(text.find('\n', begin), text.size());
      const std::string_view line = without_comment(text.substr(begin, end - begin));
      begin = end + 1;
      const std::string_view content = trimmed(line);
      if (content.empty() || line.starts_with('%') || line.starts_with("---") || content == "...")
        continue;
      lines_.push_back({line.find_first_not_of(kBlanks), content, number});
    }
  }

  Result<Json> read() {
    if (lines_.empty()) return Error{Code::invalid, "the text holds nothing"};
    Json out = ALHAZEN_TRY(block(lines_[0].indent, 0));
    if (at_ < lines_.size()) return at_line(lines_[at_].number, "indented as nothing above it");
    return out;
  }

 private:
  struct Line {
    std::size_t indent;
    std::string_view text;
    std::size_t number;
  };

  static std::string_view without_comment(std::string_view line) {
    Quotes quotes;
    for (std::size_t i = 0; i < line.size(); ++i) {
      const bool after_blank = i == 0 || kBlanks.find(line[i - 1]) != std::string_view::npos;
      if (!quotes.holds(line[i]) && line[i] == '#' && after_blank) return line.substr(0, i);
    }
    return line;
  }
  static bool is_item(std::string_view text) { return text == "-" || text.starts_with("- "); }
  /// Where the key of "key: value" ends; npos where the line holds none.
  static std::size_t end_of_key(std::string_view text) {
    Quotes quotes;
    for (std::size_t i = 0; i < text.size(); ++i) {
      if (quotes.holds(text[i])) continue;
      if (text[i] == '[' || text[i] == '{') break;
      if (text[i] == ':' && (i + 1 == text.size() || text[i + 1] == ' ')) return i;
    }
    return std::string_view::npos;
  }

  Result<Json> block(std::size_t indent, int depth) {
    if (depth > kDeepest) return at_line(lines_[at_].number, "nested deeper than 32");
    return is_item(lines_[at_].text) ? list(indent, depth) : object(indent, depth);
  }
  Result<Json> list(std::size_t indent, int depth) {
    Json out = Json::array();
    while (at_ < lines_.size() && lines_[at_].indent == indent && is_item(lines_[at_].text)) {
      Line& line = lines_[at_];
      const std::string_view text = trimmed(line.text.substr(1));
      if (end_of_key(text) != std::string_view::npos) {
        // "- key: value" is an object that begins where its key stands.
        line.indent += static_cast<std::size_t>(text.data() - line.text.data());
        line.text = text;
        out.push_back(ALHAZEN_TRY(block(line.indent, depth + 1)));
      } else {
        ++at_;
        out.push_back(ALHAZEN_TRY(value(text, line.number, indent, depth)));
      }
    }
    return out;
  }
  Result<Json> object(std::size_t indent, int depth) {
    Json out = Json::object();
    while (at_ < lines_.size() && lines_[at_].indent == indent) {
      const Line line = lines_[at_];
      const std::size_t end = end_of_key(line.text);
      if (end == std::string_view::npos)
        return at_line(line.number, "neither 'key: value' nor '- value'");
      const Json key = scalar(trimmed(line.text.substr(0, end)));
      ++at_;
      out[key.is_string() ? key.get<std::string>() : key.dump()] =
          ALHAZEN_TRY(value(trimmed(line.text.substr(end + 1)), line.number, indent, depth));
    }
    return out;
  }
  /// What follows a key or a dash of `indent`: on the same line, or on those below.
  Result<Json> value(std::string_view text, std::size_t number, std::size_t indent, int depth) {
    while (text.starts_with('!'))
      text = trimmed(text.substr(std::min(text.find_first_of(kBlanks), text.size())));
    if (text.empty()) {
      const bool is_nested =
          at_ < lines_.size() &&
          (lines_[at_].indent > indent ||
           (lines_[at_].indent == indent && is_item(lines_[at_].text) && !is_item_above(indent)));
      if (!is_nested) return Json();
      return block(lines_[at_].indent, depth + 1);
    }
    if (text.front() == '[' || text.front() == '{') {
      std::string flow(text);
      long open = brackets(text);
      for (; open > 0 && at_ < lines_.size(); ++at_) {
        flow += ' ';
        flow += lines_[at_].text;
        open += brackets(lines_[at_].text);
      }
      return Flow(flow, number).read();
    }
    if (std::string_view("&*|>@`").find(text.front()) != std::string_view::npos)
      return at_line(number, "anchors and block scalars of YAML are not understood here");
    return scalar(text);
  }
  /// A list's items stand under its key at the same indentation only where the key is no item.
  [[nodiscard]] bool is_item_above(std::size_t indent) const {
    return lines_[at_ - 1].indent == indent && is_item(lines_[at_ - 1].text);
  }
  /// Opening brackets less closing ones.
  static long brackets(std::string_view text) {
    Quotes quotes;
    long open = 0;
    for (const char c : text) {
      if (quotes.holds(c)) continue;
      open += c == '[' || c == '{' ? 1 : c == ']' || c == '}' ? -1 : 0;
    }
    return open;
  }

  std::vector<Line> lines_;
  std::size_t at_ = 0;
};

/// XML as cv::FileStorage writes it: elements without meaning in their attributes.
class Xml {
 public:
  explicit Xml(std::string_view text) : text_(text) {}

  Result<Json> read() {
    ALHAZEN_TRY(pass_over_prolog());
    if (!take("<")) return complaint("an element must begin here");
    Json out = ALHAZEN_TRY(element(0));
    ALHAZEN_TRY(pass_over_prolog());
    if (at_ < text_.size()) return complaint("something follows the last element");
    return out;
  }

 private:
  [[nodiscard]] Error complaint(const std::string& what) const {
    const std::string_view before = text_.substr(0, at_);
    return at_line(static_cast<std::size_t>(std::count(before.begin(), before.end(), '\n')) + 1,
                   what);
  }
  bool take(std::string_view what) {
    if (!text_.substr(at_).starts_with(what)) return false;
    at_ += what.size();
    return true;
  }
  void pass_over_blanks() { at_ = std::min(text_.find_first_not_of(kBlanks, at_), text_.size()); }
  Status pass_to(std::string_view end) {
    const std::size_t found = text_.find(end, at_);
    if (found == std::string_view::npos) return complaint("'" + std::string(end) + "' is missing");
    at_ = found + end.size();
    return {};
  }
  /// Blanks, comments and <?…?>.
  Status pass_over_prolog() {
    for (;;) {
      pass_over_blanks();
      if (take("<?")) {
        ALHAZEN_TRY(pass_to("?>"));
      } else if (take("<!--")) {
        ALHAZEN_TRY(pass_to("-->"));
      } else {
        return {};
      }
    }
  }
  std::string_view name() {
    const std::size_t begin = at_;
    at_ = std::min(text_.find_first_of(" \t\r\n/><=\"'", at_), text_.size());
    return text_.substr(begin, at_ - begin);
  }
  /// After "<": name, attributes, content, end.
  Result<Json> element(int depth) {
    if (depth > kDeepest) return complaint("nested deeper than 32");
    const std::string_view own = name();
    if (own.empty() || own.front() == '!') return complaint("an element without a name");
    for (;;) {
      pass_over_blanks();
      if (take("/>")) return Json();
      if (take(">")) break;
      if (name().empty()) return complaint("an attribute without a name");
      pass_over_blanks();
      if (!take("=")) return complaint("an attribute without a value");
      pass_over_blanks();
      const char quote = at_ < text_.size() ? text_[at_] : '\0';
      if (quote != '"' && quote != '\'') return complaint("an attribute without quotes");
      ++at_;
      ALHAZEN_TRY(pass_to(std::string_view(&quote, 1)));
    }
    Json children;
    std::string words;
    for (;;) {
      const std::size_t next = std::min(text_.find('<', at_), text_.size());
      words += text_.substr(at_, next - at_);
      at_ = next;
      if (take("<!--")) {
        ALHAZEN_TRY(pass_to("-->"));
      } else if (take("</")) {
        if (name() != own) return complaint("the end of another element than '" + shown(own) + "'");
        pass_over_blanks();
        if (!take(">")) return complaint("'>' is missing");
        break;
      } else if (take("<")) {
        const std::size_t before = at_;
        const std::string_view child = name();
        at_ = before;
        Json value = ALHAZEN_TRY(element(depth + 1));
        const bool is_item = child == "_";
        if (!children.is_null() && children.is_array() != is_item)
          return complaint("'" + shown(own) + "' holds both items and named elements");
        if (is_item) {
          children.push_back(std::move(value));
        } else if (children.contains(std::string(child))) {
          return complaint("'" + shown(child) + "' is there twice");
        } else {
          children[std::string(child)] = std::move(value);
        }
      } else {
        return complaint("the end of '" + shown(own) + "' is missing");
      }
    }
    return children.is_null() ? list_of(words) : std::move(children);
  }
  static std::string shown(std::string_view name) { return std::string(name.substr(0, 60)); }
  static Json list_of(std::string_view words) {
    Json out = Json::array();
    Quotes quotes;
    std::size_t begin = 0;
    for (std::size_t i = 0; i <= words.size(); ++i) {
      if (i < words.size() &&
          (quotes.holds(words[i]) || kBlanks.find(words[i]) == std::string_view::npos)) {
        continue;
      }
      if (i > begin) out.push_back(scalar(words.substr(begin, i - begin)));
      begin = i + 1;
    }
    if (out.empty()) return Json();
    return out.size() == 1 ? Json(out[0]) : out;
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

}  // namespace

Result<Json> parse_document(std::string_view text) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  const std::string_view content = trimmed(text);
  if (content.starts_with('<')) return Xml(text).read();
  if (content.starts_with('{'))
    return caught(Code::invalid, "JSON", [&] { return Json::parse(text, nullptr, true, true); });
  return Yaml(text).read();
}

}  // namespace alhazen
