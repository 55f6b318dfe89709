#include "daemon/control/message.h"

#include <nlohmann/json.hpp>
#include <set>
#include <utility>
#include <vector>

#include "alhazen/caught.h"
#include "daemon/control/arguments.h"

namespace alhazen {
namespace {

using nlohmann::json;

constexpr std::size_t kLongestId = 128;

/// The deepest nesting of brackets outside of texts. A pass of its own, so that no parser ever sees
/// a message that is nested more deeply than allowed.
int deepest(std::string_view bytes) {
  int depth = 0, most = 0;
  bool in_text = false;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const char c = bytes[i];
    if (in_text) {
      if (c == '\\') ++i;
      if (c == '"') in_text = false;
    } else if (c == '"') {
      in_text = true;
    } else if (c == '{' || c == '[') {
      most = std::max(most, ++depth);
    } else if (c == '}' || c == ']') {
      --depth;
    }
  }
  return most;
}

const std::vector<Argument>& envelope() {
  // The last millisecond of a day: the longest any client may wait.
  static const std::vector<Argument> kEnvelope = {
      Argument::whole("v", "version of the protocol", kProtocol, kProtocol).compulsory(),
      Argument::text("id", "the client's own name of this request", 1, kLongestId).compulsory(),
      Argument::text("verb", "what to do", 1, 64).compulsory(),
      Argument::text("idem", "repeats with the same key get the stored answer", 1, 128),
      Argument::whole("deadline_ms", "how long the client waits", 1, 86'400'000, "ms"),
  };
  return kEnvelope;
}

}  // namespace

Result<json> parse_json(std::string_view bytes) {
  if (bytes.size() > kLargestMessage)
    return Error{Code::invalid, "the message has " + std::to_string(bytes.size()) +
                                    " bytes; allowed are at most " +
                                    std::to_string(kLargestMessage)};
  if (const int depth = deepest(bytes); depth > kDeepestMessage)
    return Error{Code::invalid, "the message is nested " + std::to_string(depth) +
                                    " deep; allowed are at most " +
                                    std::to_string(kDeepestMessage)};
  std::vector<std::set<std::string>> keys;
  std::string twice;
  const auto watch = [&](int, json::parse_event_t event, json& value) {
    if (event == json::parse_event_t::object_start) keys.emplace_back();
    if (event == json::parse_event_t::object_end) keys.pop_back();
    if (event == json::parse_event_t::key && !keys.back().insert(value.get<std::string>()).second)
      twice = value.get<std::string>();
    return true;
  };
  json parsed = ALHAZEN_TRY(
      caught(Code::invalid, "the message is not JSON", [&] { return json::parse(bytes, watch); }));
  if (!twice.empty())
    return Error{Code::invalid, "the key '" + twice + "' is given twice; allowed is once"};
  return parsed;
}

std::variant<Request, Refusal> parse_request(std::string_view bytes) {
  Result<json> parsed = parse_json(bytes);
  if (!parsed) return Refusal{std::nullopt, std::move(parsed.error())};
  Refusal refusal;
  if (parsed->is_object())
    if (const auto id = parsed->find("id"); id != parsed->end() && id->is_string()) {
      const auto& text = id->get_ref<const std::string&>();
      if (!text.empty() && text.size() <= kLongestId) refusal.id = text;
    }
  // `args` is judged by the verb's own table.
  json args = json::object();
  if (parsed->is_object())
    if (const auto given = parsed->find("args"); given != parsed->end()) {
      args = std::move(*given);
      parsed->erase(given);
      if (!args.is_object()) {
        refusal.error = {Code::invalid, "args is no object; it must be an object of arguments"};
        return refusal;
      }
    }
  Result<json> checked = check_arguments(envelope(), *parsed, "message");
  if (!checked) {
    refusal.error = std::move(checked.error());
    return refusal;
  }
  Request request;
  request.id = (*checked)["id"].get<std::string>();
  request.verb = (*checked)["verb"].get<std::string>();
  request.args = std::make_shared<const json>(std::move(args));
  if (checked->contains("idem")) request.idem = (*checked)["idem"].get<std::string>();
  request.deadline_ms = checked->value("deadline_ms", std::int64_t{0});
  return request;
}

std::string to_text(const Request& request) {
  json message = {
      {"v", kProtocol}, {"id", request.id}, {"verb", request.verb}, {"args", *request.args}};
  if (request.idem) message["idem"] = *request.idem;
  if (request.deadline_ms > 0) message["deadline_ms"] = request.deadline_ms;
  return dump(message);
}

std::string_view hint_of(Code code) noexcept {
  switch (code) {
    case Code::cancelled:
      return "";
    case Code::timeout:
      return "ask again; if it stays silent, see device.list";
    case Code::unavailable:
      return "check power and cable of the device, then job.resume";
    case Code::corrupt:
      return "take or copy the data again";
    case Code::invalid:
      return "correct the request; `hello` lists every verb with its arguments";
    case Code::conflict:
      return "wait for the state to change, or change it first; see status";
    case Code::unsupported:
      return "choose another way";
    case Code::exhausted:
      return "free disk or memory, then job.resume";
    case Code::internal:
      return "this is a bug of ours: report it with the log";
  }
  return "";
}

bool is_retryable(Code code) noexcept {
  switch (code) {
    case Code::timeout:
    case Code::unavailable:
    case Code::corrupt:
    case Code::conflict:
    case Code::exhausted:
      return true;
    case Code::cancelled:
    case Code::invalid:
    case Code::unsupported:
    case Code::internal:
      return false;
  }
  return false;
}

json to_json(const Error& error) {
  return {{"code", std::string(name_of(error.code))},
          {"what", error.what},
          {"where", error.where},
          {"hint", std::string(hint_of(error.code))},
          {"retryable", is_retryable(error.code)}};
}

Error error_from_json(const json& error) {
  const auto text = [&](const char* key) {
    const auto found = error.find(key);
    return found != error.end() && found->is_string() ? found->get<std::string>() : std::string();
  };
  if (!error.is_object()) return {Code::internal, "the error is no object"};
  const std::string code = text("code");
  for (int i = 0; i <= static_cast<int>(Code::internal); ++i)
    if (code == name_of(static_cast<Code>(i)))
      return {static_cast<Code>(i), text("what"), text("where")};
  return {Code::internal, "unknown error code '" + code + "': " + text("what")};
}

std::string reply_text(std::string_view id, const json& ok, const json& rev) {
  return dump({{"v", kProtocol}, {"id", std::string(id)}, {"ok", ok}, {"rev", rev}});
}

std::string refusal_text(const std::optional<std::string>& id, const Error& error,
                         const json& rev) {
  return dump({{"v", kProtocol},
               {"id", id ? json(*id) : json(nullptr)},
               {"error", to_json(error)},
               {"rev", rev}});
}

std::string dump(const json& value, int indent) {
  return value.dump(indent, ' ', false, json::error_handler_t::replace);
}

}  // namespace alhazen
