#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "alhazen/result.h"

namespace alhazen {

/// Writes a whole file so that it is there completely or not at all: aside, fsync, rename, fsync of
/// the folder. Fails: exhausted (no space), unavailable (folder missing, read-only).
Status write_file_safely(const std::filesystem::path& file, std::string_view bytes);

/// The two halves of the same, for files that a library writes: where to write aside of `file`, and
/// the fsync, rename and fsync that make it stand. A file left aside by a crash is overwritten.
[[nodiscard]] std::filesystem::path aside(const std::filesystem::path& file);
/// Fails: as write_file_safely(); the aside file is gone then.
Status make_stand(const std::filesystem::path& file);

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
