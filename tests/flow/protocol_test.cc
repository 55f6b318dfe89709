// Wrong requests: each is answered with an error that names the key and what is allowed, while a
// scan goes on as if nothing had been asked.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "daemon/control/message.h"
#include "daemon/control/verbs.h"
#include "tests/support/daemon.h"

namespace alhazen::testing {
namespace {

using ::testing::HasSubstr;

/// What is sent, the code of the answer, and words that the answer must hold.
struct Wrong {
  std::string bytes, code, says;
};

std::string request(const std::string& verb, const std::string& args) {
  return R"({"v":1,"id":"x","verb":")" + verb + R"(","args":)" + args + "}";
}

/// A scan that is right but for what `more` holds.
std::string scan(const std::string& more) {
  return request("scan.submit", R"({"object":{"id":"o"},)" + more + "}");
}

std::vector<Wrong> wrong_requests() {
  const std::string v = R"({"v":1,"id":"x",)";
  return {
      // The message.
      {"", "invalid", "not JSON"},
      {std::string("\xff\xfe\x00\x01", 4), "invalid", "not JSON"},
      {"GET / HTTP/1.1\r\n\r\n", "invalid", "not JSON"},
      {"{\"v\":1,", "invalid", "not JSON"},
      {"[]", "invalid", "must be an object"},
      {"42", "invalid", "must be an object"},
      {"\"status\"", "invalid", "must be an object"},
      {std::string(200'000, '['), "invalid", "at most 16"},
      {v + "\"verb\":\"ping\",\"args\":{\"x\":\"" + std::string(kLargestMessage, 'x') + "\"}}",
       "invalid", "1048576"},
      // The envelope.
      {"{}", "invalid", "message.v is missing"},
      {R"({"id":"x","verb":"ping"})", "invalid", "message.v is missing"},
      {R"({"v":2,"id":"x","verb":"ping"})", "invalid", "[1, 1]"},
      {R"({"v":"1","id":"x","verb":"ping"})", "invalid", "message.v"},
      {R"({"v":1,"verb":"ping"})", "invalid", "message.id is missing"},
      {R"({"v":1,"id":5,"verb":"ping"})", "invalid", "message.id"},
      {R"({"v":1,"id":null,"verb":"ping"})", "invalid", "message.id"},
      {v + "\"verb\":\"\"}", "invalid", "message.verb"},
      {v + "\"verb\":7}", "invalid", "message.verb"},
      {v + "\"verb\":\"" + std::string(65, 'v') + "\"}", "invalid", "1 to 64 bytes"},
      {v + "\"verb\":\"ping\",\"verb\":\"status\"}", "invalid", "given twice"},
      {v + "\"verb\":\"ping\",\"args\":null}", "invalid", "args is no object"},
      {v + "\"verb\":\"ping\",\"args\":\"all\"}", "invalid", "args is no object"},
      {v + "\"verb\":\"ping\",\"deadline_ms\":-1}", "invalid", "[1, 86400000]"},
      {v + "\"verb\":\"ping\",\"deadline_ms\":\"soon\"}", "invalid", "message.deadline_ms"},
      {v + "\"verb\":\"ping\",\"idem\":\"" + std::string(129, 'k') + "\"}", "invalid",
       "message.idem"},
      {v + "\"verb\":\"ping\",\"token\":\"secret\"}", "invalid", "unknown key message.token"},
      // Verbs.
      {request("scan.destroy", "{}"), "invalid", "scan.destroy"},
      {request("Ping", "{}"), "invalid", "unknown verb"},
      {request("ping\\u0000", "{}"), "invalid", "unknown verb"},
      {request("ping", R"({"loud":true})"), "invalid", "unknown key args.loud"},
      {request("status", R"({"status":{}})"), "invalid", "unknown key args.status"},
      // Scans.
      {request("scan.submit", "{}"), "invalid", "args.object is missing"},
      {request("scan.submit", R"({"object":{}})"), "invalid", "args.object.id is missing"},
      {request("scan.submit", R"({"object":"bunny"})"), "invalid", "args.object"},
      {request("scan.submit", R"({"object":{"id":"a/../b"}})"), "invalid", "args.object.id"},
      {request("scan.submit", R"({"object":{"id":""}})"), "invalid", "1 to 64 characters"},
      {request("scan.submit", R"({"object":{"id":"o","colour":1}})"), "invalid",
       "unknown key args.object.colour"},
      {scan(R"("level":3)"), "invalid", "[4, 11]"},
      {scan(R"("level":12)"), "invalid", "[4, 11]"},
      {scan(R"("level":8.5)"), "invalid", "a whole number"},
      {scan(R"("level":"8")"), "invalid", "args.level"},
      {scan(R"("level":1e400)"), "invalid", "not JSON"},
      {scan(R"("speed":9)"), "invalid", "unknown key args.speed"},
      {scan(R"("keep_frames":"some")"), "invalid", "none, failed, sample, all"},
      {scan(R"("on_error":"pray")"), "invalid", "stop, next"},
      {scan(R"("on_gap":true)"), "invalid", "fail, accept"},
      {scan(R"("plan":{"stops":0})"), "invalid", "[1, 360]"},
      {scan(R"("plan":{"stops":361})"), "invalid", "[1, 360]"},
      {scan(R"("plan":{"stops":12,"angles_deg":[0,10]})"), "invalid", "angles_deg"},
      {scan(R"("plan":{"angles_deg":[]})"), "invalid", "1 to 360 elements"},
      {scan(R"("plan":{"angles_deg":[0,"ten"]})"), "invalid", "args.plan.angles_deg[1]"},
      {scan(R"("plan":{"angles_deg":[20,10]})"), "invalid", "angles_deg"},
      {scan(R"("plan":{"displays":["left"]})"), "invalid", "left"},
      {scan(R"("plan":{"displays":[]})"), "invalid", "args.plan.displays"},
      {scan(R"("plan":{"cameras":["c0","c9"]})"), "invalid", "c9"},
      {scan(R"("plan":{"cameras":"c0"})"), "invalid", "args.plan.cameras"},
      {scan(R"("plan":{"cameras":["c0","c0"]})"), "invalid", "c0"},
      {scan(R"("plan":{"preset":"slow"})"), "invalid", "slow"},
      {scan(R"("plan":{"coding":"morse"})"), "invalid", "gray, gray_phase"},
      {scan(R"("plan":{"exposure_us":0})"), "invalid", "[1, 60000000] us"},
      {scan(R"("plan":{"exposure_us":59000000})"), "invalid", "exposure"},
      {scan(R"("plan":{"gain_db":99})"), "invalid", "gain"},
      {scan(R"("plan":{"crop":"yes"})"), "invalid", "true or false"},
      {scan(R"("volume":{"edge_mm":0})"), "invalid", "[1, 2000] mm"},
      {scan(R"("volume":{"edge_mm":-5})"), "invalid", "args.volume.edge_mm"},
      {scan(R"("volume":{"centre_mm":[0,0]})"), "invalid", "a list of 3 elements"},
      {scan(R"("volume":{"centre_mm":[0,0,9999]})"), "invalid", "[-2000, 2000] mm"},
      {scan(R"("volume":{"centre_mm":[0,0,-300],"edge_mm":10})"), "invalid", "c0"},
      {scan(R"("reconstruction":{"beta":0})"), "invalid", "args.reconstruction.beta"},
      {scan(R"("reconstruction":{"gamma":1})"), "invalid", "unknown key args.reconstruction.gamma"},
      {scan(R"("mesh_formats":["stl","step"])"), "invalid", "obj, stl"},
      {scan(R"("batch":[{"object":{"id":"p"}}])"), "invalid", "args.object stands beside"},
      {request("scan.submit", R"({"batch":[]})"), "invalid", "1 to 1000 elements"},
      {request("scan.submit", R"({"batch":[{"object":{"id":"p"},"level":99}]})"), "invalid",
       "args.batch[0].level"},
      {request("plan.estimate", R"({"plan":{"stops":"many"}})"), "invalid", "args.plan.stops"},
      {request("scan.get", "{}"), "invalid", "args.scan is missing"},
      {request("scan.get", R"({"scan":"0099-nothing"})"), "invalid", "nobody knows this scan"},
      {request("scan.list", R"({"limit":0})"), "invalid", "[1, 1000]"},
      {request("scan.list", R"({"offset":-1})"), "invalid", "args.offset"},
      {request("reconstruct.submit", R"({"scan":"0099-nothing"})"), "invalid", "nobody knows"},
      {request("reconstruct.submit", R"({"scan":"0001-sphere"})"), "conflict", "is paused"},
      // Jobs.
      {request("job.get", "{}"), "invalid", "args.job is missing"},
      {request("job.get", R"({"job":17})"), "invalid", "args.job"},
      {request("job.get", R"({"job":"j99"})"), "invalid", "nobody knows this job"},
      {request("job.list", R"({"state":"finished"})"), "invalid", "done_with_gaps"},
      {request("job.pause", R"({"job":"j99"})"), "invalid", "nobody knows this job"},
      {request("job.pause", R"({"job":"j1","at":"once"})"), "invalid", "step, stop"},
      {request("job.pause", R"({"job":"j1"})"), "conflict", "it must be running"},
      {request("job.resume", R"({"job":"j99"})"), "invalid", "nobody knows this job"},
      {request("job.abort", R"({"job":"j99"})"), "invalid", "nobody knows this job"},
      {request("job.stop", R"({"job":"j1","gently":true})"), "invalid", "args.gently"},
      // Devices and the rest.
      {request("device.describe", R"({"device":"c9"})"), "invalid", "nobody knows this device"},
      {request("device.describe", R"({"device":["c0"]})"), "invalid", "args.device"},
      {request("preview.take", "{}"), "conflict", "only while no scan runs"},
      {request("preview.take", R"({"exposure_us":1.5})"), "invalid", "a whole number"},
      {request("events.replay", R"({"epoch":"0000"})"), "conflict", "epoch 0000"},
      {request("events.replay", R"({"after":900000})"), "invalid", "args.after"},
      {request("events.replay", R"({"limit":100000})"), "invalid", "[1, 1000]"},
      {request("log.level", R"({"level":"loud"})"), "invalid", "debug, info, warning, error"},
      {request("log.level", "{}"), "invalid", "args.level is missing"},
      {request("service.shutdown", R"({"now":true})"), "invalid", "unknown key args.now"},
  };
}

TEST(Protocol, WrongRequestsAreAnsweredWhileAScanGoesOnUndisturbed) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json submitted = client.ask("scan.submit", small_scan());
  ASSERT_EQ(submitted["job"], "j1");
  ASSERT_EQ(submitted["scan"], "0001-sphere");
  const std::vector<Wrong> table = wrong_requests();
  std::set<std::string> distinct;
  for (const Wrong& wrong : table) distinct.insert(wrong.bytes);
  ASSERT_EQ(distinct.size(), table.size());
  ASSERT_GE(distinct.size(), 60U);
  std::uint64_t refusals = 0;
  const auto ask_wrongly = [&](const Wrong& wrong) {
    const std::string reply = client.raw(wrong.bytes);
    ASSERT_FALSE(reply.empty()) << wrong.bytes.substr(0, 200);
    ++refusals;
    const Json parsed = Json::parse(reply);
    ASSERT_TRUE(parsed.contains("error")) << wrong.bytes.substr(0, 200) << "\n" << reply;
    const Json& error = parsed["error"];
    EXPECT_EQ(error["code"], wrong.code) << wrong.bytes.substr(0, 200) << "\n" << error.dump();
    EXPECT_THAT(error["what"].get<std::string>() + " " + error["where"].get<std::string>(),
                HasSubstr(wrong.says))
        << wrong.bytes.substr(0, 200);
    EXPECT_TRUE(parsed.contains("rev"));
    EXPECT_FALSE(error["hint"].get<std::string>().empty());
  };
  // Held in the middle of its work, so that "not now" is the right answer however fast the machine
  // is.
  client.ask("job.pause", {{"job", "j1"}});
  ASSERT_TRUE(client.until([](const Json& event) {
    return event["topic"] == "job.state" && event["body"]["state"] == "paused";
  }));
  for (const Wrong& wrong : table) ask_wrongly(wrong);
  // Then what is wrong at any time, while frames are taken.
  client.ask("job.resume", {{"job", "j1"}});
  for (const Wrong& wrong : table)
    if (wrong.code != "conflict") ask_wrongly(wrong);
  std::size_t taken_since = 0;
  const Json job = client.await_end("j1", [&](const Json& event) {
    if (event["topic"] == "scan.light_map") ++taken_since;
  });
  EXPECT_EQ(job["state"], "done");
  EXPECT_GT(taken_since, 0U) << "the scan has not gone on while they were asked, or was over";
  EXPECT_TRUE(results_of(site.scan("0001-sphere")) == undisturbed_results());
  const Json status = client.ask("status");
  EXPECT_EQ(status["counters"]["refusals"], refusals);
  EXPECT_EQ(client.ask("job.list")["total"], 1) << "no wrong request became a job";
}

TEST(Protocol, WhatCannotBeAnsweredIsCountedAndDropped) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  client.send_parts({"one", "two", "three"});
  client.send_parts({"one", "two", "three", "four", "five"});
  client.send_parts({"not empty", R"({"v":1,"id":"x","verb":"ping"})"});
  // Far too long: the connection ends, the daemon goes on.
  TestClient greedy = daemon.client();
  greedy.send_parts({std::string(std::size_t{17} << 20, ' ')});
  EXPECT_TRUE(client.ask("ping").contains("at"));
  EXPECT_EQ(client.ask("status")["counters"]["dropped"], 3);
}

TEST(Protocol, EveryReadIsAnsweredAndOfTheRightShape) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  for (const Verb& verb : verbs()) {
    if (verb.changes || verb.makes_job || verb.name == "service.shutdown") continue;
    const bool needs = std::any_of(verb.arguments.begin(), verb.arguments.end(),
                                   [](const Argument& argument) { return argument.required; });
    if (needs) continue;
    const Json reply = client.reply(verb.name);
    ASSERT_TRUE(reply.contains("ok")) << verb.name << reply.dump();
    // The table says which keys a reply has: {a, b, c}.
    for (const auto& [key, unused] : reply["ok"].items())
      EXPECT_THAT(verb.reply, HasSubstr(key)) << verb.name;
    EXPECT_TRUE(reply["rev"].contains("jobs"));
  }
}

TEST(Protocol, RevisionsRiseWhenSomethingChangesAndOnlyThen) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json before = client.reply("job.list")["rev"];
  EXPECT_EQ(client.reply("job.list")["rev"]["jobs"], before["jobs"]);
  const std::string id = client.ask("scan.submit", tiny_scan())["job"];
  EXPECT_GT(client.reply("job.list")["rev"]["jobs"], before["jobs"]);
  client.await_end(id);
  const Json after = client.reply("job.list")["rev"];
  EXPECT_EQ(client.reply("job.list")["rev"]["jobs"], after["jobs"]);
  EXPECT_EQ(after["config"], before["config"]);
}

}  // namespace
}  // namespace alhazen::testing
