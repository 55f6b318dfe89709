// Whatever the bytes of a driver's file: an error, or facts that are in the file.
#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "alhazen/result.h"
#include "daemon/devices/entry_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const int file = memfd_create("driver", MFD_CLOEXEC);
  static const std::string path = "/proc/self/fd/" + std::to_string(file);
  ALHAZEN_CHECK(file >= 0 && ftruncate(file, 0) == 0);
  ALHAZEN_CHECK(pwrite(file, data, size, 0) == static_cast<ssize_t>(size));
  const auto facts = alhazen::read_entry(path);
  if (facts) {
    const std::string_view bytes(reinterpret_cast<const char*>(data), size);
    ALHAZEN_CHECK(bytes.find(facts->name) != std::string_view::npos);
    ALHAZEN_CHECK(bytes.find(facts->build) != std::string_view::npos);
  }
  return 0;
}
