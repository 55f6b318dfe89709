#include "daemon/jobs/store.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

namespace alhazen {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using std::chrono::hours;
using std::chrono::system_clock;

class StoreTest : public testing::Test {
 protected:
  StoreTest() {
    folder_ = fs::temp_directory_path() / ("alhazen_store_" + std::to_string(getpid()));
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~StoreTest() override { fs::remove_all(folder_); }

  Store open() {
    auto store = Store::open(file());
    EXPECT_TRUE(store) << store.error().text();
    return *std::move(store);
  }
  [[nodiscard]] fs::path file() const { return folder_ / "index.sqlite"; }

  static Job job(const std::string& id, JobState state = JobState::queued) {
    Job made;
    made.id = id, made.state = state;
    made.request = std::make_shared<const json>(json{{"note", "it's \"here\"; DROP TABLE job"}});
    return made;
  }

  fs::path folder_;
};

TEST_F(StoreTest, JobsComeBackInTheOrderOfTheirPlaces) {
  {
    Store store = open();
    EXPECT_TRUE(store.is_new());
    ASSERT_TRUE(store.put(job("j2"), 5, "plan of j2"));
    ASSERT_TRUE(store.put(job("j1"), 7, ""));
    ASSERT_TRUE(store.put(job("j3"), -1, ""));
    ASSERT_TRUE(store.put(job("j1", JobState::running), 8, ""));
    ASSERT_TRUE(store.drop_job("j3"));
  }
  Store store = open();
  EXPECT_FALSE(store.is_new());
  std::uint64_t damaged = 0;
  const auto jobs = store.jobs(damaged);
  ASSERT_TRUE(jobs);
  ASSERT_EQ(jobs->size(), 2U);
  EXPECT_EQ(damaged, 0U);
  EXPECT_EQ((*jobs)[0].job.id, "j2");
  EXPECT_EQ((*jobs)[0].plan, "plan of j2");
  EXPECT_EQ((*jobs)[1].job.state, JobState::running);
  EXPECT_EQ((*jobs)[1].order, 8);
  EXPECT_EQ((*jobs)[1].job.request->at("note"), "it's \"here\"; DROP TABLE job");
}

TEST_F(StoreTest, ScansComeBack) {
  const ScanEntry scan{"0001-a", "a", "note", "me", "2026-11-22T00:00:00Z", "j1", 42, 8, 102.4};
  {
    Store store = open();
    ASSERT_TRUE(store.put(scan));
    ASSERT_TRUE(store.put(ScanEntry{"0002-b", "b", "", "", "2026-11-23T00:00:00Z", "", 1, 5, 1}));
    ASSERT_TRUE(store.drop_scan("0002-b"));
  }
  const auto scans = open().scans();
  ASSERT_TRUE(scans);
  ASSERT_EQ(scans->size(), 1U);
  EXPECT_EQ((*scans)[0].id, scan.id);
  EXPECT_EQ((*scans)[0].note, scan.note);
  EXPECT_EQ((*scans)[0].stacks, 42U);
  EXPECT_EQ((*scans)[0].edge_mm, 102.4);
}

TEST_F(StoreTest, AGroupOfWritesIsAllOrNothing) {
  Store store = open();
  ASSERT_TRUE(store.begin());
  ASSERT_TRUE(store.put(job("j1"), 1, ""));
  store.rollback();
  std::uint64_t damaged = 0;
  EXPECT_TRUE(store.jobs(damaged)->empty());
  ASSERT_TRUE(store.begin());
  ASSERT_TRUE(store.put(job("j1"), 1, ""));
  ASSERT_TRUE(store.commit());
  EXPECT_EQ(store.jobs(damaged)->size(), 1U);
}

TEST_F(StoreTest, AnswersLiveForADay) {
  Store store = open();
  const system_clock::time_point noon{hours(500'000)};
  ASSERT_TRUE(store.put_answer("key", {"scan.submit {}", "{\"job\":\"j1\"}"}, noon));
  const auto soon = store.answer("key", noon + hours(23));
  ASSERT_TRUE(soon);
  ASSERT_TRUE(soon->has_value());
  EXPECT_EQ((*soon)->request, "scan.submit {}");
  EXPECT_EQ((*soon)->reply, "{\"job\":\"j1\"}");
  EXPECT_FALSE(store.answer("key", noon + hours(25))->has_value());
  EXPECT_FALSE(store.answer("other", noon)->has_value());
}

TEST_F(StoreTest, AnswersAreBounded) {
  Store store = open();
  const system_clock::time_point noon{hours(500'000)};
  ASSERT_TRUE(store.begin());
  for (int i = 0; i < Store::kMostAnswers + 5; ++i)
    ASSERT_TRUE(store.put_answer(std::to_string(i), {"a", "b"}, noon + std::chrono::seconds(i)));
  ASSERT_TRUE(store.commit());
  const auto later = noon + std::chrono::seconds(Store::kMostAnswers + 5);
  EXPECT_FALSE(store.answer("4", later)->has_value());
  EXPECT_TRUE(store.answer("5", later)->has_value());
}

TEST_F(StoreTest, ADamagedIndexIsPutAsideAndMadeAgain) {
  {
    Store store = open();
    for (int i = 0; i < 200; ++i)
      ASSERT_TRUE(store.put(job("j" + std::to_string(i)), i, std::string(1000, 'p')));
  }
  const auto size = fs::file_size(file());
  for (const std::uintmax_t offset : {std::uintmax_t{0}, size / 2}) {
    {
      std::fstream damage(file(), std::ios::in | std::ios::out | std::ios::binary);
      damage.seekp(static_cast<std::streamoff>(offset));
      damage << std::string(8192, '\x5a');
    }
    {
      Store store = open();
      EXPECT_TRUE(store.was_damaged()) << offset;
      std::uint64_t damaged = 0;
      EXPECT_TRUE(store.jobs(damaged)->empty());
      EXPECT_TRUE(fs::exists(file().string() + ".damaged"));
      for (int i = 0; i < 200; ++i)
        ASSERT_TRUE(store.put(job("j" + std::to_string(i)), i, std::string(1000, 'p')));
    }
  }
}

TEST_F(StoreTest, AFolderThatIsNotThereIsAnError) {
  const auto store = Store::open(folder_ / "nowhere" / "index.sqlite");
  ASSERT_FALSE(store);
  EXPECT_EQ(store.error().code, Code::unavailable);
}

}  // namespace
}  // namespace alhazen
