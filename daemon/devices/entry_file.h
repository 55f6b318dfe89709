#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "alhazen/result.h"

namespace alhazen {

/// What a driver's file says of itself.
struct EntryFacts {
  std::uint32_t abi = 0;
  std::string build, name;  ///< read only where `abi` is ours: another one may have another layout
};

/// Reads the symbol alhazen_driver_entry out of the bytes of a module (ELF, 64 bit). Nothing is
/// loaded: dlopen() would run the initialisers of the module and of all libraries that it needs.
/// Hostile files welcome. Reentrant.
/// Fails: unavailable (cannot be read, no such module), unsupported (no such symbol).
/// Source: System V ABI, chapters 4 and 5 (elf(5)).
[[nodiscard]] Result<EntryFacts> read_entry(const std::filesystem::path& file);

}  // namespace alhazen
