// Devices that misbehave: what can be taken again is, and the result is that of a good day.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/daemon.h"

namespace alhazen::testing {
namespace {

using ::testing::HasSubstr;

std::string fault(const std::string& device, const std::string& kind, int call, bool once = true,
                  const std::string& on = {}) {
  return "[[fault]]\ndevice = \"" + device + "\"\nkind = \"" + kind +
         "\"\ncall = " + std::to_string(call) + "\nonce = " + (once ? "true" : "false") + "\n" +
         (on.empty() ? "" : "on = \"" + on + "\"\n");
}

TEST(Faults, StaleCorruptAndLateFramesAreRetakenWithEqualResults) {
  const TestSite site(fault("c0", "stale", 20) + fault("c1", "corrupt", 33) +
                      fault("c2", "corrupt", 41) + fault("c0", "timeout", 55, true, "wait_frame") +
                      fault("side", "stale", 25));
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json submitted = client.ask("scan.submit", small_scan());
  std::uint64_t retakes = 0;
  const Json job = client.await_end(submitted["job"], [&](const Json& event) {
    if (event["topic"] == "scan.retake") ++retakes;
  });
  EXPECT_EQ(job["state"], "done") << job.dump(1);
  EXPECT_GE(retakes, 4U);
  EXPECT_EQ(job["retakes"], retakes);
  EXPECT_TRUE(results_of(site.scan(submitted["scan"])) == undisturbed_results());
}

TEST(Faults, SlowAnswersAndLateDevicesCostTimeAlone) {
  const TestSite site(fault("c0", "slow", 30) + fault("side", "slow", 12) +
                      fault("turntable", "slow", 5) + fault("c2", "timeout", 25, true, "trigger") +
                      fault("c1", "timeout", 1, true, "configure") +
                      fault("above", "timeout", 9, true, "show") +
                      fault("turntable", "timeout", 2, true, "move_to"));
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json submitted = client.ask("scan.submit", small_scan());
  const Json job = client.await_end(submitted["job"]);
  EXPECT_EQ(job["state"], "done") << job.dump(1);
  EXPECT_GE(job["retakes"], 1);
  EXPECT_GE(job["warning_count"], 2) << "display and table were asked again";
  EXPECT_TRUE(results_of(site.scan(submitted["scan"])) == undisturbed_results());
}

TEST(Faults, AFrameThatIsNeverRightFailsTheStepWithItsHistory) {
  const TestSite site(fault("c2", "corrupt", 40, false));
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json submitted = client.ask("scan.submit", small_scan());
  std::vector<int> attempts;
  const Json job = client.await_end(submitted["job"], [&](const Json& event) {
    if (event["topic"] == "scan.retake") attempts.push_back(event["body"]["attempt"]);
  });
  EXPECT_EQ(job["state"], "interrupted") << job.dump(1);
  EXPECT_EQ(job["error"]["code"], "corrupt");
  EXPECT_THAT(attempts, ::testing::ElementsAre(1, 2, 3));
  const std::string what = job["error"]["what"];
  for (const char* part : {"no usable frame in 4 attempts", "1: corrupt", "4: corrupt"})
    EXPECT_THAT(what, HasSubstr(part));
  EXPECT_THAT(job["error"]["where"].get<std::string>(), HasSubstr("camera c2"));
  // Nothing that is not whole has become a light map.
  for (const auto& [file, bytes] : results_of(site.scan(submitted["scan"]))) {
    if (file == "mesh.ply") continue;
    EXPECT_TRUE(undisturbed_results().at(file) == bytes) << file;
  }
}

TEST(Faults, ADeviceThatComesBackCostsOneStop) {
  const TestSite site(fault("c1", "lost", 60, true, "wait_frame"));
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json submitted = client.ask("scan.submit", small_scan());
  const Json job = client.await_end(submitted["job"]);
  EXPECT_EQ(job["state"], "done") << job.dump(1);
  EXPECT_GE(job["result"]["capture"]["reopened"].get<int>(), 1);
  EXPECT_TRUE(results_of(site.scan(submitted["scan"])) == undisturbed_results());
}

TEST(Faults, ADeviceLostForGoodInterruptsTheJobAndStopsTheQueue) {
  const TestSite site(fault("c1", "lost_for_good", 60, true, "wait_frame"));
  std::string first, second;
  {
    TestDaemon daemon(site);
    TestClient client = daemon.client();
    const Json submitted = client.ask("scan.submit", {{"batch", {small_scan(), tiny_scan()}}});
    first = submitted["jobs"][0]["job"], second = submitted["jobs"][1]["job"];
    const Json job = client.await_end(first);
    EXPECT_EQ(job["state"], "interrupted") << job.dump(1);
    EXPECT_EQ(job["error"]["code"], "unavailable");
    EXPECT_TRUE(job["error"]["retryable"]);
    EXPECT_THAT(job["error"].dump(), HasSubstr("c1"));
    const Json status = client.ask("status");
    EXPECT_FALSE(status["can_scan"]);
    EXPECT_THAT(status["queue"]["held"].get<std::string>(), HasSubstr(first));
    EXPECT_EQ(status["devices"]["c1"], "lost");
    EXPECT_EQ(client.ask("job.get", {{"job", second}})["job"]["state"], "queued");
  }
  // Somebody repaired it over night.
  site.set_faults("");
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  EXPECT_EQ(client.ask("job.get", {{"job", first}})["job"]["state"], "interrupted");
  EXPECT_THAT(client.ask("status")["queue"]["held"].get<std::string>(), HasSubstr(first));
  client.ask("job.resume", {{"job", first}});
  const Json job = client.await_end(first);
  EXPECT_EQ(job["state"], "done") << job.dump(1);
  EXPECT_TRUE(results_of(site.scan(job["scan"])) == undisturbed_results());
  client.await_end(second);
  EXPECT_NE(client.ask("job.get", {{"job", second}})["job"]["state"], "queued");
}

TEST(Faults, AGapThatIsAcceptedIsListed) {
  const TestSite site(fault("c2", "corrupt", 320, false));
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  Json request = small_scan();
  request["plan"]["stops"] = 6;
  request["on_gap"] = "accept";
  const Json job = client.await_end(client.ask("scan.submit", request)["job"]);
  EXPECT_EQ(job["state"], "done_with_gaps") << job.dump(1);
  EXPECT_FALSE(job["result"]["capture"]["gaps"].empty());
  for (const Json& gap : job["result"]["capture"]["gaps"]) EXPECT_EQ(gap["camera"], "c2");
  EXPECT_GT(job["warning_count"], 0);
}

}  // namespace
}  // namespace alhazen::testing
