#include "daemon/devices/loader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

/// Every odd driver counts itself here as soon as any of its code runs.
extern "C" __attribute__((visibility("default"))) int odd_drivers_begun;
int odd_drivers_begun = 0;

namespace alhazen {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const std::string kFolder = ALHAZEN_BINARY_DIR "/odd_drivers";

TEST(Loader, ADriverThatFitsIsLoadedOnce) {
  Loader loader(kFolder);
  const auto entry = loader.load("fits");
  ASSERT_TRUE(entry) << entry.error().text();
  EXPECT_STREQ((*entry)->name, "fits");
  EXPECT_FALSE((*entry)->virtual_time);
  EXPECT_EQ(*loader.load("fits"), *entry);
  EXPECT_EQ(odd_drivers_begun, 1) << "the count below would prove nothing";
}

/// A driver that must be refused, and what is said about it.
struct Refused {
  const char* name;
  Code code;
  const char *said, *said_too;
};
class RefusedDriver : public testing::TestWithParam<Refused> {};

TEST_P(RefusedDriver, IsRefusedWithASentenceBeforeItsCodeRuns) {
  const int begun = odd_drivers_begun;
  const auto entry = Loader(kFolder).load(GetParam().name);
  ASSERT_FALSE(entry);
  EXPECT_EQ(odd_drivers_begun, begun);
  EXPECT_EQ(entry.error().code, GetParam().code);
  EXPECT_THAT(entry.error().what,
              AllOf(HasSubstr(GetParam().said), HasSubstr(GetParam().said_too)));
}

INSTANTIATE_TEST_SUITE_P(
    Drivers, RefusedDriver,
    testing::Values(Refused{"other-abi", Code::unsupported, "driver 'other-abi' speaks driver ABI",
                            "build both from one tree"},
                    Refused{"other-build", Code::unsupported, "was built as 'libstdc++6/cxx11abi0'",
                            "this daemon as '" ALHAZEN_DRIVER_BUILD "'"},
                    Refused{"other-name", Code::unsupported, "calls itself 'somebody-else'", ""},
                    Refused{"no-entry", Code::unsupported, "is not a driver",
                            "no symbol alhazen_driver_entry"},
                    Refused{"absent", Code::unavailable, "no file", "alhazen-absent.so"},
                    Refused{"../evil", Code::invalid, "'../evil' must be 1 to 32 characters", ""},
                    Refused{"", Code::invalid, "must be 1 to 32 characters", ""}));

TEST(Loader, AFileThatIsNoModuleIsRefused) {
  const auto folder = std::filesystem::temp_directory_path() / "alhazen_loader_test";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "alhazen-text.so") << "not a module at all\n";
  const auto entry = Loader(folder).load("text");
  ASSERT_FALSE(entry);
  EXPECT_EQ(entry.error().code, Code::unavailable);
  EXPECT_THAT(entry.error().text(), HasSubstr("driver 'text' cannot be loaded"));

  // A driver cut off anywhere, or with any of its first bytes changed, is refused or judged.
  std::ifstream in(kFolder + "/alhazen-other-abi.so", std::ios::binary);
  const std::string whole(std::istreambuf_iterator<char>(in), {});
  ASSERT_GT(whole.size(), 1000U);
  const auto refuse = [&](const std::string& bytes) {
    std::ofstream(folder / "alhazen-other-abi.so", std::ios::binary) << bytes;
    EXPECT_FALSE(Loader(folder).load("other-abi"));
  };
  for (std::size_t length = 0; length < whole.size(); length += whole.size() / 50)
    refuse(whole.substr(0, length));
  for (std::size_t i = 0; i < 64; ++i) {
    std::string bytes = whole;
    bytes[i] = static_cast<char>(~bytes[i]);
    refuse(bytes);
  }
  std::filesystem::remove_all(folder);
}

TEST(Loader, AnEntryMayBeHandedIn) {
  static constexpr AlhazenDriverEntry kEntry{
      kDriverAbi,
      ALHAZEN_DRIVER_BUILD,
      "mine",
      "",
      true,
      [](const Host&, const Settings&) noexcept -> Result<std::unique_ptr<Driver>> {
        return Error{Code::unsupported, "nothing"};
      }};
  Loader loader("");
  ASSERT_TRUE(loader.adopt(kEntry));
  EXPECT_EQ(*loader.load("mine"), &kEntry);
  EXPECT_EQ(loader.adopt(kEntry).error().code, Code::conflict);
}

TEST(Loader, AnEntryHandedInIsJudgedToo) {
  static constexpr AlhazenDriverEntry kOld{kDriverAbi - 1, nullptr, nullptr,
                                           nullptr,        false,   nullptr};
  static constexpr AlhazenDriverEntry kHalf{kDriverAbi, ALHAZEN_DRIVER_BUILD, "half", "", false,
                                            nullptr};
  Loader loader("");
  EXPECT_THAT(loader.adopt(kOld).error().what, HasSubstr("speaks driver ABI"));
  EXPECT_THAT(loader.adopt(kHalf).error().what, HasSubstr("not complete"));
}

}  // namespace
}  // namespace alhazen
