#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>

#include "alhazen/result.h"

namespace alhazen {

/// Writes a whole file so that it is there completely or not at all: aside, fsync, rename, fsync of
/// the folder. Fails: exhausted (no space), unavailable (folder missing, read-only).
Status write_file_safely(const std::filesystem::path& file, std::string_view bytes);

/// Reads a whole file of at most `max_bytes`. Fails: unavailable, invalid (too large).
[[nodiscard]] Result<std::string> read_file(const std::filesystem::path& file,
                                            std::uint64_t max_bytes);

}  // namespace alhazen
