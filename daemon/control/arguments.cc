#include "daemon/control/arguments.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace alhazen {
namespace {

using nlohmann::json;

/// What people read of a value in a message: long texts are cut.
std::string shown(const json& value) {
  constexpr std::size_t kLongest = 60;
  std::string text = value.dump(-1, ' ', false, json::error_handler_t::replace);
  if (text.size() > kLongest) {
    // Not inside a UTF-8 sequence: the message travels as JSON.
    std::size_t end = kLongest;
    while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) --end;
    text = text.substr(0, end) + "…";
  }
  return text;
}

std::string shown(double number) {
  return json(number == std::floor(number) && std::abs(number) < 1e15
                  ? json(static_cast<std::int64_t>(number))
                  : json(number))
      .dump();
}

std::string range(double min, double max) { return "[" + shown(min) + ", " + shown(max) + "]"; }

bool is_id(const std::string& text) {
  constexpr std::size_t kLongest = 64;
  return !text.empty() && text.size() <= kLongest &&
         std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                  c == '-' || c == '_' || c == '.';
         });
}

Result<json> check(const Argument& argument, const json& value, const std::string& path) {
  const auto wrong = [&] {
    return Error{Code::invalid, path + " is " + shown(value) + "; it must be " + argument.wanted()};
  };
  const auto within = [&](double size) { return size >= argument.min && size <= argument.max; };
  switch (argument.type) {
    case Argument::Type::text:
      if (!value.is_string() ||
          !within(static_cast<double>(value.get_ref<const std::string&>().size())))
        return wrong();
      return value;
    case Argument::Type::id:
      if (!value.is_string() || !is_id(value.get_ref<const std::string&>())) return wrong();
      return value;
    case Argument::Type::whole:
      if (!value.is_number_integer() || !within(value.get<double>())) return wrong();
      return value;
    case Argument::Type::number:
      if (!value.is_number() || !within(value.get<double>())) return wrong();
      return value;
    case Argument::Type::flag:
      if (!value.is_boolean()) return wrong();
      return value;
    case Argument::Type::choice:
      if (!value.is_string() ||
          std::find(argument.choices.begin(), argument.choices.end(),
                    value.get_ref<const std::string&>()) == argument.choices.end())
        return wrong();
      return value;
    case Argument::Type::list: {
      if (!value.is_array() || !within(static_cast<double>(value.size()))) return wrong();
      json checked = json::array();
      for (std::size_t i = 0; i < value.size(); ++i)
        checked.push_back(ALHAZEN_TRY(
            check(argument.fields.front(), value[i], path + "[" + std::to_string(i) + "]")));
      return checked;
    }
    case Argument::Type::table:
      if (!value.is_object()) return wrong();
      return check_arguments(argument.fields, value, path);
  }
  return Error{Code::internal, path + " has a type nobody checks"};
}

}  // namespace

Argument Argument::text(std::string name, std::string help, double min, double max) {
  Argument made;
  made.name = std::move(name), made.help = std::move(help), made.type = Type::text;
  made.min = min, made.max = max;
  return made;
}

Argument Argument::id(std::string name, std::string help) {
  Argument made = text(std::move(name), std::move(help), 1, 64);
  made.type = Type::id;
  return made;
}

Argument Argument::whole(std::string name, std::string help, double min, double max,
                         std::string unit) {
  Argument made = number(std::move(name), std::move(help), min, max, std::move(unit));
  made.type = Type::whole;
  return made;
}

Argument Argument::number(std::string name, std::string help, double min, double max,
                          std::string unit) {
  Argument made = text(std::move(name), std::move(help), min, max);
  made.type = Type::number, made.unit = std::move(unit);
  return made;
}

Argument Argument::flag(std::string name, std::string help) {
  Argument made = text(std::move(name), std::move(help), 0, 0);
  made.type = Type::flag;
  return made;
}

Argument Argument::choice(std::string name, std::string help, std::vector<std::string> choices) {
  Argument made = flag(std::move(name), std::move(help));
  made.type = Type::choice, made.choices = std::move(choices);
  return made;
}

Argument Argument::list(std::string name, std::string help, double min, double max,
                        Argument element) {
  Argument made = text(std::move(name), std::move(help), min, max);
  made.type = Type::list;
  made.fields.push_back(std::move(element));
  return made;
}

Argument Argument::table(std::string name, std::string help, std::vector<Argument> fields) {
  Argument made = flag(std::move(name), std::move(help));
  made.type = Type::table, made.fields = std::move(fields);
  return made;
}

Argument Argument::compulsory() && {
  required = true;
  return std::move(*this);
}

Argument Argument::or_else(std::string json_text) && {
  fallback = std::move(json_text);
  return std::move(*this);
}

Argument Argument::by_position() && {
  positional = true;
  return std::move(*this);
}

std::string Argument::wanted() const {
  const std::string with_unit = unit.empty() ? "" : " " + unit;
  switch (type) {
    case Type::text:
      return "text of " + shown(min) + " to " + shown(max) + " bytes";
    case Type::id:
      return "1 to 64 characters out of a-z A-Z 0-9 . _ -";
    case Type::whole:
      return "a whole number in " + range(min, max) + with_unit;
    case Type::number:
      return "a number in " + range(min, max) + with_unit;
    case Type::flag:
      return "true or false";
    case Type::choice: {
      std::string all;
      for (const std::string& choice : choices) all += (all.empty() ? "" : ", ") + choice;
      return "one of " + all;
    }
    case Type::list:
      return "a list of " + (min == max ? shown(min) : shown(min) + " to " + shown(max)) +
             " elements, each " + fields.front().wanted();
    case Type::table: {
      std::string all;
      for (const Argument& field : fields) all += (all.empty() ? "" : ", ") + field.name;
      return "an object with the keys " + all;
    }
  }
  return {};
}

json Argument::schema() const {
  json made = {{"description", help}};
  if (!unit.empty()) made["unit"] = unit;
  if (!fallback.empty()) made["default"] = json::parse(fallback);
  switch (type) {
    case Type::text:
      made.update({{"type", "string"}, {"minLength", min}, {"maxLength", max}});
      break;
    case Type::id:
      made.update({{"type", "string"}, {"pattern", "^[A-Za-z0-9._-]{1,64}$"}});
      break;
    case Type::whole:
      made.update({{"type", "integer"}, {"minimum", min}, {"maximum", max}});
      break;
    case Type::number:
      made.update({{"type", "number"}, {"minimum", min}, {"maximum", max}});
      break;
    case Type::flag:
      made["type"] = "boolean";
      break;
    case Type::choice:
      made["enum"] = choices;
      break;
    case Type::list:
      made.update({{"type", "array"},
                   {"minItems", min},
                   {"maxItems", max},
                   {"items", fields.front().schema()}});
      break;
    case Type::table: {
      json properties = json::object(), needed = json::array();
      for (const Argument& field : fields) {
        properties[field.name] = field.schema();
        if (field.required) needed.push_back(field.name);
      }
      made.update({{"type", "object"},
                   {"properties", properties},
                   {"required", needed},
                   {"additionalProperties", false}});
      break;
    }
  }
  return made;
}

Result<json> check_arguments(const std::vector<Argument>& arguments, const json& value,
                             std::string_view path) {
  const std::string here(path);
  if (!value.is_object())
    return Error{Code::invalid, here + " is " + shown(value) + "; it must be an object"};
  for (const auto& item : value.items()) {
    const std::string& key = item.key();
    if (std::none_of(arguments.begin(), arguments.end(),
                     [&](const Argument& known) { return known.name == key; })) {
      std::string all;
      for (const Argument& known : arguments) all += (all.empty() ? "" : ", ") + known.name;
      std::string complaint = "unknown key ";
      complaint.append(here).append(".").append(key).append("; ");
      complaint += all.empty() ? "no key is known here" : "known: " + all;
      return Error{Code::invalid, std::move(complaint)};
    }
  }
  json checked = json::object();
  for (const Argument& argument : arguments) {
    const std::string name = here + "." + argument.name;
    const auto given = value.find(argument.name);
    if (given != value.end())
      checked[argument.name] = ALHAZEN_TRY(check(argument, *given, name));
    else if (argument.required)
      return Error{Code::invalid, name + " is missing; it must be " + argument.wanted()};
    else if (!argument.fallback.empty())
      checked[argument.name] = json::parse(argument.fallback);
    else if (argument.type == Argument::Type::table &&
             std::none_of(argument.fields.begin(), argument.fields.end(),
                          [](const Argument& field) { return field.required; }))
      // Its own keys may have defaults.
      checked[argument.name] = ALHAZEN_TRY(check_arguments(argument.fields, json::object(), name));
  }
  return checked;
}

}  // namespace alhazen
