#include "reconstruct/scan/safe_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <system_error>

#include "alhazen/caught.h"

namespace alhazen {
namespace {

namespace fs = std::filesystem;

/// A POSIX file descriptor that closes itself.
class Descriptor {
 public:
  Descriptor(const fs::path& file, int flags)
      : value_(::open(file.c_str(), flags | O_CLOEXEC, 0644)) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (value_ >= 0) ::close(value_);
  }
  [[nodiscard]] int value() const noexcept { return value_; }
  [[nodiscard]] explicit operator bool() const noexcept { return value_ >= 0; }

 private:
  int value_;
};

/// The last system call's failure, as an Error about `file`.
Error failure(std::string_view verb, const fs::path& file) {
  const int number = errno;
  const bool full = number == ENOSPC || number == EDQUOT || number == EFBIG;
  return {full ? Code::exhausted : Code::unavailable,
          "cannot " + std::string(verb) + " '" + file.string() +
              "': " + std::error_code(number, std::generic_category()).message()};
}

Status write_all(const Descriptor& out, std::string_view bytes, const fs::path& file) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(out.value(), bytes.data(), bytes.size());
    if (written < 0 && errno != EINTR) return failure("write", file);
    bytes.remove_prefix(static_cast<std::size_t>(std::max<ssize_t>(written, 0)));
  }
  return {};
}

/// Sync, rename and the folder's sync; where they fail, the file aside is gone.
Status make_stand(const fs::path& file) {
  const fs::path partial = aside(file);
  Status done = [&]() -> Status {
    {
      const Descriptor out(partial, O_RDONLY);
      if (!out || ::fsync(out.value()) != 0) return failure("sync", partial);
    }
    if (::rename(partial.c_str(), file.c_str()) != 0) return failure("rename to", file);
    return sync_folder(file.parent_path());
  }();
  if (!done) ::unlink(partial.c_str());
  return done;
}

}  // namespace

fs::path aside(const fs::path& file) {
  return file.parent_path() / ("." + file.filename().string() + ".partial");
}

Status sync_folder(const fs::path& folder) {
  const Descriptor in(folder.empty() ? fs::path(".") : folder, O_RDONLY | O_DIRECTORY);
  if (!in || ::fsync(in.value()) != 0) return failure("sync folder", folder);
  return {};
}

Status write_file_safely(const fs::path& file, std::string_view bytes) {
  const fs::path partial = aside(file);
  {
    const Descriptor out(partial, O_WRONLY | O_CREAT | O_TRUNC);
    if (!out) return failure("create", partial);
    Status written = write_all(out, bytes, partial);
    if (!written) {
      ::unlink(partial.c_str());
      return written;
    }
  }
  return make_stand(file);
}

Status write_file_safely(const fs::path& file, const std::function<void(std::ofstream&)>& write) {
  const fs::path partial = aside(file);
  std::ofstream stream(partial, std::ios::binary | std::ios::trunc);
  if (!stream) return failure("create", partial);
  Status written =
      caught(Code::exhausted, "writing '" + partial.string() + "'", [&] { write(stream); });
  stream.close();
  if (written && !stream) {
    written = Error{Code::exhausted, "cannot write '" + partial.string() + "' to its end"};
  }
  if (!written) {
    ::unlink(partial.c_str());
    return written;
  }
  return make_stand(file);
}

Status append_to_file(const fs::path& file, std::string_view bytes) {
  std::error_code error;
  const bool is_new = !fs::exists(file, error);
  const Descriptor out(file, O_WRONLY | O_CREAT | O_APPEND);
  if (!out) return failure("open", file);
  const off_t before = ::lseek(out.value(), 0, SEEK_END);
  Status done = write_all(out, bytes, file);
  if (done && ::fsync(out.value()) != 0) done = failure("sync", file);
  if (!done) {
    // Whoever tries again appends all of it; half a line before that would damage the file.
    [[maybe_unused]] const int cut = ::ftruncate(out.value(), before);
    return done;
  }
  return is_new ? sync_folder(file.parent_path()) : Status{};
}

Status cut_file(const fs::path& file, std::uint64_t bytes) {
  const Descriptor out(file, O_WRONLY);
  if (!out || ::ftruncate(out.value(), static_cast<off_t>(bytes)) != 0 ||
      ::fsync(out.value()) != 0) {
    return failure("cut", file);
  }
  return {};
}

Result<std::string> read_file(const fs::path& file, std::uint64_t max_bytes) {
  // Never wait for the other end of a pipe somebody put there.
  const Descriptor in(file, O_RDONLY | O_NONBLOCK);
  struct stat about {};
  if (!in || ::fstat(in.value(), &about) != 0) return failure("read", file);
  if (!S_ISREG(about.st_mode)) {
    return Error{Code::invalid, "'" + file.string() + "' is not a plain file"};
  }
  const auto size = static_cast<std::uint64_t>(about.st_size);
  if (size > max_bytes) {
    return Error{Code::invalid, "'" + file.string() + "' has " + std::to_string(size) +
                                    " bytes; at most " + std::to_string(max_bytes) + " are read"};
  }
  std::string bytes(size, '\0');
  std::size_t got = 0;
  while (got < bytes.size()) {
    const ssize_t read = ::read(in.value(), bytes.data() + got, bytes.size() - got);
    if (read < 0 && errno != EINTR) return failure("read", file);
    if (read == 0) break;
    got += static_cast<std::size_t>(std::max<ssize_t>(read, 0));
  }
  bytes.resize(got);
  return bytes;
}

}  // namespace alhazen
