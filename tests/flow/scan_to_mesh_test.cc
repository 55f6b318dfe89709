// A scan from the command to the mesh, and what can be asked about it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>

#include "reconstruct/mesh_io/mesh_file.h"
#include "tests/support/daemon.h"

namespace alhazen::testing {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(ScanToMesh, EveryFileEventAndAnswerIsThere) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json hello = client.ask("hello");
  EXPECT_EQ(hello["protocol"], 1);
  const Json before = client.ask("status");
  EXPECT_EQ(before["state"], "idle");
  EXPECT_TRUE(before["can_scan"]) << before.dump(1);

  // With so many stops that a preview finds a surface, too.
  Json request = small_scan();
  request["plan"]["stops"] = 6;
  const Json estimate = client.ask(
      "plan.estimate",
      {{"plan", request["plan"]}, {"volume", request["volume"]}, {"level", request["level"]}});
  const Json submitted = client.ask("scan.submit", request);
  const std::string id = submitted["job"], scan = submitted["scan"];
  std::vector<std::string> states;
  std::set<std::string> topics;
  std::uint64_t last_seq = 0;
  std::size_t light_maps = 0;
  const Json job = client.await_end(id, [&](const Json& event) {
    const std::uint64_t seq = event["seq"];
    EXPECT_TRUE(last_seq == 0 || seq == last_seq + 1) << seq;
    last_seq = seq;
    topics.insert(event["topic"]);
    if (event["topic"] == "scan.light_map") ++light_maps;
    if (event["topic"] == "job.state" && event["body"]["id"] == id)
      states.push_back(event["body"]["state"]);
  });
  EXPECT_EQ(job["state"], "done") << job.dump(1);
  EXPECT_THAT(states, ElementsAre("queued", "running", "done"));
  for (const char* topic : {"scan.progress", "scan.light_map", "scan.stop", "preview.mesh"})
    EXPECT_TRUE(topics.contains(topic)) << topic;
  EXPECT_EQ(light_maps, estimate["stacks"]);
  EXPECT_EQ(job["result"]["light_maps"], estimate["stacks"]);
  EXPECT_EQ(job["result"]["capture"]["frames"], estimate["frames"]);
  EXPECT_EQ(job["stages"][0]["stage"], "steps");
  for (const Json& stage : job["stages"]) EXPECT_EQ(stage["share"], 1.0) << stage.dump();
  // The estimate knows nothing of the displays' latency.
  EXPECT_NEAR(estimate["seconds"].get<double>(), job["result"]["capture"]["seconds"].get<double>(),
              0.2 * estimate["seconds"].get<double>());

  const fs::path directory = site.scan(scan);
  EXPECT_EQ(job["directory"], directory.string());
  for (const auto& [name, file] : job["result"]["files"].items())
    EXPECT_TRUE(fs::exists(directory / file.get<std::string>())) << name;
  for (const char* file : {"mesh.ply", "preview.ply"}) {
    const auto mesh = read_mesh(directory / file);
    ASSERT_TRUE(mesh) << file << ": " << mesh.error().text();
    EXPECT_GT(mesh->triangles.size(), 100U) << file;
    // A sphere of 12 mm that stands on the plate.
    for (const Eigen::Vector3d& vertex : mesh->vertices_mm)
      ASSERT_LT((vertex - Eigen::Vector3d(0, 0, 12)).norm(), 16) << file;
  }
  const Json found = client.ask("scan.get", {{"scan", scan}})["scan"];
  EXPECT_EQ(found["state"], "done");
  EXPECT_EQ(found["job"], id);
  EXPECT_EQ(client.ask("scan.list")["total"], 1);
  EXPECT_EQ(client.ask("status")["state"], "idle");
}

TEST(ScanToMesh, ReplayGivesEveryEventThatWasMissed) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  client.await_end(client.ask("scan.submit", tiny_scan())["job"]);
  const std::string epoch = client.ask("status")["event"]["epoch"];
  std::uint64_t after = 0, last = 1;
  while (after < last) {
    const Json part =
        client.ask("events.replay", {{"epoch", epoch}, {"after", after}, {"limit", 7}});
    EXPECT_EQ(part["lost"], 0);
    for (const Json& event : part["events"]) EXPECT_EQ(event["seq"], ++after);
    EXPECT_EQ(part["next"], after);
    last = part["last"];
  }
  EXPECT_GT(after, 10U);
}

TEST(ScanToMesh, ReconstructingAgainGivesTheSameMesh) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json submitted = client.ask("scan.submit", small_scan());
  ASSERT_EQ(client.await_end(submitted["job"])["state"], "done");
  const Json again = client.ask("reconstruct.submit",
                                {{"scan", submitted["scan"]}, {"mesh_formats", {"obj", "stl"}}});
  const Json job = client.await_end(again["job"]);
  ASSERT_EQ(job["state"], "done") << job.dump(1);
  const fs::path scan = site.scan(submitted["scan"]);
  const auto first = read_mesh(scan / "mesh.ply");
  const auto second = read_mesh(scan / job["result"]["files"]["mesh"].get<std::string>());
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->vertices_mm, second->vertices_mm);
  EXPECT_EQ(first->triangles, second->triangles);
  for (const char* file : {"mesh_obj", "mesh_stl"})
    EXPECT_TRUE(read_mesh(scan / job["result"]["files"][file].get<std::string>())) << file;
}

TEST(ScanToMesh, ABatchIsTakenInOrderOrNotAtAll) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  Json wrong = tiny_scan();
  wrong["plan"]["cameras"] = {"c9"};
  const Json refused = client.reply("scan.submit", {{"batch", {tiny_scan(), wrong}}});
  EXPECT_EQ(refused["error"]["code"], "invalid");
  EXPECT_THAT(
      refused["error"]["what"].get<std::string>() + refused["error"]["where"].get<std::string>(),
      HasSubstr("batch[1]"));
  EXPECT_EQ(client.ask("job.list")["total"], 0);

  const Json submitted = client.ask("scan.submit", {{"batch", {tiny_scan(), tiny_scan()}}});
  ASSERT_EQ(submitted["jobs"].size(), 2U);
  std::vector<std::string> started;
  client.await_end(submitted["jobs"][1]["job"], [&](const Json& event) {
    if (event["topic"] == "job.state" && event["body"]["state"] == "running")
      started.push_back(event["body"]["id"]);
  });
  EXPECT_THAT(started, ElementsAre(submitted["jobs"][0]["job"], submitted["jobs"][1]["job"]));
}

TEST(ScanToMesh, PauseHoldsTheRigAndTheResultIsTheSame) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json submitted = client.ask("scan.submit", small_scan());
  const std::string id = submitted["job"];
  ASSERT_TRUE(client.until([](const Json& event) { return event["topic"] == "scan.light_map"; }));
  EXPECT_TRUE(client.ask("job.pause", {{"job", id}})["job"]["pausing"]);
  ASSERT_TRUE(client.until([](const Json& event) {
    return event["topic"] == "job.state" && event["body"]["state"] == "paused" &&
           event["body"]["pause_reason"] == "operator";
  }));
  EXPECT_EQ(client.ask("status")["state"], "paused");
  EXPECT_EQ(client.reply("job.pause", {{"job", id}})["error"]["code"], "conflict");
  EXPECT_EQ(client.reply("preview.take")["error"]["code"], "conflict");
  client.ask("job.resume", {{"job", id}});
  int told_again = 0;
  const Json job = client.await_end(id, [&](const Json& event) {
    if (event["topic"] == "job.state" && event["body"]["state"] == "paused") ++told_again;
  });
  EXPECT_EQ(job["state"], "done");
  EXPECT_EQ(told_again, 0);
  EXPECT_TRUE(results_of(site.scan(submitted["scan"])) == undisturbed_results());
}

/// An operator who tries the simulated rig in real time gets what virtual time gives, bit by bit.
TEST(ScanToMesh, RealTimeGivesTheSameLightMapsAsVirtualTime) {
  Json request = tiny_scan();
  request["plan"]["stops"] = 1;
  request["plan"]["cameras"] = {"c0"};
  const auto take = [&](const std::string& clock) {
    const TestSite site;
    std::ifstream in(site.config_file());
    std::string text(std::istreambuf_iterator<char>(in), {});
    text.replace(text.find("\"virtual\""), 9, '"' + clock + '"');
    std::ofstream(site.config_file()) << text;
    TestDaemon daemon(site);
    TestClient client = daemon.client();
    EXPECT_EQ(client.ask("config.show")["config"]["clock"], clock);
    const Json submitted = client.ask("scan.submit", request);
    client.await_end(submitted["job"]);  // failed: one stop shows no surface
    return results_of(site.scan(submitted["scan"]));
  };
  const auto in_virtual_time = take("virtual");
  EXPECT_EQ(in_virtual_time.size(), 2U);
  EXPECT_TRUE(take("system") == in_virtual_time);
}

TEST(ScanToMesh, TheRigIsCheckedAndSeen) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json check = client.await_end(client.ask("rig.check")["job"]);
  EXPECT_EQ(check["state"], "done");
  EXPECT_TRUE(check["result"]["ok"]) << check["result"].dump(1);
  std::set<std::string> checked;
  for (const Json& row : check["result"]["checks"]) checked.insert(row["name"]);
  for (const char* row : {"c0 open", "side calibration", "c1 settings", "c2 bandwidth", "c2 clock",
                          "disk", "calibration age"})
    EXPECT_TRUE(checked.contains(row)) << row;
  const Json look = client.await_end(
      client.ask("preview.take", {{"cameras", {"c1"}}, {"display", "side"}})["job"]);
  ASSERT_EQ(look["state"], "done") << look.dump(1);
  EXPECT_TRUE(fs::exists(look["result"]["files"]["c1"].get<std::string>()));
  EXPECT_FALSE(look["result"]["files"].contains("c0"));
  const Json camera = client.ask("device.describe", {{"device", "c1"}})["device"];
  EXPECT_EQ(camera["kind"], "camera");
  EXPECT_EQ(camera["settings"][0]["unit"], "us");
  EXPECT_EQ(client.ask("device.list")["devices"].size(), 6U);
  EXPECT_EQ(client.ask("rig.describe")["rig"]["cameras"].size(), 3U);
  EXPECT_EQ(client.ask("plan.list")["presets"][0]["name"], "two");
  EXPECT_EQ(client.ask("config.show")["config"]["clock"], "virtual");
}

TEST(ScanToMesh, TheSameKeyDoesAThingOnce) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json first = client.reply("scan.submit", tiny_scan(), "night-1");
  const Json second = client.reply("scan.submit", tiny_scan(), "night-1");
  EXPECT_EQ(first["ok"], second["ok"]);
  EXPECT_EQ(client.ask("job.list")["total"], 1);
  Json other = tiny_scan();
  other["level"] = 5;
  EXPECT_EQ(client.reply("scan.submit", other, "night-1")["error"]["code"], "conflict");
  EXPECT_EQ(client.ask("job.list")["total"], 1);
}

}  // namespace
}  // namespace alhazen::testing
