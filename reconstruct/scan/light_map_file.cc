#include "reconstruct/scan/light_map_file.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStdIO.h>
#include <OpenEXR/ImfStringAttribute.h>

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "alhazen/caught.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

static_assert(std::endian::native == std::endian::little, "read_bytes() below assumes it");

constexpr int kMaxSide_px = 65'535;
constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 32;
// Bytes of a pixel in the file: five FLOAT and three UINT channels.
constexpr std::uint64_t kPixelBytes = 32;
// Rows converted at once: the lists of small integers are UINT in the file, bytes in memory.
constexpr int kBlockRows = 64;
constexpr int kMaxLabel = static_cast<int>(Label::second_bounce);
constexpr int kMaxBit = 14;  // one beyond the finest bit of the largest display: none was resolved

struct FloatChannel {
  const char* name;
  PixelList<float> LightMap::*list;
};
constexpr std::array<FloatChannel, 5> kFloats = {{{"u", &LightMap::u_px},
                                                  {"v", &LightMap::v_px},
                                                  {"sigma_u_px", &LightMap::sigma_u_px},
                                                  {"sigma_v_px", &LightMap::sigma_v_px},
                                                  {"contrast", &LightMap::contrast}}};
constexpr std::array<const char*, 3> kIntegers = {"label", "bit_u", "bit_v"};

/// Over everything a light map says, so that no flipped bit goes unseen.
std::string checksum(const LightMap& map) {
  std::uint64_t digest = 0;  // of each part, seeded with that of the part before
  const auto add = [&](const void* data, std::size_t size) {
    digest = XXH3_64bits_withSeed(data, size, digest);
  };
  const std::array<std::int32_t, 7> numbers = {map.key.stop,
                                               static_cast<std::int32_t>(map.key.display.size()),
                                               static_cast<std::int32_t>(map.key.camera.size()),
                                               map.region.x,
                                               map.region.y,
                                               map.region.width,
                                               map.region.height};
  add(numbers.data(), sizeof numbers);
  add(map.key.display.data(), map.key.display.size());
  add(map.key.camera.data(), map.key.camera.size());
  add(&map.angle_rad, sizeof map.angle_rad);
  for (const FloatChannel& channel : kFloats) {
    add((map.*channel.list).data(), (map.*channel.list).size() * sizeof(float));
  }
  add(map.label.data(), map.label.size());
  add(map.bit_u.data(), map.bit_u.size());
  add(map.bit_v.data(), map.bit_v.size());
  std::array<char, 17> text{};
  std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(digest));
  return text.data();
}

Imath::Box2i window_of(const Region& region) {
  return {{region.x, region.y}, {region.x + region.width - 1, region.y + region.height - 1}};
}

/// A slice of a list that begins with row `first_row` of the region.
template <class Value>
Imf::Slice slice(Imf::PixelType type, const Value* list, const Region& region, int first_row) {
  const auto width = static_cast<std::size_t>(region.width);
  return Imf::Slice::Make(type, list, Imath::V2i(region.x, region.y + first_row), region.width,
                          region.height - first_row, sizeof(Value), sizeof(Value) * width);
}

void write_exr(const LightMap& map, Imf::OStream& out) {
  Imf::Header header(window_of(map.region), window_of(map.region));
  header.compression() = Imf::NO_COMPRESSION;
  for (const FloatChannel& channel : kFloats) {
    header.channels().insert(channel.name, Imf::Channel(Imf::FLOAT));
  }
  for (const char* name : kIntegers) header.channels().insert(name, Imf::Channel(Imf::UINT));
  header.insert("stop", Imf::IntAttribute(map.key.stop));
  header.insert("display", Imf::StringAttribute(map.key.display));
  header.insert("camera", Imf::StringAttribute(map.key.camera));
  header.insert("angle_rad", Imf::DoubleAttribute(map.angle_rad));
  header.insert("xxh3_64", Imf::StringAttribute(checksum(map)));
  Imf::OutputFile file(out, header);
  const auto width = static_cast<std::size_t>(map.region.width);
  std::array<std::vector<std::uint32_t>, 3> block;
  for (auto& list : block) list.resize(width * kBlockRows);
  for (int row = 0; row < map.region.height; row += kBlockRows) {
    const int rows = std::min(kBlockRows, map.region.height - row);
    const std::size_t begin = static_cast<std::size_t>(row) * width;
    for (std::size_t i = 0; i < static_cast<std::size_t>(rows) * width; ++i) {
      block[0][i] = static_cast<std::uint32_t>(map.label[begin + i]);
      block[1][i] = map.bit_u[begin + i];
      block[2][i] = map.bit_v[begin + i];
    }
    Imf::FrameBuffer buffer;
    for (const FloatChannel& channel : kFloats) {
      buffer.insert(channel.name, slice(Imf::FLOAT, (map.*channel.list).data(), map.region, 0));
    }
    for (std::size_t i = 0; i < kIntegers.size(); ++i) {
      buffer.insert(kIntegers[i], slice(Imf::UINT, block[i].data(), map.region, row));
    }
    file.setFrameBuffer(buffer);
    file.writePixels(rows);
  }
}

/// The bytes of a file in memory, as OpenEXR wants to read them.
class MemoryStream : public Imf::IStream {
 public:
  explicit MemoryStream(std::string_view bytes) : IStream("light map"), bytes_(bytes) {}
  bool isMemoryMapped() const override { return true; }
  char* readMemoryMapped(int count) override {
    const std::string_view got = take(count);
    // OpenEXR's interface is not const, but it reads only.
    return const_cast<char*>(got.data());
  }
  bool read(char buffer[], int count) override {
    const std::string_view got = take(count);
    std::memcpy(buffer, got.data(), got.size());
    return at_ < bytes_.size();
  }
  std::uint64_t tellg() override { return at_; }
  void seekg(std::uint64_t at) override { at_ = at; }
  void clear() override {}

 private:
  std::string_view take(int count) {
    if (count < 0 || at_ > bytes_.size() ||
        static_cast<std::uint64_t>(count) > bytes_.size() - at_) {
      throw std::out_of_range("the file ends early");  // the way IStream reports it
    }
    const std::string_view got = bytes_.substr(at_, static_cast<std::size_t>(count));
    at_ += static_cast<std::uint64_t>(count);
    return got;
  }
  std::string_view bytes_;
  std::uint64_t at_ = 0;
};

/// OpenEXR allocates what a header claims before it finds the file too short. So look first: one
/// part of scan lines, and every attribute small and inside the file.
/// Source: "OpenEXR File Layout", openexr.com.
Status check_header(std::string_view bytes) {
  constexpr std::string_view kMagic("\x76\x2f\x31\x01\x02\x00\x00\x00", 8);
  constexpr std::size_t kLongestName = 31, kLongestAttribute = 4096, kLongestChannels = 512;
  constexpr int kMostAttributes = 64;
  if (!bytes.starts_with(kMagic)) {
    return Error{Code::corrupt, "not an OpenEXR 2 file of one part of scan lines"};
  }
  bytes.remove_prefix(kMagic.size());
  for (int i = 0; i <= kMostAttributes; ++i) {
    if (bytes.starts_with('\0')) return {};
    std::array<std::string_view, 2> names;  // of the attribute, of its type
    for (std::string_view& name : names) {
      const std::size_t end = bytes.substr(0, kLongestName + 1).find('\0');
      if (end == std::string_view::npos) {
        return Error{Code::corrupt, "the header ends early or holds a name over 31 bytes"};
      }
      name = bytes.substr(0, end);
      bytes.remove_prefix(end + 1);
    }
    std::int32_t size = -1;
    if (bytes.size() >= sizeof size) std::memcpy(&size, bytes.data(), sizeof size);
    const std::size_t longest = names[0] == "channels" ? kLongestChannels : kLongestAttribute;
    if (size < 0 || static_cast<std::size_t>(size) > longest ||
        static_cast<std::size_t>(size) > bytes.size() - sizeof size) {
      return Error{Code::corrupt, "attribute '" + std::string(names[0]) +
                                      "' ends early or has over " + std::to_string(longest) +
                                      " bytes"};
    }
    bytes.remove_prefix(sizeof size + static_cast<std::size_t>(size));
  }
  return Error{Code::corrupt, "the header holds over 64 attributes"};
}

template <class Attribute>
Result<typename std::remove_cvref_t<decltype(std::declval<Attribute>().value())>> attribute(
    const Imf::Header& header, const char* name) {
  const auto* found = header.findTypedAttribute<Attribute>(name);
  if (found == nullptr) {
    return Error{Code::corrupt,
                 "attribute '" + std::string(name) + "' is missing or has another type"};
  }
  return found->value();
}

Status check_channel(const Imf::Header& header, const char* name, Imf::PixelType type) {
  const Imf::Channel* channel = header.channels().findChannel(name);
  if (channel == nullptr || channel->type != type || channel->xSampling != 1 ||
      channel->ySampling != 1) {
    return Error{Code::corrupt, "channel '" + std::string(name) + "' is missing or is not " +
                                    (type == Imf::FLOAT ? "FLOAT" : "UINT")};
  }
  return {};
}

/// What the header says, with lists of the right length. Nothing is allocated that the file does
/// not hold.
Result<LightMap> read_header(const Imf::Header& header, std::size_t file_bytes) {
  const Imath::Box2i& window = header.dataWindow();
  const std::int64_t width = std::int64_t{window.max.x} - window.min.x + 1;
  const std::int64_t height = std::int64_t{window.max.y} - window.min.y + 1;
  if (window.min.x < 0 || window.min.y < 0 || width < 1 || height < 1 ||
      window.max.x > kMaxSide_px || window.max.y > kMaxSide_px) {
    return Error{Code::corrupt, "attribute 'dataWindow' reaches outside [0, 65535] px"};
  }
  if (header.compression() != Imf::NO_COMPRESSION) {
    return Error{Code::corrupt, "attribute 'compression' is not 'none'"};
  }
  if (static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height) * kPixelBytes >
      file_bytes) {
    return Error{Code::corrupt, "the file is shorter than its data window"};
  }
  std::size_t channels = 0;
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) ++channels;
  if (channels != kFloats.size() + kIntegers.size()) {
    return Error{Code::corrupt,
                 "the file has " + std::to_string(channels) + " channels; it must have 8"};
  }
  for (const FloatChannel& channel : kFloats) {
    ALHAZEN_TRY(check_channel(header, channel.name, Imf::FLOAT));
  }
  for (const char* name : kIntegers) ALHAZEN_TRY(check_channel(header, name, Imf::UINT));
  LightMap map;
  map.key.stop = ALHAZEN_TRY(attribute<Imf::IntAttribute>(header, "stop"));
  map.key.display = ALHAZEN_TRY(attribute<Imf::StringAttribute>(header, "display"));
  map.key.camera = ALHAZEN_TRY(attribute<Imf::StringAttribute>(header, "camera"));
  map.angle_rad = ALHAZEN_TRY(attribute<Imf::DoubleAttribute>(header, "angle_rad"));
  if (map.key.stop < 0) return Error{Code::corrupt, "attribute 'stop' is negative"};
  if (!std::isfinite(map.angle_rad)) {
    return Error{Code::corrupt, "attribute 'angle_rad' is not finite"};
  }
  map.region = {window.min.x, window.min.y, static_cast<int>(width), static_cast<int>(height)};
  for (const FloatChannel& channel : kFloats) (map.*channel.list).resize(map.size_px());
  map.label.resize(map.size_px());
  map.bit_u.resize(map.size_px());
  map.bit_v.resize(map.size_px());
  return map;
}

Status read_pixels(Imf::InputFile& file, LightMap& map) {
  const auto width = static_cast<std::size_t>(map.region.width);
  std::array<std::vector<std::uint32_t>, 3> block;
  for (auto& list : block) list.resize(width * kBlockRows);
  for (int row = 0; row < map.region.height; row += kBlockRows) {
    const int rows = std::min(kBlockRows, map.region.height - row);
    Imf::FrameBuffer buffer;
    for (const FloatChannel& channel : kFloats) {
      buffer.insert(channel.name, slice(Imf::FLOAT, (map.*channel.list).data(), map.region, 0));
    }
    for (std::size_t i = 0; i < kIntegers.size(); ++i) {
      buffer.insert(kIntegers[i], slice(Imf::UINT, block[i].data(), map.region, row));
    }
    file.setFrameBuffer(buffer);
    file.readPixels(map.region.y + row, map.region.y + row + rows - 1);
    const std::size_t begin = static_cast<std::size_t>(row) * width;
    for (std::size_t i = 0; i < static_cast<std::size_t>(rows) * width; ++i) {
      if (block[0][i] > kMaxLabel) {
        return Error{Code::corrupt,
                     "channel 'label' holds " + std::to_string(block[0][i]) + "; at most 5"};
      }
      if (block[1][i] > kMaxBit || block[2][i] > kMaxBit) {
        return Error{Code::corrupt, "channels 'bit_u', 'bit_v' hold " +
                                        std::to_string(std::max(block[1][i], block[2][i])) +
                                        "; at most 14"};
      }
      map.label[begin + i] = static_cast<Label>(block[0][i]);
      map.bit_u[begin + i] = static_cast<std::uint8_t>(block[1][i]);
      map.bit_v[begin + i] = static_cast<std::uint8_t>(block[2][i]);
    }
  }
  return {};
}

/// A position is a finite number with a positive standard deviation, everything else NaN.
Status check_values(const LightMap& map) {
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    const bool is_position = map.is_position(i);
    for (const FloatChannel& channel : kFloats) {
      const float value = (map.*channel.list)[i];
      const bool is_contrast = channel.list == &LightMap::contrast;
      const bool is_sigma =
          channel.list == &LightMap::sigma_u_px || channel.list == &LightMap::sigma_v_px;
      const bool good = is_contrast   ? std::isfinite(value)
                        : is_position ? std::isfinite(value) && (!is_sigma || value > 0)
                                      : std::isnan(value);
      if (!good) {
        return Error{Code::corrupt, "channel '" + std::string(channel.name) + "' holds " +
                                        std::to_string(value) + " at pixel " + std::to_string(i) +
                                        " of label " +
                                        std::to_string(static_cast<int>(map.label[i]))};
      }
    }
  }
  return {};
}

}  // namespace

std::string light_map_name(const StackKey& key) {
  std::array<char, 16> stop{};
  std::snprintf(stop.data(), stop.size(), "%03d", key.stop);
  return std::string(stop.data()) + "_" + key.display + "_" + key.camera + ".exr";
}

Status write_light_map(const LightMap& map, const std::filesystem::path& file) {
  const Region& region = map.region;
  bool fits = region.x >= 0 && region.y >= 0 && region.width >= 1 && region.height >= 1 &&
              region.x + region.width <= kMaxSide_px + 1 &&
              region.y + region.height <= kMaxSide_px + 1 && map.key.stop >= 0;
  for (const FloatChannel& channel : kFloats) {
    fits = fits && (map.*channel.list).size() == map.size_px();
  }
  if (!fits || map.label.size() != map.size_px() || map.bit_u.size() != map.size_px() ||
      map.bit_v.size() != map.size_px()) {
    return Error{Code::invalid,
                 "the light map's lists are not of its region's size, or the region is empty"};
  }
  ALHAZEN_TRY(check_values(map));
  const std::filesystem::path partial = aside(file);
  std::ofstream stream(partial, std::ios::binary | std::ios::trunc);
  if (!stream) return Error{Code::unavailable, "cannot create '" + partial.string() + "'"};
  Status written = caught(Code::exhausted, "writing '" + partial.string() + "'", [&]() -> Status {
    Imf::StdOFStream out(stream, partial.c_str());
    write_exr(map, out);
    return {};
  });
  stream.close();
  if (written && !stream) {
    written = Error{Code::exhausted, "cannot write '" + partial.string() + "' to its end"};
  }
  if (!written) {
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
    return written;
  }
  return make_stand(file);
}

Result<LightMap> parse_light_map(std::string_view bytes) {
  ALHAZEN_TRY(check_header(bytes));
  return caught(Code::corrupt, "light map", [&]() -> Result<LightMap> {
    // A limit of the whole library: set once, for nobody else here reads OpenEXR.
    static const bool limited = [] {
      Imf::Header::setMaxImageSize(kMaxSide_px + 1, kMaxSide_px + 1);
      return true;
    }();
    static_cast<void>(limited);
    MemoryStream stream(bytes);
    Imf::InputFile file(stream);
    LightMap map = ALHAZEN_TRY(read_header(file.header(), bytes.size()));
    const std::string wanted =
        ALHAZEN_TRY(attribute<Imf::StringAttribute>(file.header(), "xxh3_64"));
    ALHAZEN_TRY(read_pixels(file, map));
    ALHAZEN_TRY(check_values(map));
    if (checksum(map) != wanted) {
      return Error{Code::corrupt, "attribute 'xxh3_64' does not agree with the content"};
    }
    return map;
  });
}

Result<LightMap> read_light_map(const std::filesystem::path& file) {
  const std::string bytes = ALHAZEN_TRY(read_file(file, kMaxFileBytes));
  return parse_light_map(bytes).in("light map '" + file.string() + "'");
}

}  // namespace alhazen
