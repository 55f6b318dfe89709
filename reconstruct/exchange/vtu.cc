#include "reconstruct/exchange/vtu.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <fstream>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "alhazen/check.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

static_assert(std::endian::native == std::endian::little, "the file says LittleEndian");

constexpr std::uint8_t kVoxelCell = 11;  // VTK_VOXEL: corners with x running fastest, then y, z

/// The distinct corners of an octree's leaves on the grid of its finest level.
class Corners {
 public:
  explicit Corners(const Octree& octree) : octree_(octree) {
    keys_.reserve(8 * octree.size());
    for (std::size_t leaf = 0; leaf < octree.size(); ++leaf) {
      for (int corner = 0; corner < 8; ++corner) keys_.push_back(key(leaf, corner));
    }
    std::ranges::sort(keys_);
    keys_.erase(std::unique(keys_.begin(), keys_.end()), keys_.end());
  }
  [[nodiscard]] std::size_t size() const noexcept { return keys_.size(); }
  [[nodiscard]] std::size_t index(std::size_t leaf, int corner) const {
    return static_cast<std::size_t>(std::ranges::lower_bound(keys_, key(leaf, corner)) -
                                    keys_.begin());
  }
  [[nodiscard]] Eigen::Vector3f point_mm(std::size_t index) const {
    const std::uint64_t k = keys_[index];
    const double edge_mm = octree_.volume().edge_mm / (1 << octree_.finest_level());
    const Eigen::Vector3d steps(static_cast<double>(k & kMask),
                                static_cast<double>((k >> kBits) & kMask),
                                static_cast<double>(k >> (2 * kBits)));
    return (octree_.low_corner_mm() + edge_mm * steps).cast<float>();
  }

 private:
  static constexpr int kBits = 20;
  static constexpr std::uint64_t kMask = (std::uint64_t{1} << kBits) - 1;
  static_assert(Octree::kMaxLevel < kBits);

  [[nodiscard]] std::uint64_t key(std::size_t leaf, int corner) const {
    const Leaf& l = octree_.leaves()[leaf];
    const int shift = octree_.finest_level() - l.level;
    const auto at = [&](std::uint16_t low, int bit) {
      return static_cast<std::uint64_t>(low + ((corner >> bit) & 1)) << shift;
    };
    return at(l.x, 0) | at(l.y, 1) << kBits | at(l.z, 2) << (2 * kBits);
  }

  const Octree& octree_;
  std::vector<std::uint64_t> keys_;
};

/// Bytes to a stream in base64 (RFC 4648).
class Base64 {
 public:
  explicit Base64(std::ostream& out) : out_(out) {}

  void put(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < size; ++i) {
      held_[count_++] = bytes[i];
      if (count_ == 3) give(4);
    }
  }
  void finish() {
    if (count_ > 0) {
      const std::size_t digits = count_ + 1;
      std::fill(held_.begin() + static_cast<std::ptrdiff_t>(count_), held_.end(), 0);
      give(digits);
    }
    flush();
  }
  [[nodiscard]] static std::uint64_t length(std::uint64_t bytes) { return (bytes + 2) / 3 * 4; }

 private:
  void give(std::size_t digits) {
    constexpr std::string_view kDigits =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const unsigned word = static_cast<unsigned>(held_[0]) << 16 |
                          static_cast<unsigned>(held_[1]) << 8 | static_cast<unsigned>(held_[2]);
    for (std::size_t k = 0; k < 4; ++k)
      text_ += k < digits ? kDigits[(word >> (18 - 6 * k)) & 63] : '=';
    count_ = 0;
    if (text_.size() >= kFlushAt) flush();
  }
  void flush() {
    out_.write(text_.data(), static_cast<std::streamsize>(text_.size()));
    text_.clear();
  }

  static constexpr std::size_t kFlushAt = std::size_t{1} << 16;
  std::ostream& out_;
  std::string text_;
  std::array<unsigned char, 3> held_{};
  std::size_t count_ = 0;
};

/// One DataArray: how it is announced, and what writes its elements.
struct Array {
  std::string name;
  const char* type;
  int components;
  std::uint64_t bytes;
  std::function<void(Base64&)> put;
};

template <class T>
void put_one(Base64& out, T value) {
  out.put(&value, sizeof value);
}

/// An array that is in memory as it goes into the file.
template <class T>
Array in_memory(const char* name, const char* type, std::span<const T> list, int components) {
  return {name, type, components, list.size_bytes(),
          [list](Base64& out) { out.put(list.data(), list.size_bytes()); }};
}

/// An array whose element i is value(i).
template <class T, class Value>
Array computed(const char* name, const char* type, std::size_t count, Value value) {
  return {name, type, 1, count * sizeof(T), [count, value](Base64& out) {
            for (std::size_t i = 0; i < count; ++i) put_one(out, static_cast<T>(value(i)));
          }};
}

void write(std::ostream& out, std::size_t points, std::size_t cells, const Array& coordinates,
           const std::vector<Array>& structure, const std::vector<Array>& data) {
  std::uint64_t offset = 0;
  const auto announce = [&](const Array& array) {
    out << R"(<DataArray type=")" << array.type << R"(" Name=")" << array.name
        << R"(" NumberOfComponents=")" << array.components << R"(" format="appended" offset=")"
        << offset << "\"/>\n";
    offset += Base64::length(sizeof(std::uint64_t) + array.bytes);
  };
  out << "<?xml version=\"1.0\"?>\n"
         "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" "
         "header_type=\"UInt64\">\n<UnstructuredGrid>\n<Piece NumberOfPoints=\""
      << points << "\" NumberOfCells=\"" << cells << "\">\n<Points>\n";
  announce(coordinates);
  out << "</Points>\n<Cells>\n";
  for (const Array& array : structure) announce(array);
  out << "</Cells>\n<CellData Scalars=\"consistency\" Vectors=\"normal\">\n";
  for (const Array& array : data) announce(array);
  out << "</CellData>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"base64\">\n_";
  const auto append = [&](const Array& array) {
    Base64 text(out);
    put_one(text, array.bytes);
    array.put(text);
    text.finish();
  };
  append(coordinates);
  for (const Array& array : structure) append(array);
  for (const Array& array : data) append(array);
  out << "\n</AppendedData>\n</VTKFile>\n";
}

}  // namespace

Status write_vtu(const Octree& octree, const NormalField& field,
                 std::span<const float> divergence_per_mm, const Indicator& indicator,
                 const std::filesystem::path& file) {
  const std::size_t cells = octree.size();
  for (const std::size_t size :
       {field.normal.size(), field.consistency.size(), field.support.size(), field.votes.size(),
        field.free_space.size(), field.no_surface.size(), divergence_per_mm.size(),
        indicator.u.size()}) {
    ALHAZEN_CHECK(size == cells);
  }
  const Corners corners(octree);
  const Array coordinates{"points", "Float32", 3, corners.size() * 3 * sizeof(float),
                          [&](Base64& out) {
                            for (std::size_t i = 0; i < corners.size(); ++i) {
                              const Eigen::Vector3f p = corners.point_mm(i);
                              out.put(p.data(), 3 * sizeof(float));
                            }
                          }};
  const std::vector<Array> structure = {
      computed<std::int64_t>(
          "connectivity", "Int64", 8 * cells,
          [&](std::size_t i) { return corners.index(i / 8, static_cast<int>(i % 8)); }),
      computed<std::int64_t>("offsets", "Int64", cells, [](std::size_t i) { return 8 * (i + 1); }),
      computed<std::uint8_t>("types", "UInt8", cells, [](std::size_t) { return kVoxelCell; })};
  static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float));
  const std::span<const float> normals(reinterpret_cast<const float*>(field.normal.data()),
                                       3 * cells);
  const std::vector<Array> data = {
      in_memory("normal", "Float32", normals, 3),
      in_memory<float>("consistency", "Float32", field.consistency, 1),
      in_memory<float>("support", "Float32", field.support, 1),
      in_memory<std::uint16_t>("votes", "UInt16", field.votes, 1),
      in_memory<std::uint8_t>("free_space", "UInt8", field.free_space, 1),
      in_memory<std::uint8_t>("no_surface", "UInt8", field.no_surface, 1),
      in_memory("divergence_per_mm", "Float32", divergence_per_mm, 1),
      in_memory<float>("indicator", "Float32", indicator.u, 1),
      computed<std::uint8_t>("level", "UInt8", cells,
                             [&](std::size_t i) { return octree.leaves()[i].level; })};

  return write_file_safely(file, [&](std::ofstream& out) {
    write(out, corners.size(), cells, coordinates, structure, data);
  });
}

}  // namespace alhazen
