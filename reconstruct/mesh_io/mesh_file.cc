#include "reconstruct/mesh_io/mesh_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <system_error>

#include "alhazen/caught.h"
#include "alhazen/check.h"
#include "reconstruct/mesh_io/parse.h"

namespace alhazen {
namespace {

std::string reason(int error) { return std::generic_category().message(error); }

/// Closes a file descriptor at the end of its scope.
class Descriptor {
 public:
  explicit Descriptor(int number) : number_(number) {}
  ~Descriptor() { close(); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int number() const noexcept { return number_; }
  bool close() {
    const bool is_closed = number_ < 0 || ::close(number_) == 0;
    number_ = -1;
    return is_closed;
  }

 private:
  int number_;
};

std::string format_of(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  if (!extension.empty()) extension.erase(0, 1);
  std::transform(extension.begin(), extension.end(), extension.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c + ('a' - 'A') : c);
  });
  return extension;
}

Result<std::string> read_bytes(const std::filesystem::path& file) {
  // Not blocking: a pipe in a mesh's place is refused, not waited for.
  const Descriptor in(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat info {};
  if (in.number() < 0 || ::fstat(in.number(), &info) != 0)
    return Error{Code::unavailable, "cannot be read: " + reason(errno)};
  if (!S_ISREG(info.st_mode)) return Error{Code::unavailable, "is not a regular file"};
  std::string bytes(static_cast<std::size_t>(info.st_size), '\0');
  std::size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t n = ::read(in.number(), bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return Error{Code::unavailable, "cannot be read: " + reason(errno)};
    if (n == 0) break;  // it shrank meanwhile
    done += static_cast<std::size_t>(n);
  }
  bytes.resize(done);
  return bytes;
}

Error cannot_write(int error) {
  const bool is_full = error == ENOSPC || error == EDQUOT || error == EFBIG;
  return Error{is_full ? Code::exhausted : Code::unavailable,
               "cannot be written: " + reason(error)};
}

Status write_aside(const std::filesystem::path& aside, std::string_view bytes) {
  Descriptor out(::open(aside.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
  if (out.number() < 0) return cannot_write(errno);
  while (!bytes.empty()) {
    const ssize_t n = ::write(out.number(), bytes.data(), bytes.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return cannot_write(errno);
    bytes.remove_prefix(static_cast<std::size_t>(n));
  }
  if (::fsync(out.number()) != 0 || !out.close()) return cannot_write(errno);
  return {};
}

/// The file is there completely or not at all. (mesh_io is a leaf that the simulation may include;
/// hence not through reconstruct/scan.)
Status replace_file(const std::filesystem::path& file, std::string_view bytes) {
  static std::atomic<unsigned> counter{0};  // two threads may write meshes of one name
  const std::filesystem::path folder =
      file.has_parent_path() ? file.parent_path() : std::filesystem::path(".");
  const std::filesystem::path aside =
      folder / ("." + file.filename().string() + "." + std::to_string(::getpid()) + "." +
                std::to_string(counter.fetch_add(1)));
  Status written = write_aside(aside, bytes);
  if (written && ::rename(aside.c_str(), file.c_str()) != 0) written = cannot_write(errno);
  if (!written) {
    ::unlink(aside.c_str());
    return written;
  }
  const Descriptor directory(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory.number() < 0 || ::fsync(directory.number()) != 0) return cannot_write(errno);
  return {};
}

template <class T>
void append_raw(std::string& out, T value) {
  std::array<char, sizeof(T)> raw{};
  std::memcpy(raw.data(), &value, sizeof(T));
  out.append(raw.data(), raw.size());
}

template <class T>
void append_text(std::string& out, T value) {
  std::array<char, 32> buffer{};  // the longest double takes 24
  const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
  out.append(buffer.data(), end);
}

std::string to_ply(const Mesh& mesh) {
  std::string out = "ply\nformat binary_little_endian 1.0\ncomment millimetres, object frame\n";
  out += "element vertex " + std::to_string(mesh.vertices_mm.size()) + "\n";
  out += "property double x\nproperty double y\nproperty double z\n";
  if (!mesh.normals.empty()) out += "property float nx\nproperty float ny\nproperty float nz\n";
  if (!mesh.consistency.empty()) out += "property float consistency\n";
  if (!mesh.observed.empty()) out += "property uchar observed\n";
  if (!mesh.depth_sigma_mm.empty()) out += "property float depth_sigma_mm\n";
  out += "element face " + std::to_string(mesh.triangles.size()) + "\n";
  out += "property list uchar uint vertex_indices\nend_header\n";
  out.reserve(out.size() + mesh.vertices_mm.size() * 45 + mesh.triangles.size() * 13);
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    for (const double x : mesh.vertices_mm[i]) append_raw(out, x);
    if (!mesh.normals.empty()) {
      for (const float n : mesh.normals[i]) append_raw(out, n);
    }
    if (!mesh.consistency.empty()) append_raw(out, mesh.consistency[i]);
    if (!mesh.observed.empty()) append_raw(out, mesh.observed[i]);
    if (!mesh.depth_sigma_mm.empty()) append_raw(out, mesh.depth_sigma_mm[i]);
  }
  for (const auto& triangle : mesh.triangles) {
    append_raw(out, std::uint8_t{3});
    for (const std::uint32_t corner : triangle) append_raw(out, corner);
  }
  return out;
}

std::string to_obj(const Mesh& mesh) {
  std::string out = "# millimetres, object frame\n";
  const auto append_row = [&out](const char* keyword, const auto& row) {
    out += keyword;
    for (const auto x : row) {
      out += ' ';
      append_text(out, x);
    }
    out += '\n';
  };
  for (const auto& p : mesh.vertices_mm) append_row("v", p);
  for (const auto& n : mesh.normals) append_row("vn", n);
  for (const auto& triangle : mesh.triangles) {
    out += 'f';
    for (const std::uint32_t corner : triangle) {
      out += ' ';
      append_text(out, std::uint64_t{corner} + 1);
      if (!mesh.normals.empty()) {
        out += "//";
        append_text(out, std::uint64_t{corner} + 1);
      }
    }
    out += '\n';
  }
  return out;
}

std::string to_stl(const Mesh& mesh) {
  std::string out = "binary STL, millimetres, object frame";
  out.resize(80, ' ');
  out.reserve(84 + 50 * mesh.triangles.size());
  append_raw(out, static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const auto& [a, b, c] : mesh.triangles) {
    const Eigen::Vector3d& p = mesh.vertices_mm[a];
    const Eigen::Vector3d& q = mesh.vertices_mm[b];
    const Eigen::Vector3d& r = mesh.vertices_mm[c];
    const Eigen::Vector3d u = q - p, v = r - p;
    Eigen::Vector3d normal(u.y() * v.z() - u.z() * v.y(), u.z() * v.x() - u.x() * v.z(),
                           u.x() * v.y() - u.y() * v.x());
    if (const double length = normal.norm(); length > 0) normal /= length;
    for (const Eigen::Vector3d* row : std::array<const Eigen::Vector3d*, 4>{&normal, &p, &q, &r}) {
      for (const double x : *row) append_raw(out, static_cast<float>(x));
    }
    append_raw(out, std::uint16_t{0});
  }
  return out;
}

}  // namespace

Result<Mesh> parse_mesh(std::string_view bytes, std::string_view format) {
  Mesh mesh = ALHAZEN_TRY(caught(Code::internal, "reading a mesh", [&]() -> Result<Mesh> {
    if (format == "ply") return parse_ply(bytes);
    if (format == "obj") return parse_obj(bytes);
    if (format == "off") return parse_off(bytes);
    if (format == "stl") return parse_stl(bytes);
    return Error{Code::unsupported,
                 shown(format) + " is no mesh format; known: ply, obj, off, stl"};
  }));
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const std::uint32_t corner : mesh.triangles[t]) {
      if (corner >= mesh.vertices_mm.size())
        return Error{Code::invalid, "triangle " + std::to_string(t) + " refers to vertex " +
                                        std::to_string(corner) + ", there are " +
                                        std::to_string(mesh.vertices_mm.size())};
    }
  }
  if (mesh.vertices_mm.empty()) return Error{Code::invalid, "the file holds no vertices"};
  return mesh;
}

Result<Mesh> read_mesh(const std::filesystem::path& file) {
  const std::string context = "mesh " + file.string();
  const auto bytes = ALHAZEN_TRY(
      caught(Code::unavailable, "reading a mesh", [&] { return read_bytes(file); }).in(context));
  return parse_mesh(bytes, format_of(file)).in(context);
}

Status write_mesh(const Mesh& mesh, const std::filesystem::path& file) {
  const std::size_t vertices = mesh.vertices_mm.size();
  for (const std::size_t size : {mesh.normals.size(), mesh.consistency.size(), mesh.observed.size(),
                                 mesh.depth_sigma_mm.size()}) {
    ALHAZEN_CHECK(size == 0 || size == vertices);
  }
  for (const auto& triangle : mesh.triangles) {
    ALHAZEN_CHECK(triangle[0] < vertices && triangle[1] < vertices && triangle[2] < vertices);
  }
  const std::string format = format_of(file);
  const auto write = [&]() -> Status {
    if (format == "ply") return replace_file(file, to_ply(mesh));
    if (format == "obj") return replace_file(file, to_obj(mesh));
    if (format == "stl") return replace_file(file, to_stl(mesh));
    return Error{Code::unsupported, shown(format) + " cannot be written; possible: ply, obj, stl"};
  };
  return caught(Code::internal, "writing a mesh", write).in("mesh " + file.string());
}

}  // namespace alhazen
