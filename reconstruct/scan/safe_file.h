#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <iosfwd>
#include <string>
#include <string_view>

#include "alhazen/result.h"

namespace alhazen {

/// Writes a whole file so that it is there completely or not at all: aside, fsync, rename, fsync of
/// the folder. Fails: exhausted (no space), unavailable (folder missing, read-only).
Status write_file_safely(const std::filesystem::path& file, std::string_view bytes);

/// The same for what a library writes: `write` is called once with the stream, and may throw.
/// Fails: as write_file_safely(), exhausted where `write` throws.
Status write_file_safely(const std::filesystem::path& file,
                         const std::function<void(std::ofstream&)>& write);

/// Where what is to become `file` (or folder) is written before it stands; what a crash left there
/// is overwritten.
[[nodiscard]] std::filesystem::path aside(const std::filesystem::path& file);

/// Appends to a file (made where it is missing) and syncs it. A crash may leave a part of `bytes`,
/// a failure leaves nothing of them. Fails: as write_file_safely().
Status append_to_file(const std::filesystem::path& file, std::string_view bytes);

/// Cuts a file off after `bytes` and syncs it. Fails: unavailable.
Status cut_file(const std::filesystem::path& file, std::uint64_t bytes);

/// Syncs a folder, so that what was made or renamed in it stands. Fails: unavailable.
Status sync_folder(const std::filesystem::path& folder);

/// Reads a whole file of at most `max_bytes`. Fails: unavailable, invalid (too large, or no plain
/// file).
[[nodiscard]] Result<std::string> read_file(const std::filesystem::path& file,
                                            std::uint64_t max_bytes);

}  // namespace alhazen
