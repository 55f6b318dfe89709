#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "alhazen/driver.h"
#include "alhazen/result.h"

namespace alhazen {

/// Finds drivers: lib/alhazen-NAME.so, or an entry handed in by a test. What was loaded stays
/// loaded until the process ends (deleters of pixels may live in it). Thread-bound.
class Loader {
 public:
  explicit Loader(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// The entry of driver `name`, loaded at the first call. ABI number, build tag and name are
  /// judged by the bytes of its file, before any of its code runs, initialisers among it.
  /// Fails: unavailable (no such file, not a loadable module), unsupported (no entry, other ABI,
  ///        other build, other name).
  [[nodiscard]] Result<const AlhazenDriverEntry*> load(const std::string& name);

  /// Takes an entry from anywhere; it must outlive the loader. Fails as load().
  Status adopt(const AlhazenDriverEntry& entry);

 private:
  std::filesystem::path folder_;
  std::map<std::string, const AlhazenDriverEntry*, std::less<>> entries_;
};

}  // namespace alhazen
