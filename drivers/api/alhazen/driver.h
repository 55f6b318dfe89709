#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "alhazen/camera.h"
#include "alhazen/clock.h"
#include "alhazen/display.h"
#include "alhazen/result.h"
#include "alhazen/settings.h"
#include "alhazen/turntable.h"

namespace alhazen {

/// Rises with any change in drivers/api: virtuals, structs, enums, meaning. drivers/README.md keeps
/// the history; the test `abi_hash` fails when the headers change and this number does not.
inline constexpr std::uint32_t kDriverAbi = 1;

enum class Severity : std::uint8_t { debug, info, warning, error };

/// Where a driver writes its log. Thread-safe.
class Log {
 public:
  virtual ~Log() = default;
  virtual void write(Severity severity, std::string_view line) noexcept = 0;
};

/// What the core lends to a driver; outlives it.
struct Host {
  Clock& clock;
  Log& log;
};

/// A device that could be opened now.
struct Found {
  std::string kind;  ///< camera, display or turntable
  std::string model, serial;
};

/// A loaded driver instance: finds and opens devices and owns what they share.
/// Thread-bound to the rig lane. Its devices are destroyed before it.
class Driver {
 public:
  virtual ~Driver() = default;
  virtual Result<std::vector<Found>> find() noexcept = 0;
  virtual Result<std::unique_ptr<Camera>> open_camera(const Settings&) noexcept {
    return Error{Code::unsupported, "this driver has no cameras"};
  }
  virtual Result<std::unique_ptr<Display>> open_display(const Settings&) noexcept {
    return Error{Code::unsupported, "this driver has no displays"};
  }
  virtual Result<std::unique_ptr<Turntable>> open_turntable(const Settings&) noexcept {
    return Error{Code::unsupported, "this driver has no turntable"};
  }
  /// Resets the port that the device with this serial hangs on.
  virtual Status reset(std::string_view serial) noexcept {
    return Error{Code::unsupported, "this driver cannot reset " + std::string(serial)};
  }
};

}  // namespace alhazen

#if defined(__has_feature)
#define ALHAZEN_HAS_FEATURE(x) __has_feature(x)
#else
#define ALHAZEN_HAS_FEATURE(x) 0
#endif
#if defined(__SANITIZE_ADDRESS__) || ALHAZEN_HAS_FEATURE(address_sanitizer)
#define ALHAZEN_BUILD_SANITIZER "+asan"
#elif defined(__SANITIZE_THREAD__) || ALHAZEN_HAS_FEATURE(thread_sanitizer)
#define ALHAZEN_BUILD_SANITIZER "+tsan"
#else
#define ALHAZEN_BUILD_SANITIZER ""
#endif
#if defined(_GLIBCXX_ASSERTIONS)
#define ALHAZEN_BUILD_ASSERT "+assert"
#else
#define ALHAZEN_BUILD_ASSERT ""
#endif
#define ALHAZEN_TEXT2(x) #x
#define ALHAZEN_TEXT(x) ALHAZEN_TEXT2(x)
/// What must be equal on both sides for std types to cross: library, string ABI, assertions,
/// sanitizer.
#define ALHAZEN_DRIVER_BUILD                                                                  \
  "libstdc++" ALHAZEN_TEXT(_GLIBCXX_RELEASE) "/cxx11abi" ALHAZEN_TEXT(_GLIBCXX_USE_CXX11_ABI) \
      ALHAZEN_BUILD_ASSERT ALHAZEN_BUILD_SANITIZER

/// The one exported symbol of a driver: plain data, judged before any driver function runs.
extern "C" struct AlhazenDriverEntry {
  std::uint32_t abi;    ///< == kDriverAbi of the core, or refused
  const char* build;    ///< == ALHAZEN_DRIVER_BUILD of the core, or refused
  const char* name;     ///< equals alhazen-<name>.so and `use` in the configuration
  const char* summary;  ///< one line for people
  bool virtual_time;    ///< keeps to Host::clock alone, so it can run in virtual time
  alhazen::Result<std::unique_ptr<alhazen::Driver>> (*open)(const alhazen::Host&,
                                                            const alhazen::Settings&) noexcept;
};

#define ALHAZEN_DRIVER(name, summary, virtual_time, open)                                 \
  extern "C" __attribute__((                                                              \
      visibility("default"))) constinit const AlhazenDriverEntry alhazen_driver_entry = { \
      alhazen::kDriverAbi, ALHAZEN_DRIVER_BUILD, name, summary, virtual_time, open}
