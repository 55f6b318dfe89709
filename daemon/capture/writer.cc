#include "daemon/capture/writer.h"

#include <tbb/parallel_for.h>

#include <cstdio>
#include <optional>
#include <utility>

namespace alhazen {
namespace {

/// KeepFrames::sample keeps one step in so many.
constexpr std::uint64_t kSampleStride = 16;

std::string hex(std::uint64_t value) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(value));
  return text;
}

bool is_kept(KeepFrames keep, const Step& step, const Shot& shot) {
  switch (keep) {
    case KeepFrames::none:
      return false;
    case KeepFrames::failed:
      return shot.attempt > 1;
    case KeepFrames::sample:
      return step.index % kSampleStride == 0;
    case KeepFrames::all:
      break;
  }
  return true;
}

}  // namespace

/// One display at one stop: what every camera has seen of it so far.
struct Writer::Stack {
  struct Lane {
    int camera = 0;  // index into the plan's cameras
    std::optional<Decoder> decoder;
    std::vector<FrameRecord> records;
  };
  StackStart start;
  std::vector<Lane> lanes;

  [[nodiscard]] Lane* lane(int camera) {
    for (Lane& lane : lanes)
      if (lane.camera == camera) return &lane;
    return nullptr;
  }
};

Writer::Writer(Scan& scan, const CaptureOptions& options, Hold& hold, const CaptureHooks& hooks,
               std::stop_token stop, std::stop_source failed)
    : scan_(scan),
      options_(options),
      hold_(hold),
      hooks_(hooks),
      stop_(std::move(stop)),
      failed_(std::move(failed)),
      queue_(static_cast<std::size_t>(options.queue_sets)),
      thread_([this] { run(); }) {}

Writer::~Writer() {
  queue_.close();
  if (thread_.joinable()) thread_.join();
}

bool Writer::push(WriterItem item, std::stop_token stop) {
  return queue_.push(std::move(item), std::move(stop));
}

Status Writer::finish() {
  queue_.close();
  if (thread_.joinable()) thread_.join();
  return outcome_;
}

void Writer::run() {
  // No stop token: after a stop, what has been handed over is still made safe where it is complete.
  while (auto item = queue_.pop({})) {
    outcome_ = std::visit([this](auto& part) { return handle(std::move(part)); }, *item);
    if (outcome_) continue;
    queue_.close();
    failed_.request_stop();
    while (queue_.pop({})) {
    }
    return;
  }
}

template <class Save>
auto Writer::with_room(Save save) -> decltype(save()) {
  for (;;) {
    auto saved = save();
    if (saved || saved.error().code != Code::exhausted) return saved;
    hold_.hold(HoldAt::step, "disk: " + saved.error().what);
    if (hooks_.on_hold) hooks_.on_hold(true);
    if (!hold_.wait(stop_)) return saved;
    if (hooks_.on_hold) hooks_.on_hold(false);
  }
}

Status Writer::handle(StackStart start) {
  stack_ = std::make_unique<Stack>();
  for (const int camera : start.cameras) stack_->lanes.push_back({camera, std::nullopt, {}});
  stack_->start = std::move(start);
  return {};
}

Status Writer::handle(ShotSet set) {
  const Manifest& plan = scan_.manifest();
  const auto display_index = static_cast<std::size_t>(stack_->start.display);
  const PlannedDisplay& display = plan.displays[display_index];
  const Pattern& pattern = display.patterns[static_cast<std::size_t>(set.step.pattern)];

  std::vector<Status> outcomes(set.shots.size());
  tbb::parallel_for(std::size_t{0}, set.shots.size(), [&](std::size_t i) {
    const Shot& shot = set.shots[i];
    const PlannedCamera& camera = plan.cameras[static_cast<std::size_t>(shot.camera)];
    Stack::Lane* lane = stack_->lane(shot.camera);
    ALHAZEN_CHECK(lane != nullptr);
    const StackKey key{plan.stops[static_cast<std::size_t>(stack_->start.stop)].index, display.name,
                       camera.name};
    const auto fold = [&]() -> Status {
      if (!lane->decoder)
        lane->decoder = ALHAZEN_TRY(Decoder::make(
            options_.decode, key, stack_->start.angle_rad, camera.settings.region,
            shot.frame.image.bits(), display.width_px, display.height_px, display.patterns));
      return lane->decoder->add(pattern, shot.frame.image);
    };
    outcomes[i] = fold().in("decode " + display.name + " / camera " + camera.name);
  });
  for (Status& outcome : outcomes)
    if (!outcome) return std::move(outcome);

  const auto record_of = [&](const Shot& shot) {
    FrameRecord record;
    record.step = set.step.index;
    record.camera = plan.cameras[static_cast<std::size_t>(shot.camera)].name;
    record.display = display.name;
    record.stop = plan.stops[static_cast<std::size_t>(set.step.stop)].index;
    record.pattern = set.step.pattern;
    record.angle_rad = stack_->start.angle_rad;
    record.settings = shot.frame.settings;
    record.exposure_begin_us = shot.frame.exposure_begin.time_since_epoch().count();
    record.device_counter = shot.frame.device_counter;
    record.attempt = shot.attempt;
    record.checksum = hex(shot.checksum);
    return record;
  };
  for (const Shot& shot : set.shots) {
    FrameRecord record = record_of(shot);
    if (is_kept(plan.keep_frames, set.step, shot))
      record.file =
          ALHAZEN_TRY(with_room([&] { return scan_.store_frame(record, shot.frame.image); }));
    stack_->lane(shot.camera)->records.push_back(std::move(record));
  }
  if (plan.keep_frames == KeepFrames::failed || plan.keep_frames == KeepFrames::all)
    for (const Shot& shot : set.refused)
      ALHAZEN_TRY(with_room([&] { return scan_.store_frame(record_of(shot), shot.frame.image); }));
  return {};
}

Status Writer::handle(StackEnd /*end*/) {
  std::vector<Stack::Lane*> complete;
  for (Stack::Lane& lane : stack_->lanes)
    if (lane.decoder && lane.decoder->complete()) complete.push_back(&lane);  // others are gaps
  std::vector<std::optional<Result<LightMap>>> maps(complete.size());
  tbb::parallel_for(std::size_t{0}, complete.size(), [&](std::size_t i) {
    Result<LightMap> map = std::move(*complete[i]->decoder).finish();
    maps[i].emplace(map ? Result<LightMap>(cropped(*map)) : std::move(map));
  });
  for (std::size_t i = 0; i < complete.size(); ++i) {
    const auto map = std::make_shared<const LightMap>(ALHAZEN_TRY(std::move(*maps[i])));
    maps[i].reset();
    ALHAZEN_TRY(with_room([&] { return scan_.commit(*map, complete[i]->records); }));
    ++committed_;
    if (hooks_.on_light_map) hooks_.on_light_map(map);
  }
  stack_.reset();
  return {};
}

}  // namespace alhazen
