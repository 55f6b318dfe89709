// Abort at whatever moment: the job ends in a legal state, nothing is left behind, and the next
// scan works.
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <string>

#include "tests/support/daemon.h"

namespace alhazen::testing {
namespace {

/// Under a sanitizer everything takes many times longer: every third event stands for its
/// neighbours there.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__) || \
    ALHAZEN_HAS_FEATURE(address_sanitizer)
constexpr int kStride = 3;
#else
constexpr int kStride = 1;
#endif

bool is_legal_after_abort(const Json& state) {
  // Failed and done: it was over before the abort was read.
  return state == "cancelled" || state == "failed" || state == "done";
}

bool is_of(const Json& event, const std::string& job) {
  return event["body"].value("job", event["body"].value("id", "")) == job;
}

/// How many events of each topic a scan publishes that nothing disturbs.
std::map<std::string, int> events_of_a_scan(TestClient& client) {
  std::map<std::string, int> count;
  const std::string id = client.ask("scan.submit", tiny_scan())["job"];
  client.await_end(id, [&](const Json& event) {
    if (is_of(event, id)) ++count[event["topic"]];
  });
  return count;
}

TEST(Abort, AtEveryEvent) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const std::size_t threads_before = thread_count();
  const std::map<std::string, int> published = events_of_a_scan(client);
  std::set<std::string> asked_at;
  int cancelled = 0;
  for (const auto& [topic, count] : published) {
    for (int k = 1; k <= count; k += kStride) {
      SCOPED_TRACE("event " + std::to_string(k) + " of " + topic);
      const std::string id = client.ask("scan.submit", tiny_scan())["job"];
      int seen = 0;
      const Json job = client.await_end(id, [&, &topic = topic](const Json& event) {
        if (!is_of(event, id) || event["topic"] != topic || ++seen != k) return;
        asked_at.insert(topic);
        client.reply("job.abort", {{"job", id}});  // conflict, where it is over already
      });
      // Whether the job was over before the abort was read is the machine's to tell.
      if (job["state"] == "cancelled") ++cancelled;
      EXPECT_TRUE(is_legal_after_abort(job["state"])) << job.dump(1);
      const Json status = client.ask("status");
      EXPECT_EQ(status["state"], "idle");
      EXPECT_EQ(status["queue"]["held"], "");
      EXPECT_TRUE(status["can_scan"]) << status.dump(1);
      // Never resumable, never ended twice.
      EXPECT_EQ(client.reply("job.resume", {{"job", id}})["error"]["code"], "conflict");
      EXPECT_EQ(client.reply("job.abort", {{"job", id}})["error"]["code"], "conflict");
    }
  }
  EXPECT_TRUE(asked_at.contains("job.state"));
  EXPECT_TRUE(asked_at.contains("scan.progress"));
  EXPECT_GE(cancelled, 1);
  // The writer of each capture is gone; TBB's own threads stay.
  EXPECT_LE(thread_count(), threads_before + std::thread::hardware_concurrency());

  const Json submitted = client.ask("scan.submit", small_scan());
  EXPECT_EQ(client.await_end(submitted["job"])["state"], "done");
  EXPECT_TRUE(results_of(site.scan(submitted["scan"])) == undisturbed_results());
}

/// The scans above end before a mesh is made; here every event of making one is met.
TEST(Abort, OfAReconstructionAtEveryEvent) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json scan = client.ask("scan.submit", small_scan());
  ASSERT_EQ(client.await_end(scan["job"])["state"], "done");
  bool reached_the_end = false;
  int cancelled = 0;
  constexpr int kMostEvents = 60;
  for (int k = 1; k <= kMostEvents && !reached_the_end; k += kStride) {
    const std::string id = client.ask("reconstruct.submit", {{"scan", scan["scan"]}})["job"];
    int seen = 0;
    bool asked = false;
    const Json job = client.await_end(id, [&](const Json& event) {
      if (!is_of(event, id) || ++seen != k) return;
      asked = true;
      client.reply("job.abort", {{"job", id}});  // conflict, where it is over already
    });
    reached_the_end = !asked;
    if (job["state"] == "cancelled") ++cancelled;
    EXPECT_TRUE(is_legal_after_abort(job["state"])) << "event " << k << ": " << job.dump(1);
    EXPECT_EQ(client.ask("status")["state"], "idle") << "event " << k;
    if (job["state"] != "cancelled") continue;
    // No half mesh is taken for a whole one.
    EXPECT_FALSE(job.contains("result")) << job["result"].dump();
  }
  EXPECT_TRUE(reached_the_end) << "more events than expected: raise the bound";
  EXPECT_GE(cancelled, 1);
  EXPECT_TRUE(results_of(site.scan(scan["scan"])) == undisturbed_results());
}

TEST(Abort, OfWhatWaitsAndOfWhatIsPaused) {
  const TestSite site;
  TestDaemon daemon(site);
  TestClient client = daemon.client();
  const Json submitted = client.ask("scan.submit", {{"batch", {small_scan(), tiny_scan()}}});
  const std::string first = submitted["jobs"][0]["job"], second = submitted["jobs"][1]["job"];
  ASSERT_TRUE(client.until([](const Json& event) { return event["topic"] == "scan.progress"; }));
  client.ask("job.pause", {{"job", first}});
  ASSERT_TRUE(client.until([](const Json& event) {
    return event["topic"] == "job.state" && event["body"]["state"] == "paused";
  }));
  EXPECT_EQ(client.ask("job.abort", {{"job", second}})["job"]["state"], "cancelled");
  client.ask("job.abort", {{"job", first}});
  EXPECT_EQ(client.await_end(first)["state"], "cancelled");
  EXPECT_EQ(client.ask("status")["state"], "idle");
}

}  // namespace
}  // namespace alhazen::testing
