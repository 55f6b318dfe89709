#include "reconstruct/normals/normal_map_file.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStdIO.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "alhazen/caught.h"
#include "reconstruct/scan/image_file.h"
#include "reconstruct/scan/limits.h"
#include "reconstruct/scan/safe_file.h"

namespace alhazen {
namespace {

static_assert(std::endian::native == std::endian::little, "check_exr_header() assumes it");

constexpr std::uint64_t kMaxFileBytes = (std::uint64_t{1} << 31) - 1;  // OpenCV counts in int
/// Lengths that a rounded unit vector can have; 8 bits round by 0.4 %, photometric stereo stores
/// nothing else.
constexpr float kShortest = 0.8F, kLongest = 1.25F;
constexpr float kNoVector = 0.5F;
/// A rounding to steps of d is a uniform error of d/√12.
constexpr double kUniform = 0.28867513459481287;
/// A picture in which most of the normals face away is read in wrong axes; some do at the outline.
constexpr double kMostTurned = 0.5;
/// Normals at the outline point out of it: their mean component outward is about 1 for a smooth
/// object, 0 for a flat one, and below this only if the axis is mirrored.
constexpr double kMirrored = -0.25;
constexpr std::size_t kLeastOutline_px = 40;

/// A file's pixels before they are understood.
struct Raw {
  Region region;
  std::vector<Eigen::Vector3f> vector;
  std::vector<std::uint8_t> alpha;  ///< 1: object; empty: the file has none
  double rounding = 0;              ///< standard deviation of a component by the file's steps
};

/// The bytes of a file in memory, as OpenEXR wants to read them.
class ExrBytes : public Imf::IStream {
 public:
  explicit ExrBytes(std::string_view bytes) : IStream("normal map"), bytes_(bytes) {}
  bool read(char buffer[], int count) override {
    if (count < 0 || at_ > bytes_.size() ||
        static_cast<std::uint64_t>(count) > bytes_.size() - at_) {
      throw std::out_of_range("the file ends early");  // the way IStream reports it
    }
    std::memcpy(buffer, bytes_.data() + at_, static_cast<std::size_t>(count));
    at_ += static_cast<std::uint64_t>(count);
    return at_ < bytes_.size();
  }
  std::uint64_t tellg() override { return at_; }
  void seekg(std::uint64_t at) override { at_ = at; }
  void clear() override {}

 private:
  std::string_view bytes_;
  std::uint64_t at_ = 0;
};

/// OpenEXR allocates what a header claims before it finds the file too short. So look first: one
/// part of scan lines, and every attribute inside the file.
/// Source: "OpenEXR File Layout", openexr.com.
Status check_exr_header(std::string_view bytes) {
  constexpr std::size_t kLongestName = 255;
  constexpr int kMostAttributes = 1000;
  constexpr std::uint8_t kVersion = 2, kLongNames = 4;
  const bool is_plain = bytes.size() > 8 && bytes[4] == kVersion &&
                        (static_cast<std::uint8_t>(bytes[5]) & ~kLongNames) == 0 && bytes[6] == 0 &&
                        bytes[7] == 0;
  if (!is_plain) {
    return Error{Code::unsupported, "not an OpenEXR 2 file of one part of scan lines"};
  }
  bytes.remove_prefix(8);
  for (int i = 0; i <= kMostAttributes; ++i) {
    if (bytes.starts_with('\0')) return {};
    for (int name = 0; name < 2; ++name) {  // of the attribute, of its type
      const std::size_t end = bytes.substr(0, kLongestName + 1).find('\0');
      if (end == std::string_view::npos) {
        return Error{Code::corrupt, "the header ends early or holds a name over 255 bytes"};
      }
      bytes.remove_prefix(end + 1);
    }
    std::uint32_t length = 0;
    if (bytes.size() >= sizeof length) std::memcpy(&length, bytes.data(), sizeof length);
    if (bytes.size() < sizeof length || length > bytes.size() - sizeof length) {
      return Error{Code::corrupt, "the header ends early"};
    }
    bytes.remove_prefix(sizeof length + length);
  }
  return Error{Code::corrupt, "the header has more than 1000 attributes"};
}

Result<Raw> read_exr(const std::string& bytes) {
  ALHAZEN_TRY(check_exr_header(bytes));
  ExrBytes stream(bytes);
  Imf::InputFile file(stream);
  const Imf::Header& header = file.header();
  const Imath::Box2i& window = header.dataWindow();
  const std::int64_t width = std::int64_t{window.max.x} - window.min.x + 1;
  const std::int64_t height = std::int64_t{window.max.y} - window.min.y + 1;
  if (window.min.x < 0 || window.min.y < 0 || width < 1 || height < 1 ||
      window.max.x > limits::kSide_px || window.max.y > limits::kSide_px) {
    return Error{Code::corrupt, "attribute 'dataWindow' reaches outside [0, 65535] px"};
  }
  switch (header.compression()) {
    case Imf::NO_COMPRESSION:
    case Imf::RLE_COMPRESSION:
    case Imf::ZIPS_COMPRESSION:
    case Imf::ZIP_COMPRESSION:
    case Imf::PIZ_COMPRESSION:
      break;
    default:
      return Error{Code::unsupported, "compression other than RLE, ZIP and PIZ loses precision"};
  }
  // OpenEXR's best packs zeros 1:1000; what claims more is no normal map.
  constexpr std::int64_t kMostPacked = 2000;
  if (width * height * 6 > kMostPacked * static_cast<std::int64_t>(bytes.size())) {
    return Error{Code::corrupt, "the file is far too short for its data window of " +
                                    std::to_string(width) + " x " + std::to_string(height) + " px"};
  }
  const Imf::ChannelList& channels = header.channels();
  constexpr std::array<std::array<const char*, 3>, 2> kNames{{{"R", "G", "B"}, {"X", "Y", "Z"}}};
  const auto found = std::find_if(kNames.begin(), kNames.end(), [&](const auto& names) {
    return std::all_of(names.begin(), names.end(), [&](const char* name) {
      const Imf::Channel* channel = channels.findChannel(name);
      return channel != nullptr && channel->type != Imf::UINT && channel->xSampling == 1 &&
             channel->ySampling == 1;
    });
  });
  if (found == kNames.end()) {
    return Error{Code::unsupported, "no channels R G B or X Y Z of numbers"};
  }
  Raw raw;
  raw.region = {window.min.x, window.min.y, static_cast<int>(width), static_cast<int>(height)};
  const auto size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  raw.vector.resize(size);
  std::vector<float> alpha;
  Imf::FrameBuffer buffer;
  const auto slice = [&](float* first, std::size_t stride) {
    return Imf::Slice::Make(Imf::FLOAT, first, Imath::V2i(window.min.x, window.min.y), width,
                            height, stride, stride * static_cast<std::size_t>(width));
  };
  for (std::size_t k = 0; k < 3; ++k) {
    buffer.insert((*found)[k], slice(raw.vector[0].data() + k, sizeof raw.vector[0]));
  }
  if (channels.findChannel("A") != nullptr) {
    alpha.resize(size);
    buffer.insert("A", slice(alpha.data(), sizeof(float)));
  }
  file.setFrameBuffer(buffer);
  file.readPixels(window.min.y, window.max.y);
  for (const float a : alpha) raw.alpha.push_back(a >= 0.5F ? 1 : 0);
  const bool is_half = channels.findChannel((*found)[0])->type == Imf::HALF;
  // Half precision has 11 bits below 1.
  raw.rounding = is_half ? kUniform / 2048 : 0;
  return raw;
}

Result<Raw> read_png(std::string& bytes) {
  const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8UC1, bytes.data());
  const cv::Mat picture = cv::imdecode(encoded, cv::IMREAD_UNCHANGED);
  if (picture.empty()) return Error{Code::corrupt, "no picture, or damaged"};
  const bool is_8 = picture.depth() == CV_8U;
  if ((!is_8 && picture.depth() != CV_16U) ||
      (picture.channels() != 3 && picture.channels() != 4)) {
    return Error{Code::unsupported, std::to_string(picture.channels()) +
                                        " channels; a normal map has red, green and blue of 8 or "
                                        "16 bits, and alpha at most"};
  }
  if (picture.cols > limits::kSide_px || picture.rows > limits::kSide_px) {
    return Error{Code::invalid, "larger than 65535 px a side"};
  }
  Raw raw;
  raw.region = {0, 0, picture.cols, picture.rows};
  const float full = is_8 ? 255.0F : 65535.0F;
  raw.rounding = kUniform * 2 / static_cast<double>(full);
  const auto channels = static_cast<std::size_t>(picture.channels());
  for (int y = 0; y < picture.rows; ++y) {
    const auto value = [&](std::size_t at) {
      return static_cast<float>(is_8 ? picture.ptr<std::uint8_t>(y)[at]
                                     : picture.ptr<std::uint16_t>(y)[at]);
    };
    for (std::size_t x = 0; x < static_cast<std::size_t>(picture.cols); ++x) {
      const std::size_t at = x * channels;
      // OpenCV keeps blue first. Black is no vector, though it decodes to one.
      const Eigen::Vector3f rgb(value(at + 2), value(at + 1), value(at));
      raw.vector.emplace_back(rgb.isZero()
                                  ? Eigen::Vector3f(Eigen::Vector3f::Zero())
                                  : Eigen::Vector3f(rgb * (2 / full) - Eigen::Vector3f::Ones()));
      if (channels == 4) raw.alpha.push_back(value(at + 3) >= full / 2 ? 1 : 0);
    }
  }
  return raw;
}

Result<Raw> read_raw(std::string& bytes) {
  constexpr std::string_view kExr("\x76\x2f\x31\x01", 4), kPng("\x89PNG", 4);
  return caught(Code::corrupt, "reading it", [&]() -> Result<Raw> {
    if (bytes.starts_with(kExr)) return read_exr(bytes);
    if (bytes.starts_with(kPng)) return read_png(bytes);
    return Error{Code::unsupported, "neither PNG nor OpenEXR"};
  });
}

/// The mask is of the sensor's size, or of the map's own.
Status apply_mask(const std::filesystem::path& file, const CameraModel& camera, Raw& raw) {
  const Image mask = ALHAZEN_TRY(read_image(file));
  const Region& region = raw.region;
  const bool is_whole = mask.width() == camera.width_px && mask.height() == camera.height_px;
  if (!is_whole && (mask.width() != region.width || mask.height() != region.height)) {
    return Error{Code::invalid, "mask '" + file.string() + "' has " + std::to_string(mask.width()) +
                                    " x " + std::to_string(mask.height()) +
                                    " px; its normal map has " + std::to_string(region.width) +
                                    " x " + std::to_string(region.height) + " px"};
  }
  const int left = is_whole ? region.x : 0, top = is_whole ? region.y : 0;
  raw.alpha.resize(raw.vector.size());
  for (int y = 0; y < region.height; ++y) {
    for (int x = 0; x < region.width; ++x) {
      const auto from = static_cast<std::size_t>(top + y) * static_cast<std::size_t>(mask.width()) +
                        static_cast<std::size_t>(left + x);
      const auto to = static_cast<std::size_t>(y) * static_cast<std::size_t>(region.width) +
                      static_cast<std::size_t>(x);
      raw.alpha[to] = mask.format() == PixelFormat::mono8 ? (mask.mono8()[from] >= 128 ? 1 : 0)
                                                          : (mask.mono16()[from] >= 32768 ? 1 : 0);
    }
  }
  return {};
}

std::string region_text(const Region& region) {
  return std::to_string(region.width) + " x " + std::to_string(region.height) + " px at (" +
         std::to_string(region.x) + ", " + std::to_string(region.y) + ")";
}

}  // namespace

Result<NormalMap> parse_normal_map(std::string bytes, const NormalMapFormat& format,
                                   const CameraModel& camera, NormalMapKey key, double angle_rad) {
  if (!(format.noise_rad >= 0 && format.noise_rad <= 1)) {
    return Error{Code::invalid,
                 "a noise of " + std::to_string(format.noise_rad) + " rad; it must be in [0, 1]"};
  }
  Raw raw = ALHAZEN_TRY(read_raw(bytes));
  const Region& region = raw.region;
  if (region.width > camera.width_px - region.x || region.height > camera.height_px - region.y) {
    return Error{Code::invalid, region_text(region) + " is not within the sensor of camera '" +
                                    camera.name + "', " + std::to_string(camera.width_px) + " x " +
                                    std::to_string(camera.height_px) + " px"};
  }
  if (!format.mask.empty()) ALHAZEN_TRY(apply_mask(format.mask, camera, raw));

  NormalMap map;
  map.key = std::move(key);
  map.angle_rad = angle_rad;
  map.region = region;
  map.noise_rad = std::hypot(format.noise_rad, raw.rounding);
  map.normal.assign(raw.vector.size(), Eigen::Vector3f::Zero());
  map.label.assign(raw.vector.size(), NormalLabel::background);
  Eigen::Matrix3f turn = Eigen::Matrix3f::Identity();
  if (format.axes == NormalAxes::opengl) turn.diagonal() << 1, -1, -1;
  if (format.axes == NormalAxes::rig) turn = camera.camera_from_rig.rotation.cast<float>();
  std::size_t objects = 0;
  for (std::size_t i = 0; i < raw.vector.size(); ++i) {
    const Eigen::Vector3f& n = raw.vector[i];
    if (!raw.alpha.empty() && raw.alpha[i] == 0) continue;
    if (!n.allFinite()) {
      return Error{Code::corrupt,
                   "pixel " + std::to_string(i) + " holds a number that is not finite"};
    }
    const float length = n.norm();
    if (raw.alpha.empty() && length < kNoVector) continue;
    if (length < kShortest || length > kLongest) {
      map.label[i] = NormalLabel::unknown;
      continue;
    }
    map.label[i] = NormalLabel::object;
    map.normal[i] = turn * (n / length);
    ++objects;
  }
  if (objects == 0) {
    return Error{Code::invalid, "no pixel holds a unit vector where the object is"};
  }
  ALHAZEN_TRY(check_facing(map, camera));
  return map;
}

namespace {

Result<std::vector<unsigned char>> to_png(const NormalMap& map) {
  cv::Mat picture(map.region.height, map.region.width, CV_16UC4);
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    const int y = static_cast<int>(i) / map.region.width;
    auto* const pixel =
        picture.ptr<std::uint16_t>(y) + 4 * (static_cast<int>(i) % map.region.width);
    for (int k = 0; k < 3; ++k) {
      const float n = map.label[i] == NormalLabel::object ? map.normal[i][2 - k] : 0;
      pixel[k] = static_cast<std::uint16_t>(std::lround((n + 1) / 2 * 65535));
    }
    pixel[3] = map.label[i] == NormalLabel::background ? 0 : 65535;
  }
  std::vector<unsigned char> png;
  cv::imencode(".png", picture, png);
  return png;
}

void write_exr(const NormalMap& map, Imf::OStream& out) {
  const Imath::Box2i window({map.region.x, map.region.y}, {map.region.x + map.region.width - 1,
                                                           map.region.y + map.region.height - 1});
  Imf::Header header(window, window);
  header.compression() = Imf::ZIP_COMPRESSION;
  std::vector<float> alpha;
  for (const NormalLabel label : map.label) {
    alpha.push_back(label == NormalLabel::background ? 0.0F : 1.0F);
  }
  Imf::FrameBuffer buffer;
  const auto insert = [&](const char* name, const float* first, std::size_t stride) {
    header.channels().insert(name, Imf::Channel(Imf::FLOAT));
    buffer.insert(
        name, Imf::Slice::Make(Imf::FLOAT, first, window.min, map.region.width, map.region.height,
                               stride, stride * static_cast<std::size_t>(map.region.width)));
  };
  insert("R", map.normal[0].data(), sizeof map.normal[0]);
  insert("G", map.normal[0].data() + 1, sizeof map.normal[0]);
  insert("B", map.normal[0].data() + 2, sizeof map.normal[0]);
  insert("A", alpha.data(), sizeof(float));
  Imf::OutputFile file(out, header);
  file.setFrameBuffer(buffer);
  file.writePixels(map.region.height);
}

}  // namespace

Status check_facing(const NormalMap& map, const CameraModel& camera) {
  std::size_t objects = 0, turned = 0;
  std::array<double, 2> outward{};  // Σ of the component out of the outline, along x and y
  std::array<std::size_t, 2> outline{};
  const int width = map.region.width, height = map.region.height;
  const auto at = [&](int x, int y) {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::size_t i = at(x, y);
      if (map.label[i] != NormalLabel::object) continue;
      ++objects;
      const Eigen::Vector3d sight =
          camera.direction(Eigen::Vector2d(map.region.x + x, map.region.y + y));
      if (map.normal[i].cast<double>().dot(sight) > 0) ++turned;
      const auto look = [&](int dx, int dy) {
        if (x + dx < 0 || y + dy < 0 || x + dx >= width || y + dy >= height ||
            map.label[at(x + dx, y + dy)] != NormalLabel::background) {
          return;
        }
        const std::size_t axis = dx != 0 ? 0 : 1;
        outward[axis] +=
            static_cast<double>(map.normal[i][static_cast<Eigen::Index>(axis)]) * (dx + dy);
        ++outline[axis];
      };
      look(-1, 0);
      look(1, 0);
      look(0, -1);
      look(0, 1);
    }
  }
  std::string wrong;
  if (static_cast<double>(turned) > kMostTurned * static_cast<double>(objects)) {
    wrong = std::to_string(100 * turned / objects) +
            " % of the normals face away from the camera: "
            "z is turned";
  }
  for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
    if (outline[axis] < kLeastOutline_px ||
        outward[axis] > kMirrored * static_cast<double>(outline[axis])) {
      continue;
    }
    wrong += std::string(wrong.empty() ? "" : "; ") +
             "along the outline the normals point inward: " + (axis == 0 ? "x" : "y") +
             " is mirrored";
  }
  if (wrong.empty()) return {};
  return Error{Code::invalid, wrong +
                                  "; axes must be camera (x right, y down, z forward), opengl "
                                  "(x right, y up, z to the viewer) or rig, as the file is "
                                  "meant"};
}

Result<NormalMap> read_normal_map(const std::filesystem::path& file, const NormalMapFormat& format,
                                  const CameraModel& camera, NormalMapKey key, double angle_rad) {
  const std::string name = "normal map '" + file.string() + "'";
  std::string bytes = ALHAZEN_TRY(read_file(file, kMaxFileBytes).in(name));
  return parse_normal_map(std::move(bytes), format, camera, std::move(key), angle_rad).in(name);
}

Status write_normal_map(const NormalMap& map, const std::filesystem::path& file) {
  const std::string extension = file.extension().string();
  if (extension != ".exr" && extension != ".png") {
    return Error{Code::unsupported, "'" + file.string() + "': a normal map is .exr or .png"};
  }
  if (map.size_px() == 0 || map.normal.size() != map.size_px() ||
      map.label.size() != map.size_px() || map.region.x < 0 || map.region.y < 0 ||
      map.region.x + map.region.width > limits::kSide_px + 1 ||
      map.region.y + map.region.height > limits::kSide_px + 1) {
    return Error{Code::invalid,
                 "the normal map's lists are not of its region's size, or the region is empty"};
  }
  if (extension == ".png") {
    if (map.region.x != 0 || map.region.y != 0) {
      return Error{Code::invalid, "a PNG holds no offset; write .exr"};
    }
    const auto png = ALHAZEN_TRY(
        caught(Code::internal, "encoding '" + file.string() + "'", [&] { return to_png(map); }));
    return write_file_safely(file, {reinterpret_cast<const char*>(png.data()), png.size()});
  }
  return write_file_safely(file, [&](std::ofstream& stream) {
    Imf::StdOFStream out(stream, file.c_str());
    write_exr(map, out);
  });
}

}  // namespace alhazen
