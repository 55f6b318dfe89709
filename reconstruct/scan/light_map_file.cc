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
#include "reconstruct/scan/limits.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

static_assert(std::endian::native == std::endian::little, "read_bytes() below assumes it");

constexpr std::uint64_t kMaxLightMapBytes = std::uint64_t{1} << 32;
// Bytes of a pixel in the file: two FLOAT and six HALF channels.
constexpr std::uint64_t kPixelBytes = 20;
// Two bytes say at most a run of 128.
constexpr std::uint64_t kMostExpansion = 64;
// Rows converted at once: lists of bytes are HALF in the file, which has whole numbers to 2048.
constexpr int kBlockRows = 64;

template <class Value>
struct Channel {
  const char* name;
  PixelList<Value> LightMap::*list;
};
constexpr std::array<Channel<float>, 2> kFloats = {
    {{"u", &LightMap::u_px}, {"v", &LightMap::v_px}}};
constexpr std::array<Channel<Imath::half>, 2> kHalves = {
    {{"sigma_u_px", &LightMap::sigma_u_px}, {"sigma_v_px", &LightMap::sigma_v_px}}};

struct ByteChannel {
  const char* name;
  int most;
};
// A bit is one beyond the finest of the largest display where none was resolved.
constexpr std::array<ByteChannel, 4> kBytes = {{{"contrast", 255},
                                                {"label", static_cast<int>(Label::second_bounce)},
                                                {"bit_u", 14},
                                                {"bit_v", 14}}};
/// The lists of kBytes.
template <class Map>
auto byte_lists(Map& map) {
  using Byte = std::conditional_t<std::is_const_v<Map>, const std::uint8_t, std::uint8_t>;
  return std::array<Byte*, kBytes.size()>{map.contrast.data(),
                                          reinterpret_cast<Byte*>(map.label.data()),
                                          map.bit_u.data(), map.bit_v.data()};
}
/// `rows` of each of them, as they are in the file.
using HalfRows = std::array<std::vector<Imath::half>, kBytes.size()>;

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
  const auto add_lists = [&](const auto& channels) {
    for (const auto& channel : channels) {
      const auto& list = map.*channel.list;
      add(list.data(), list.size() * sizeof list[0]);
    }
  };
  add_lists(kFloats);
  add_lists(kHalves);
  for (const std::uint8_t* list : byte_lists(map)) add(list, map.size_px());
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

/// Where every channel's pixels are, those of `rows` from `first_row` on.
template <class Map>
Imf::FrameBuffer frame_buffer(Map& map, const HalfRows& rows, int first_row) {
  Imf::FrameBuffer buffer;
  for (const auto& channel : kFloats) {
    buffer.insert(channel.name, slice(Imf::FLOAT, (map.*channel.list).data(), map.region, 0));
  }
  for (const auto& channel : kHalves) {
    buffer.insert(channel.name, slice(Imf::HALF, (map.*channel.list).data(), map.region, 0));
  }
  for (std::size_t k = 0; k < kBytes.size(); ++k) {
    buffer.insert(kBytes[k].name, slice(Imf::HALF, rows[k].data(), map.region, first_row));
  }
  return buffer;
}

void write_exr(const LightMap& map, Imf::OStream& out) {
  Imf::Header header(window_of(map.region), window_of(map.region));
  header.compression() = Imf::RLE_COMPRESSION;
  const auto insert = [&](const auto& channels, Imf::PixelType type) {
    for (const auto& channel : channels) {
      header.channels().insert(channel.name, Imf::Channel(type));
    }
  };
  insert(kFloats, Imf::FLOAT);
  insert(kHalves, Imf::HALF);
  insert(kBytes, Imf::HALF);
  header.insert("stop", Imf::IntAttribute(map.key.stop));
  header.insert("display", Imf::StringAttribute(map.key.display));
  header.insert("camera", Imf::StringAttribute(map.key.camera));
  header.insert("angle_rad", Imf::DoubleAttribute(map.angle_rad));
  header.insert("xxh3_64", Imf::StringAttribute(checksum(map)));
  Imf::OutputFile file(out, header);
  const auto width = static_cast<std::size_t>(map.region.width);
  HalfRows block;
  for (auto& list : block) list.resize(width * kBlockRows);
  for (int row = 0; row < map.region.height; row += kBlockRows) {
    const int rows = std::min(kBlockRows, map.region.height - row);
    for (std::size_t k = 0; k < kBytes.size(); ++k) {
      const std::uint8_t* from = byte_lists(map)[k] + static_cast<std::size_t>(row) * width;
      std::transform(from, from + static_cast<std::size_t>(rows) * width, block[k].begin(),
                     [](std::uint8_t value) { return Imath::half(static_cast<float>(value)); });
    }
    file.setFrameBuffer(frame_buffer(map, block, row));
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
                                    (type == Imf::FLOAT ? "FLOAT" : "HALF")};
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
      window.max.x > limits::kSide_px || window.max.y > limits::kSide_px) {
    return Error{Code::corrupt, "attribute 'dataWindow' reaches outside [0, 65535] px"};
  }
  if (header.compression() != Imf::RLE_COMPRESSION) {
    return Error{Code::corrupt, "attribute 'compression' is not 'run length'"};
  }
  if (static_cast<std::uint64_t>(width) * static_cast<std::uint64_t>(height) * kPixelBytes >
      kMostExpansion * file_bytes) {
    return Error{Code::corrupt, "the file is shorter than its data window"};
  }
  std::size_t channels = 0;
  for (auto i = header.channels().begin(); i != header.channels().end(); ++i) ++channels;
  if (channels != kFloats.size() + kHalves.size() + kBytes.size()) {
    return Error{Code::corrupt,
                 "the file has " + std::to_string(channels) + " channels; it must have 8"};
  }
  for (const auto& channel : kFloats) {
    ALHAZEN_TRY(check_channel(header, channel.name, Imf::FLOAT));
  }
  for (const auto& channel : kHalves) {
    ALHAZEN_TRY(check_channel(header, channel.name, Imf::HALF));
  }
  for (const ByteChannel& channel : kBytes) {
    ALHAZEN_TRY(check_channel(header, channel.name, Imf::HALF));
  }
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
  map.resize_lists();
  return map;
}

Status read_pixels(Imf::InputFile& file, LightMap& map) {
  const auto width = static_cast<std::size_t>(map.region.width);
  HalfRows block;
  for (auto& list : block) list.resize(width * kBlockRows);
  for (int row = 0; row < map.region.height; row += kBlockRows) {
    const int rows = std::min(kBlockRows, map.region.height - row);
    file.setFrameBuffer(frame_buffer(map, block, row));
    file.readPixels(map.region.y + row, map.region.y + row + rows - 1);
    for (std::size_t k = 0; k < kBytes.size(); ++k) {
      std::uint8_t* to = byte_lists(map)[k] + static_cast<std::size_t>(row) * width;
      for (std::size_t i = 0; i < static_cast<std::size_t>(rows) * width; ++i) {
        const float value = block[k][i];
        if (!(value >= 0 && value <= static_cast<float>(kBytes[k].most)) ||
            value != std::floor(value)) {
          return Error{Code::corrupt, "channel '" + std::string(kBytes[k].name) + "' holds " +
                                          std::to_string(value) + "; whole numbers in [0, " +
                                          std::to_string(kBytes[k].most) + "]"};
        }
        to[i] = static_cast<std::uint8_t>(value);
      }
    }
  }
  return {};
}

/// A position is a finite number with a positive standard deviation, everything else NaN.
Status check_values(const LightMap& map) {
  const auto check = [&](const auto& channel, bool is_sigma) -> Status {
    for (std::size_t i = 0; i < map.size_px(); ++i) {
      const float value = (map.*channel.list)[i];
      const bool good =
          map.is_position(i) ? std::isfinite(value) && (!is_sigma || value > 0) : std::isnan(value);
      if (!good) {
        return Error{Code::corrupt, "channel '" + std::string(channel.name) + "' holds " +
                                        std::to_string(value) + " at pixel " + std::to_string(i) +
                                        " of label " +
                                        std::to_string(static_cast<int>(map.label[i]))};
      }
    }
    return {};
  };
  for (const auto& channel : kFloats) ALHAZEN_TRY(check(channel, false));
  for (const auto& channel : kHalves) ALHAZEN_TRY(check(channel, true));
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
  const bool fits = region.x >= 0 && region.y >= 0 && region.width >= 1 && region.height >= 1 &&
                    region.x + region.width <= limits::kSide_px + 1 &&
                    region.y + region.height <= limits::kSide_px + 1 && map.key.stop >= 0 &&
                    map.has_whole_lists();
  if (!fits) {
    return Error{Code::invalid,
                 "the light map's lists are not of its region's size, or the region is empty"};
  }
  ALHAZEN_TRY(check_values(map));
  return write_file_safely(file, [&](std::ofstream& stream) {
    Imf::StdOFStream out(stream, file.c_str());
    write_exr(map, out);
  });
}

Result<LightMap> parse_light_map(std::string_view bytes) {
  ALHAZEN_TRY(check_header(bytes));
  return caught(Code::corrupt, "light map", [&]() -> Result<LightMap> {
    // A limit of the whole library: set once, for nobody else here reads OpenEXR.
    static const bool limited = [] {
      Imf::Header::setMaxImageSize(limits::kSide_px + 1, limits::kSide_px + 1);
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
  const std::string bytes = ALHAZEN_TRY(read_file(file, kMaxLightMapBytes));
  return parse_light_map(bytes).in("light map '" + file.string() + "'");
}

}  // namespace alhazen
