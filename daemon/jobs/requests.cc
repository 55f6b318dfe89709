#include "daemon/jobs/requests.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "alhazen/caught.h"

namespace alhazen {
namespace {

using nlohmann::json;

const json& table(const json& args, const char* key) {
  static const json kNone = json::object();
  const auto found = args.find(key);
  return found == args.end() ? kNone : *found;
}

template <class T>
std::optional<T> chosen(const json& args, const char* key) {
  const auto found = args.find(key);
  if (found == args.end()) return std::nullopt;
  return found->get<T>();
}

std::optional<Micros> exposure(const json& args) {
  const auto us = chosen<std::int64_t>(args, "exposure_us");
  if (!us) return std::nullopt;
  return Micros(*us);
}

KeepFrames keep_frames(const std::string& name) {
  if (name == "failed") return KeepFrames::failed;
  if (name == "sample") return KeepFrames::sample;
  return name == "all" ? KeepFrames::all : KeepFrames::none;
}

}  // namespace

Result<ScanRequest> scan_request(const json& args) {
  return caught(Code::invalid, "scan request", [&] {
    ScanRequest request;
    const json& object = table(args, "object");
    // An estimate needs no object.
    request.object_id = object.value("id", "unnamed");
    request.note = object.value("note", "");
    request.operator_name = object.value("operator", "");
    const json& plan = table(args, "plan");
    request.preset = plan.value("preset", "");
    PlanChoices& choices = request.choices;
    choices.stops = chosen<int>(plan, "stops");
    choices.angles_deg = chosen<std::vector<double>>(plan, "angles_deg");
    choices.displays = chosen<std::vector<std::string>>(plan, "displays");
    choices.cameras = chosen<std::vector<std::string>>(plan, "cameras");
    if (const auto coding = chosen<std::string>(plan, "coding"))
      choices.coding = *coding == "gray" ? Coding::gray : Coding::gray_phase;
    choices.exposure = exposure(plan);
    choices.gain_db = chosen<double>(plan, "gain_db");
    choices.crop = chosen<bool>(plan, "crop");
    const json& volume = table(args, "volume");
    choices.edge_mm = chosen<double>(volume, "edge_mm");
    if (const auto centre = chosen<std::vector<double>>(volume, "centre_mm"))
      choices.centre_mm = Eigen::Vector3d(centre->at(0), centre->at(1), centre->at(2));
    choices.level = chosen<int>(args, "level");
    if (const auto keep = chosen<std::string>(args, "keep_frames"))
      choices.keep_frames = keep_frames(*keep);
    request.on_error = args.value("on_error", "stop") == "next" ? OnError::next : OnError::stop;
    request.on_gap = args.value("on_gap", "fail") == "accept" ? OnGap::accept : OnGap::fail;
    return request;
  });
}

Result<ReconstructionChoices> reconstruction_choices(const json& args) {
  return caught(Code::invalid, "reconstruction choices", [&]() -> Result<ReconstructionChoices> {
    ReconstructionChoices choices;
    choices.level = chosen<int>(args, "level");
    const json& given = table(args, "reconstruction");
    const auto take = [&](const char* key, double& tunable) {
      tunable = given.value(key, tunable);
    };
    take("bandwidth_rad", choices.options.vote.bandwidth_rad);
    take("bandwidth_ratio", choices.options.vote.bandwidth_ratio);
    take("lambda", choices.options.surface.lambda);
    take("beta", choices.options.surface.beta);
    take("g_min", choices.options.surface.g_min);
    choices.formats = args.value("mesh_formats", std::vector<std::string>());
    if (const Status valid = choices.options.is_valid(); !valid) {
      return valid.error().in("args.reconstruction");
    }
    return choices;
  });
}

Result<PreviewRequest> preview_request(const json& args) {
  return caught(Code::invalid, "preview request", [&] {
    PreviewRequest request;
    request.cameras = args.value("cameras", std::vector<std::string>());
    request.display = chosen<std::string>(args, "display");
    request.exposure = exposure(args);
    request.gain_db = chosen<double>(args, "gain_db");
    return request;
  });
}

}  // namespace alhazen
