#include "daemon/control/message.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "daemon/base/exit_code.h"

namespace alhazen {
namespace {

using nlohmann::json;
using testing::HasSubstr;

std::string with(const std::string& more) {
  return R"({"v":1,"id":"a","verb":"ping")" + more + "}";
}

Refusal refused(std::string_view bytes) {
  const auto parsed = parse_request(bytes);
  const auto* refusal = std::get_if<Refusal>(&parsed);
  EXPECT_NE(refusal, nullptr) << bytes.substr(0, 200);
  return refusal != nullptr ? *refusal : Refusal{std::nullopt, {Code::cancelled, ""}};
}

TEST(Message, ARequestSurvivesTheWire) {
  Request request;
  request.id = "c1-42", request.verb = "scan.submit", request.idem = "night-0805-7";
  request.deadline_ms = 2000;
  request.args = std::make_shared<const json>(json{{"level", 9}, {"object", {{"id", "bunny"}}}});
  const auto parsed = parse_request(to_text(request));
  const auto* back = std::get_if<Request>(&parsed);
  ASSERT_NE(back, nullptr);
  EXPECT_EQ(back->id, request.id);
  EXPECT_EQ(back->verb, request.verb);
  EXPECT_EQ(back->idem, request.idem);
  EXPECT_EQ(back->deadline_ms, 2000);
  EXPECT_EQ(*back->args, *request.args);
}

TEST(Message, ArgumentsMayBeLeftOut) {
  const auto parsed = parse_request(with(""));
  ASSERT_TRUE(std::holds_alternative<Request>(parsed));
  EXPECT_TRUE(std::get<Request>(parsed).args->is_object());
}

struct Wrong {
  const char* name;
  std::string bytes, says;
  bool knows_id;
};
void PrintTo(const Wrong& wrong, std::ostream* out) { *out << wrong.name; }

class WrongMessage : public testing::TestWithParam<Wrong> {};

TEST_P(WrongMessage, IsRefusedNamingWhatIsAllowed) {
  const Refusal refusal = refused(GetParam().bytes);
  EXPECT_EQ(refusal.error.code, Code::invalid);
  EXPECT_THAT(refusal.error.what, HasSubstr(GetParam().says));
  EXPECT_EQ(refusal.id, GetParam().knows_id ? std::optional<std::string>("a") : std::nullopt);
}

INSTANTIATE_TEST_SUITE_P(
    All, WrongMessage,
    testing::Values(
        Wrong{"Empty", "", "not JSON", false}, Wrong{"Text", "hello", "not JSON", false},
        Wrong{"Torn", with("").substr(0, 20), "not JSON", false},
        Wrong{"Trailing", with("") + "x", "not JSON", false},
        Wrong{"NotUtf8", with(",\"args\":{\"x\":\"\xff\"}"), "not JSON", false},
        Wrong{"Null", "null", "must be an object", false},
        Wrong{"List", "[1,2]", "must be an object", false},
        Wrong{"NoVersion", R"({"id":"a","verb":"ping"})", "message.v is missing", true},
        Wrong{"OtherVersion", R"({"v":2,"id":"a","verb":"ping"})", "[1, 1]", true},
        Wrong{"NoId", R"({"v":1,"verb":"ping"})", "message.id is missing", false},
        Wrong{"EmptyId", R"({"v":1,"id":"","verb":"ping"})", "1 to 128 bytes", false},
        Wrong{"LongId", R"({"v":1,"verb":"ping","id":")" + std::string(200, 'a') + "\"}",
              "1 to 128 bytes", false},
        Wrong{"NumberId", R"({"v":1,"id":7,"verb":"ping"})", "message.id is 7", false},
        Wrong{"NoVerb", R"({"v":1,"id":"a"})", "message.verb is missing", true},
        Wrong{"UnknownKey", with(R"(,"speed":1)"), "unknown key message.speed", true},
        Wrong{"ArgsNoObject", with(R"(,"args":[1])"), "args is no object", true},
        Wrong{"Deadline", with(R"(,"deadline_ms":0)"), "[1, 86400000] ms", true},
        Wrong{"FractionDeadline", with(R"(,"deadline_ms":1.5)"), "a whole number", true},
        Wrong{"EmptyIdem", with(R"(,"idem":"")"), "message.idem", true},
        Wrong{"KeyTwice", with(R"(,"verb":"status")"), "'verb' is given twice", false},
        Wrong{"Deep", with(",\"args\":{\"x\":" + std::string(40, '[') + std::string(40, ']') + "}"),
              "allowed are at most 16", false},
        Wrong{"VeryDeep", std::string(500'000, '['), "allowed are at most 16", false},
        Wrong{"Long", with(",\"args\":{\"x\":\"" + std::string(kLargestMessage, 'x') + "\"}"),
              "allowed are at most 1048576", false}),
    [](const auto& one) { return std::string(one.param.name); });

TEST(Message, BracketsInTextsAreNoNesting) {
  const std::string many(100, '[');
  EXPECT_TRUE(parse_json("{\"x\":\"" + many + "\\\"" + many + "\"}"));
}

TEST(Message, ErrorsSurviveTheWire) {
  for (int i = 0; i <= static_cast<int>(Code::internal); ++i) {
    const Error error{static_cast<Code>(i), "what it is", "scan 42 / stop 3"};
    const json sent = to_json(error);
    EXPECT_EQ(sent["retryable"], is_retryable(error.code));
    const Error back = error_from_json(sent);
    EXPECT_EQ(back.code, error.code);
    EXPECT_EQ(back.what, error.what);
    EXPECT_EQ(back.where, error.where);
  }
  EXPECT_EQ(error_from_json(json("nonsense")).code, Code::internal);
  EXPECT_EQ(error_from_json(json{{"code", "new"}}).code, Code::internal);
}

TEST(Message, RepliesAreUtf8WhateverADeviceCallsItself) {
  const std::string reply = reply_text("a", json{{"model", "caf\xe9"}}, json::object());
  EXPECT_FALSE(json::parse(reply, nullptr, false).is_discarded());
}

TEST(Message, ExitCodesFollowTheClassOfTheError) {
  EXPECT_EQ(exit_code(Code::cancelled), 130);
  EXPECT_EQ(exit_code(Code::timeout), 75);
  EXPECT_EQ(exit_code(Code::corrupt), 75);
  EXPECT_EQ(exit_code(Code::conflict), 75);
  EXPECT_EQ(exit_code(Code::unavailable), 69);
  EXPECT_EQ(exit_code(Code::invalid), 64);
  EXPECT_EQ(exit_code(Code::unsupported), 64);
  EXPECT_EQ(exit_code(Code::exhausted), 74);
  EXPECT_EQ(exit_code(Code::internal), 70);
}

}  // namespace
}  // namespace alhazen
