#include "daemon/control/arguments.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iterator>
#include <nlohmann/json.hpp>

#include "daemon/control/verbs.h"

namespace alhazen {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using A = Argument;

const std::vector<A>& table() {
  static const std::vector<A> kTable = {
      A::id("id", "").compulsory(),
      A::text("note", "", 0, 5),
      A::whole("stops", "", 1, 360),
      A::number("edge", "", 0.5, 10, "mm").or_else("2.5"),
      A::flag("crop", ""),
      A::choice("keep", "", {"none", "all"}).or_else("\"none\""),
      A::list("angles", "", 1, 3, A::number("", "", -360, 360, "deg")),
      A::table("volume", "", {A::number("edge_mm", "", 1, 2000, "mm").or_else("102.4")}),
      A::table("object", "", {A::id("id", "").compulsory()}),
  };
  return kTable;
}

Result<json> check(const json& value) { return check_arguments(table(), value, "args"); }

TEST(Arguments, DefaultsAreFilledIn) {
  const auto checked = check({{"id", "a"}});
  ASSERT_TRUE(checked) << checked.error().text();
  EXPECT_EQ((*checked)["edge"], 2.5);
  EXPECT_EQ((*checked)["keep"], "none");
  EXPECT_EQ((*checked)["volume"]["edge_mm"], 102.4);
  EXPECT_FALSE(checked->contains("stops"));
  // A table that must name something is not made up.
  EXPECT_FALSE(checked->contains("object"));
}

TEST(Arguments, LimitsBelongToTheRange) {
  EXPECT_TRUE(check({{"id", "a"}, {"stops", 1}, {"edge", 0.5}}));
  EXPECT_TRUE(check({{"id", "a"}, {"stops", 360}, {"edge", 10}}));
  EXPECT_FALSE(check({{"id", "a"}, {"stops", 0}}));
  EXPECT_FALSE(check({{"id", "a"}, {"stops", 361}}));
  EXPECT_FALSE(check({{"id", "a"}, {"edge", 0.4999}}));
  EXPECT_TRUE(check({{"id", std::string(64, 'a')}}));
  EXPECT_FALSE(check({{"id", std::string(65, 'a')}}));
}

TEST(Arguments, WhatIsWrongIsNamedWithWhatIsAllowed) {
  const auto what = [](const json& value) {
    const auto checked = check(value);
    EXPECT_FALSE(checked) << value.dump();
    if (checked) return std::string();
    EXPECT_EQ(checked.error().code, Code::invalid);
    return checked.error().what;
  };
  EXPECT_THAT(what(json::array()), HasSubstr("args is []; it must be an object"));
  EXPECT_THAT(what(json::object()), HasSubstr("args.id is missing"));
  EXPECT_THAT(what({{"id", "a b"}}), HasSubstr("a-z A-Z 0-9 . _ -"));
  EXPECT_THAT(what({{"id", "a"}, {"speed", 1}}), HasSubstr("unknown key args.speed; known: id"));
  EXPECT_THAT(what({{"id", "a"}, {"note", "longer"}}), HasSubstr("text of 0 to 5 bytes"));
  EXPECT_THAT(what({{"id", "a"}, {"stops", 1.5}}),
              HasSubstr("args.stops is 1.5; it must be a whole number in [1, 360]"));
  EXPECT_THAT(what({{"id", "a"}, {"stops", "1"}}), HasSubstr("args.stops is \"1\""));
  EXPECT_THAT(what({{"id", "a"}, {"stops", true}}), HasSubstr("args.stops is true"));
  EXPECT_THAT(what({{"id", "a"}, {"edge", 1e300}}), HasSubstr("in [0.5, 10] mm"));
  EXPECT_THAT(what({{"id", "a"}, {"crop", 1}}), HasSubstr("true or false"));
  EXPECT_THAT(what({{"id", "a"}, {"keep", "some"}}), HasSubstr("one of none, all"));
  EXPECT_THAT(what({{"id", "a"}, {"angles", json::array()}}), HasSubstr("1 to 3 elements"));
  EXPECT_THAT(what({{"id", "a"}, {"angles", {1, 2, 3, 4}}}), HasSubstr("1 to 3 elements"));
  EXPECT_THAT(what({{"id", "a"}, {"angles", {1, 400}}}), HasSubstr("args.angles[1] is 400"));
  EXPECT_THAT(what({{"id", "a"}, {"volume", 3}}), HasSubstr("an object with the keys edge_mm"));
  EXPECT_THAT(what({{"id", "a"}, {"volume", {{"edge_mm", 0}}}}), HasSubstr("args.volume.edge_mm"));
  EXPECT_THAT(what({{"id", "a"}, {"object", json::object()}}),
              HasSubstr("args.object.id is missing"));
}

TEST(Arguments, LongValuesAreCutInMessagesOnlyBetweenCharacters) {
  std::string text;
  for (int i = 0; i < 100; ++i) text += "ä";
  const auto checked = check({{"id", text}});
  ASSERT_FALSE(checked);
  EXPECT_NO_THROW({ const std::string sent = json(checked.error().what).dump(); });
}

TEST(Verbs, EveryDefaultObeysItsOwnRange) {
  const std::function<void(const A&, const std::string&)> judge = [&](const A& argument,
                                                                      const std::string& where) {
    EXPECT_FALSE(argument.help.empty() && where.find("[]") == std::string::npos) << where;
    if (!argument.fallback.empty()) {
      const json value = json::parse(argument.fallback, nullptr, false);
      ASSERT_FALSE(value.is_discarded()) << where;
      A alone = argument;
      alone.name = "x";
      EXPECT_TRUE(check_arguments({alone}, {{"x", value}}, "args")) << where;
    }
    for (const A& field : argument.fields)
      judge(field, where + "." + (argument.type == A::Type::list ? "[]" : field.name));
  };
  for (const Verb& verb : verbs())
    for (const A& argument : verb.arguments) judge(argument, verb.name + " " + argument.name);
}

TEST(Verbs, NamesAreUniqueAndFound) {
  for (const Verb& verb : verbs()) {
    EXPECT_EQ(find_verb(verb.name), &verb);
    EXPECT_FALSE(verb.help.empty());
    EXPECT_FALSE(verb.reply.empty());
    EXPECT_EQ(std::count_if(verbs().begin(), verbs().end(),
                            [&](const Verb& other) { return other.name == verb.name; }),
              1);
  }
  EXPECT_EQ(find_verb("scan.destroy"), nullptr);
  EXPECT_EQ(find_verb(""), nullptr);
}

TEST(Verbs, HelloAndTheDocumentsNameEveryVerb) {
  const json all = verbs_json();
  const std::string page = verbs_markdown();
  EXPECT_EQ(all.size(), verbs().size());
  for (const Verb& verb : verbs()) {
    EXPECT_TRUE(all.contains(verb.name));
    EXPECT_EQ(all[verb.name]["arguments"]["type"], "object");
    EXPECT_THAT(page, HasSubstr("**" + verb.name + "**"));
  }
}

/// docs/verbs.md is made from the table: ALHAZEN_RECORD=1 in the environment writes it anew.
TEST(Verbs, TheDocumentIsMadeFromTheTable) {
  const std::string file = ALHAZEN_SOURCE_DIR "/docs/verbs.md";
  const std::string wanted =
      "# Verbs of the control socket\n\nMade from `daemon/control/verbs.cc` by `unit_control` "
      "(ALHAZEN_RECORD=1); not written by hand.\n\n" +
      verbs_markdown();
  if (std::getenv("ALHAZEN_RECORD") != nullptr) std::ofstream(file) << wanted;
  std::ifstream in(file);
  const std::string found(std::istreambuf_iterator<char>(in), {});
  EXPECT_TRUE(found == wanted) << file << " is not of this table; run with ALHAZEN_RECORD=1";
}

}  // namespace
}  // namespace alhazen
