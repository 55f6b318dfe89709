#pragma once

#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "alhazen/result.h"
#include "reconstruct/scan/limits.h"

namespace alhazen {

/// A JSON object of outside origin, read key by key: each answer was checked, each complaint names
/// key and allowed range. For .cc files only: it brings all of nlohmann-json. Thread-bound.
class JsonFields {
 public:
  /// `path`: how complaints name the object, empty for the whole text. `object` must outlive this.
  /// Fails (with `code`, as every call here): it is no object.
  [[nodiscard]] static Result<JsonFields> make(const nlohmann::json& object, std::string path,
                                               Code code) {
    if (!object.is_object()) {
      return Error{code, (path.empty() ? std::string("the text") : "key '" + path + "'") +
                             " must be a JSON object"};
    }
    return JsonFields(object, std::move(path), code);
  }

  /// Whether the key is there and null: the only way to leave something out.
  [[nodiscard]] bool is_null(const char* key) {
    const auto found = object_->find(key);
    if (found == object_->end() || !found->is_null()) return false;
    asked_.insert(key);
    return true;
  }

  [[nodiscard]] Result<double> number(const char* key, double lowest, double highest) {
    const nlohmann::json& value = *ALHAZEN_TRY(find(key));
    const double x = value.is_number() ? value.get<double>() : std::nan("");
    if (!(x >= lowest && x <= highest)) {
      return complaint(key, "a number in [" + text_of(lowest) + ", " + text_of(highest) + "]");
    }
    return x;
  }
  [[nodiscard]] Result<std::int64_t> integer(const char* key, std::int64_t lowest,
                                             std::int64_t highest) {
    const nlohmann::json& value = *ALHAZEN_TRY(find(key));
    const bool fits =
        value.is_number_unsigned()
            ? highest >= 0 && value.get<std::uint64_t>() <= static_cast<std::uint64_t>(highest)
            : value.is_number_integer() && value.get<std::int64_t>() <= highest;
    if (!fits || value.get<std::int64_t>() < lowest) {
      return complaint(key, "a whole number in [" + std::to_string(lowest) + ", " +
                                std::to_string(highest) + "]");
    }
    return value.get<std::int64_t>();
  }
  [[nodiscard]] Result<int> small(const char* key, int lowest, int highest) {
    return static_cast<int>(ALHAZEN_TRY(integer(key, lowest, highest)));
  }
  [[nodiscard]] Result<std::uint64_t> counter(const char* key) {
    const nlohmann::json& value = *ALHAZEN_TRY(find(key));
    if (!value.is_number_unsigned()) return complaint(key, "a whole number in [0, 2^64)");
    return value.get<std::uint64_t>();
  }
  [[nodiscard]] Result<bool> flag(const char* key) {
    const nlohmann::json& value = *ALHAZEN_TRY(find(key));
    if (!value.is_boolean()) return complaint(key, "true or false");
    return value.get<bool>();
  }
  [[nodiscard]] Result<std::string> text(const char* key, std::size_t longest) {
    const nlohmann::json& value = *ALHAZEN_TRY(find(key));
    if (!value.is_string() || value.get_ref<const std::string&>().size() > longest) {
      return complaint(key, "text of at most " + std::to_string(longest) + " bytes");
    }
    return value.get<std::string>();
  }
  [[nodiscard]] Result<const nlohmann::json*> list(const char* key, std::size_t fewest,
                                                   std::size_t most) {
    const nlohmann::json* value = ALHAZEN_TRY(find(key));
    if (!value->is_array() || value->size() < fewest || value->size() > most) {
      return complaint(
          key, "a list of " + std::to_string(fewest) + " to " + std::to_string(most) + " entries");
    }
    return value;
  }
  [[nodiscard]] Result<JsonFields> object(const char* key) {
    return make(*ALHAZEN_TRY(find(key)), path_of(key), code_);
  }
  [[nodiscard]] Result<JsonFields> entry(const char* key, const nlohmann::json& list,
                                         std::size_t index) const {
    return make(list[index], path_of(key) + "[" + std::to_string(index) + "]", code_);
  }
  /// Fails: a key is there that nobody asked for.
  [[nodiscard]] Status all_known() const {
    for (const auto& [key, value] : object_->items()) {
      if (!asked_.contains(key)) return Error{code_, "unknown key '" + path_of(key) + "'"};
    }
    return {};
  }

  /// "key 'a.b' is VALUE; it must be RANGE" as an Error.
  [[nodiscard]] Error complaint(const char* key, std::string_view must_be) const {
    std::string shown =
        (*object_)[key].dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
    if (shown.size() > limits::kShownBytes) shown = shown.substr(0, limits::kShownBytes) + "...";
    return {code_,
            "key '" + path_of(key) + "' is " + shown + "; it must be " + std::string(must_be)};
  }

 private:
  JsonFields(const nlohmann::json& object, std::string path, Code code)
      : object_(&object), path_(std::move(path)), code_(code) {}

  [[nodiscard]] std::string path_of(std::string_view key) const {
    return path_.empty() ? std::string(key) : path_ + "." + std::string(key);
  }
  [[nodiscard]] static std::string text_of(double x) { return nlohmann::json(x).dump(); }
  [[nodiscard]] Result<const nlohmann::json*> find(const char* key) {
    asked_.insert(key);
    const auto found = object_->find(key);
    if (found == object_->end()) return Error{code_, "key '" + path_of(key) + "' is missing"};
    return &*found;
  }

  const nlohmann::json* object_;
  std::string path_;
  Code code_;
  std::set<std::string, std::less<>> asked_;
};

}  // namespace alhazen
