#include <array>
#include <charconv>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "reconstruct/decode/decoder.h"
#include "reconstruct/exchange/import.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/pattern/sequence.h"
#include "reconstruct/scan/frame_table.h"
#include "reconstruct/scan/light_map_file.h"
#include "reconstruct/scan/safe_file.h"
#include "tools/reconstruct_commands.h"

namespace alhazen {
namespace {

struct DisplaySize {
  int width_px = 0, height_px = 0;
};

/// "NAME=WxH".
Result<std::pair<std::string, DisplaySize>> parse_display_size(std::string_view text) {
  const std::size_t equals = text.rfind('=');
  const std::size_t cross = text.rfind('x');
  DisplaySize size;
  const auto parse = [](std::string_view digits, int& value) {
    const char* end = digits.data() + digits.size();
    const auto [last, error] = std::from_chars(digits.data(), end, value);
    return error == std::errc() && last == end && value >= kMinDisplaySide_px &&
           value <= kMaxDisplaySide_px;
  };
  if (equals == std::string_view::npos || cross == std::string_view::npos || cross < equals ||
      equals == 0 || !parse(text.substr(equals + 1, cross - equals - 1), size.width_px) ||
      !parse(text.substr(cross + 1), size.height_px)) {
    return Error{Code::invalid, "--display-size '" + std::string(text) +
                                    "' must be NAME=WxH with W and H in [2, 16384]"};
  }
  return std::pair(std::string(text.substr(0, equals)), size);
}

/// As told, else as calibrated, else as many columns and rows as the bits of the stack tell apart.
DisplaySize size_of(const TableStack& stack, const std::map<std::string, DisplaySize>& told,
                    const std::optional<Rig>& rig) {
  const auto found = told.find(stack.key.display);
  if (found != told.end()) return found->second;
  const DisplayModel* display = rig ? rig->display(stack.key.display) : nullptr;
  if (display != nullptr) return {display->width_px, display->height_px};
  DisplaySize size{kMinDisplaySide_px, kMinDisplaySide_px};
  for (const TableFrame& frame : stack.frames) {
    if (frame.pattern.kind != PatternKind::gray) continue;
    int& side_px = frame.pattern.axis == Axis::u ? size.width_px : size.height_px;
    side_px = std::max(side_px, 2 << frame.pattern.bit);
  }
  return size;
}

/// The rig's model of the stack's camera, where there is a rig.
Result<const CameraModel*> camera_of(const std::optional<Rig>& rig, const TableStack& stack) {
  if (!rig) return static_cast<const CameraModel*>(nullptr);
  const CameraModel* camera = rig->camera(stack.key.camera);
  if (camera == nullptr || rig->display(stack.key.display) == nullptr) {
    return Error{Code::invalid, "the rig has no " +
                                    (camera == nullptr ? "camera '" + stack.key.camera
                                                       : "display '" + stack.key.display) +
                                    "'"};
  }
  return camera;
}

void print(const LightMap& map, DisplaySize display, const std::filesystem::path& file) {
  constexpr std::array<const char*, 6> kLabels = {"none",  "mirror",    "direct_sight",
                                                  "mixed", "saturated", "second_bounce"};
  std::array<std::size_t, kLabels.size()> count{};
  std::size_t decoded = 0, finest = 0;
  for (std::size_t i = 0; i < map.size_px(); ++i) {
    ++count[static_cast<std::size_t>(map.label[i])];
    decoded += map.is_position(i) ? 1U : 0U;
    finest += map.is_position(i) && map.bit_u[i] == 0 && map.bit_v[i] == 0 ? 1U : 0U;
  }
  nlohmann::ordered_json labels;
  for (std::size_t i = 0; i < count.size(); ++i) labels[kLabels[i]] = count[i];
  const nlohmann::ordered_json line = {{"stop", map.key.stop},
                                       {"display", map.key.display},
                                       {"camera", map.key.camera},
                                       {"file", file.string()},
                                       {"width", map.region.width},
                                       {"height", map.region.height},
                                       {"display_width", display.width_px},
                                       {"display_height", display.height_px},
                                       {"decoded", decoded},
                                       {"decoded_to_bit_0", finest},
                                       {"labels", std::move(labels)}};
  std::printf("%s\n", line.dump().c_str());
  std::fflush(stdout);
}

}  // namespace

Status decode_frames(const DecodeArgs& args, const Run& run) {
  std::map<std::string, DisplaySize> sizes;
  for (const std::string& text : args.display_sizes) {
    sizes.insert(ALHAZEN_TRY(parse_display_size(text)));
  }
  std::optional<Rig> rig;
  if (!args.rig.empty()) rig = ALHAZEN_TRY(Rig::load(args.rig));
  const std::string text = ALHAZEN_TRY(read_file(args.frames, kMaxTableBytes));
  const std::string table = args.frames.filename().string();
  const std::vector<TableStack> stacks = stacks_of(ALHAZEN_TRY(parse_frame_table(text).in(table)));
  std::error_code error;
  std::filesystem::create_directories(args.out, error);
  if (error) {
    return Error{Code::unavailable,
                 "cannot make folder '" + args.out.string() + "': " + error.message()};
  }
  for (std::size_t i = 0; i < stacks.size(); ++i) {
    const TableStack& stack = stacks[i];
    run.tell("decode", static_cast<double>(i) / static_cast<double>(stacks.size()));
    const std::string where = table + ", stop " + std::to_string(stack.key.stop) + ", display " +
                              stack.key.display + ", camera " + stack.key.camera;
    const DisplaySize display = size_of(stack, sizes, rig);
    const CameraModel* camera = ALHAZEN_TRY(camera_of(rig, stack).in(where));
    const LightMap map =
        ALHAZEN_TRY(decode_stack(stack, {args.frames.parent_path(), args.bits, args.options},
                                 display.width_px, display.height_px, camera, nullptr, run)
                        .in(where));
    const std::filesystem::path file = args.out / light_map_name(stack.key);
    ALHAZEN_TRY(write_light_map(map, file));
    print(map, display, file);
  }
  run.tell("decode", 1);
  return {};
}

}  // namespace alhazen
