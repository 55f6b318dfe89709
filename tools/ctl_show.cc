#include "tools/ctl_show.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "daemon/control/message.h"

namespace alhazen::ctl {
namespace {

using nlohmann::json;

std::string scalar(const json& value) {
  if (value.is_string()) return printable(value.get_ref<const std::string&>());
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_number_float()) {
    char text[32];
    std::snprintf(text, sizeof text, "%.6g", value.get<double>());
    return text;
  }
  return dump(value);
}

bool is_flat(const json& value) {
  if (value.is_object()) return false;
  return !value.is_array() || std::none_of(value.begin(), value.end(), [](const json& element) {
    return element.is_structured();
  });
}

std::string flat(const json& value) {
  if (!value.is_array()) return scalar(value);
  std::string line;
  for (const json& element : value) line += (line.empty() ? "" : ", ") + scalar(element);
  return line.empty() ? "-" : line;
}

/// Which columns a list shows, and in which order; the rest is for --json and `get`.
const std::vector<std::string>& columns_of(std::string_view verb) {
  static const std::map<std::string, std::vector<std::string>, std::less<>> kColumns = {
      {"job.list", {"id", "kind", "state", "scan", "created_at", "ended_at"}},
      {"scan.list", {"id", "state", "object", "created_at", "stacks", "level", "job"}},
      {"device.list", {"name", "kind", "state", "use", "trouble"}},
      {"plan.list", {"name", "summary"}},
      {"status", {"id", "kind", "state", "scan", "elapsed_s", "remaining_s", "retakes"}},
  };
  static const std::vector<std::string> kAll;
  const auto found = kColumns.find(verb);
  return found == kColumns.end() ? kAll : found->second;
}

std::string table(const json& rows, const std::vector<std::string>& wanted,
                  const std::string& indent) {
  std::vector<std::string> columns = wanted;
  if (columns.empty())
    for (const json& row : rows)
      for (const auto& [key, value] : row.items())
        if (std::find(columns.begin(), columns.end(), key) == columns.end()) columns.push_back(key);
  std::vector<std::vector<std::string>> cells = {columns};
  for (const json& row : rows) {
    cells.emplace_back();
    for (const std::string& column : columns) {
      const auto found = row.find(column);
      cells.back().push_back(found == row.end() ? "" : is_flat(*found) ? flat(*found) : "…");
    }
  }
  std::vector<std::size_t> widths(columns.size());
  for (const auto& line : cells)
    for (std::size_t i = 0; i < line.size(); ++i) widths[i] = std::max(widths[i], line[i].size());
  std::string text;
  for (const auto& line : cells) {
    std::string made = indent;
    for (std::size_t i = 0; i < line.size(); ++i)
      made +=
          line[i] + (i + 1 < line.size() ? std::string(widths[i] - line[i].size() + 2, ' ') : "");
    text += made + "\n";
  }
  return text;
}

std::string lines(const json& value, std::string_view verb, const std::string& indent) {
  std::string text;
  for (const auto& [key, child] : value.items()) {
    if (is_flat(child))
      text += indent + key + ": " + flat(child) + "\n";
    else if (child.empty())
      text += indent + key + ": -\n";
    else if (child.is_array() && std::all_of(child.begin(), child.end(),
                                             [](const json& row) { return row.is_object(); }))
      text += indent + key + ":\n" + table(child, columns_of(verb), indent + "  ");
    else if (child.is_object())
      text += indent + key + ":\n" + lines(child, verb, indent + "  ");
    else
      text += indent + key + ": " + dump(child) + "\n";
  }
  return text;
}

}  // namespace

std::string printable(std::string_view text) {
  std::string made;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte >= 0x20 && byte != 0x7f) {
      made += c;
    } else {
      char shown[8];
      std::snprintf(shown, sizeof shown, "\\x%02x", byte);
      made += shown;
    }
  }
  return made;
}

std::string show(std::string_view verb, const json& reply) {
  if (verb == "hello") {
    json brief = reply;
    json names = json::array();
    for (const auto& [name, row] : reply.at("verbs").items()) names.push_back(name);
    brief["verbs"] = std::move(names);
    return lines(brief, verb, "");
  }
  if (verb == "events.replay") {
    std::string text;
    for (const json& event : reply.at("events")) text += dump(event) + "\n";
    json rest = reply;
    rest.erase("events");
    return text + lines(rest, verb, "");
  }
  // One thing alone needs no heading: {"job": {…}}.
  if (reply.is_object() && reply.size() == 1) {
    const json& only = *reply.begin();
    if (only.is_object()) return lines(only, verb, "");
    if (only.is_array() && only.empty()) return "none\n";
  }
  return lines(reply, verb, "");
}

std::string duration_text(double seconds) {
  char text[48];
  const auto whole = static_cast<long>(std::lround(seconds));
  if (seconds < 60)
    std::snprintf(text, sizeof text, "%.1f s", seconds);
  else if (seconds < 3600)
    std::snprintf(text, sizeof text, "%ld min %02ld s", whole / 60, whole % 60);
  else
    std::snprintf(text, sizeof text, "%ld h %02ld min", whole / 3600, whole / 60 % 60);
  return text;
}

}  // namespace alhazen::ctl
