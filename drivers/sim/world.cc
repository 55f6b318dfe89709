#include "drivers/sim/world.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "drivers/sim/sensor.h"

namespace alhazen::sim {
namespace {

double seconds(Micros duration) { return static_cast<double>(duration.count()) * 1e-6; }

/// Evenly distributed in [−1, 1), a function of its arguments.
double signed_hash(std::uint64_t seed, double angle_rad) {
  const std::uint64_t bits =
      mixed(mixed(seed, 0x7AB1E), static_cast<std::uint64_t>(std::llround(angle_rad * 1e9)));
  return static_cast<double>(bits >> 11) * 0x1p-52 - 1;
}

}  // namespace

std::shared_ptr<std::byte[]> Buffers::take(std::size_t bytes) {
  std::unique_ptr<std::byte[]> buffer;
  {
    const std::lock_guard hold(lock_);
    if (bytes != bytes_) free_.clear();
    bytes_ = bytes;
    if (!free_.empty()) {
      buffer = std::move(free_.back());
      free_.pop_back();
    }
  }
  if (!buffer) buffer.reset(new std::byte[bytes]);  // without clearing, unlike make_unique
  const auto give_back = [pool = shared_from_this(), bytes](std::byte* pixels) {
    std::unique_ptr<std::byte[]> back(pixels);
    constexpr std::size_t kMost = 64;
    const std::lock_guard hold(pool->lock_);
    if (bytes == pool->bytes_ && pool->free_.size() < kMost) pool->free_.push_back(std::move(back));
  };
  return {buffer.release(), give_back};
}

double TableMotion::Move::motor_rad(Time when) const {
  const double t = std::clamp(seconds(when - begin), 0.0, total_s),
               length = std::abs(to_rad - from_rad);
  double way = 0;  // trapezoidal profile: ramp up, run, ramp down
  if (t >= total_s)
    way = length;
  else if (t < ramp_s)
    way = 0.5 * peak_rad_s / ramp_s * t * t;
  else if (t > total_s - ramp_s)
    way = length - 0.5 * peak_rad_s / ramp_s * (total_s - t) * (total_s - t);
  else
    way = peak_rad_s * (t - 0.5 * ramp_s);
  return from_rad + std::copysign(way, to_rad - from_rad);
}

const TableMotion::Move* TableMotion::move_at(Time when) const {
  const Move* last = nullptr;
  for (const Move& move : moves_)
    if (last == nullptr || move.begin <= when) last = &move;
  return last;
}

Time TableMotion::turn(double angle_rad, Time begin) {
  const Move* last = move_at(begin);
  Move move;
  move.begin = begin;
  move.from_rad = last != nullptr ? last->motor_rad(begin) : 0;
  move.lag_rad = this->angle_rad(begin) - move.from_rad;
  move.to_rad = angle_rad + truth_.position_error_rad * signed_hash(seed_, angle_rad);
  const double length = std::abs(move.to_rad - move.from_rad);
  move.peak_rad_s = std::min(truth_.speed_rad_s, std::sqrt(length * truth_.acceleration_rad_s2));
  if (length > 0) {
    move.ramp_s = move.peak_rad_s / truth_.acceleration_rad_s2;
    move.total_s = length / move.peak_rad_s + move.ramp_s;
  }
  move.end = begin + Micros(static_cast<std::int64_t>(std::ceil(move.total_s * 1e6)));
  moves_.push_back(move);
  return move.end;
}

void TableMotion::halt(Time now) {
  if (at_rest(now)) return;
  const Move* last = move_at(now);
  Move stop;
  stop.begin = stop.end = now;
  stop.from_rad = stop.to_rad = last->motor_rad(now);
  stop.lag_rad = angle_rad(now) - stop.from_rad;
  moves_.push_back(stop);
}

double TableMotion::angle_rad(Time when) const {
  const Move* move = move_at(when);
  if (move == nullptr) return 0;
  const double motor = move->motor_rad(when);
  // Play: the motor pushes from below; coming back, it first crosses the backlash.
  return std::clamp(move->from_rad + move->lag_rad, motor, motor + truth_.backlash_rad);
}

double TableMotion::encoder_rad(Time when) const {
  return std::round(angle_rad(when) / truth_.encoder_step_rad) * truth_.encoder_step_rad;
}

bool TableMotion::at_rest(Time when) const {
  const Move* move = move_at(when);
  return move == nullptr || when >= move->end || when < move->begin;
}

bool TableMotion::rests(Time begin, Time end) const {
  for (const Move& move : moves_) {
    // A move that was broken off ended with the next one's begin.
    const Move* next = &move == &moves_.back() ? nullptr : &move + 1;
    const Time stop = next != nullptr ? std::min(move.end, next->begin) : move.end;
    if (move.begin < end && stop > begin) return false;
  }
  return true;
}

void TableMotion::forget(Time horizon) {
  while (moves_.size() > 1 && moves_[1].begin <= horizon) moves_.pop_front();
}

World::World(Scene scene, Shape shape)
    : scene_(std::move(scene)),
      shape_(std::move(shape)),
      renderer_(scene_, shape_),
      table_(scene_.table, scene_.seed),
      faults_(scene_.faults),
      frame_counts_(scene_.cameras.size()) {
  for (std::size_t i = 0; i < scene_.displays.size(); ++i) {
    // Before anything is shown a panel is on and black, since ever.
    shown_.push_back({Shown{Time::min(), Time::min(), std::make_shared<const Emission>(0.0)}});
  }
}

Result<std::shared_ptr<World>> World::make(Scene scene) {
  Shape shape = ALHAZEN_TRY(Shape::make(scene.object));
  return std::shared_ptr<World>(new World(std::move(scene), std::move(shape)));
}

Time World::show(std::size_t display, const Picture& picture, Time now) {
  const DisplayTruth& panel = scene_.displays[display];
  auto emission = std::make_shared<const Emission>(picture.image, panel);
  // The panel takes up new pictures at its refreshes, counted from the epoch.
  const double period_us = 1e6 / panel.refresh_hz;
  const double ready_us = static_cast<double>((now + panel.latency).time_since_epoch().count());
  const Time begin(Micros(std::llround(std::ceil(ready_us / period_us) * period_us)));
  const std::lock_guard hold(lock_);
  forget_past(now);
  shown_[display].push_back({begin, begin + panel.response, std::move(emission)});
  return begin + panel.response;
}

Time World::turn(double angle_rad, Time begin) {
  const std::lock_guard hold(lock_);
  forget_past(begin);
  return table_.turn(angle_rad, begin);
}

void World::halt(Time now) {
  const std::lock_guard hold(lock_);
  table_.halt(now);
}

bool World::table_at_rest(Time when) const {
  const std::lock_guard hold(lock_);
  return table_.at_rest(when);
}

double World::encoder_rad(Time when) const {
  const std::lock_guard hold(lock_);
  return table_.encoder_rad(when);
}

double World::table_rad(Time when) const {
  const std::lock_guard hold(lock_);
  return table_.angle_rad(when);
}

void World::begin_exposure(std::size_t camera, Time begin) {
  const std::lock_guard hold(lock_);
  pending_[camera] = begin;
}

void World::cancel_exposure(std::size_t camera) {
  const std::lock_guard hold(lock_);
  pending_.erase(camera);
}

void World::forget_past(Time now) {
  Time horizon = now;
  for (const auto& [camera, begin] : pending_) horizon = std::min(horizon, begin);
  for (auto& history : shown_)
    while (history.size() > 1 && history[1].end <= horizon) history.pop_front();
  table_.forget(horizon);
}

std::vector<World::Part> World::parts_of(Time begin, Time end, double weight) const {
  std::vector<Part> parts;
  for (std::size_t display = 0; display < shown_.size(); ++display) {
    const auto& history = shown_[display];
    std::vector<double> shares(history.size(), 0);
    const auto add_moment = [&](Time when, double share) {
      // The latest picture covers the ones before as far as it has faded in.
      for (std::size_t i = history.size(); i-- > 0 && share > 0;) {
        const Shown& shown = history[i];
        double faded = when >= shown.end ? 1 : 0;
        if (when >= shown.begin && when < shown.end)
          faded = seconds(when - shown.begin) / seconds(shown.end - shown.begin);
        if (i == 0) faded = 1;
        shares[i] += share * faded;
        share -= share * faded;
      }
    };
    const bool changes = std::any_of(history.begin() + 1, history.end(), [&](const Shown& shown) {
      return shown.begin < end && shown.end > begin;
    });
    if (!changes) {
      add_moment(begin, 1);
    } else {
      constexpr int kMoments = 256;  // the light fades linearly, so few would do
      for (int i = 0; i < kMoments; ++i)
        add_moment(begin + Micros((2 * i + 1) * (end - begin).count() / (2 * kMoments)),
                   1.0 / kMoments);
    }
    for (std::size_t i = 0; i < history.size(); ++i)
      if (shares[i] > 0) parts.push_back({display, history[i].emission, weight * shares[i]});
  }
  return parts;
}

Rigid World::rig_from_object(double angle_rad) const {
  const TableTruth& table = scene_.table;
  // The wobble tilts by one turn about one horizontal line and by two about the other; none at 0.
  const Eigen::Matrix3d tilt =
      (Eigen::AngleAxisd(table.wobble_rad * std::sin(angle_rad), Vec3::UnitX()) *
       Eigen::AngleAxisd(0.5 * table.wobble_rad * std::sin(2 * angle_rad), Vec3::UnitY()))
          .toRotationMatrix();
  const Eigen::Matrix3d turn =
      tilt * Eigen::AngleAxisd(angle_rad, table.direction).toRotationMatrix();
  return {turn, table.point_mm - turn * table.point_mm};
}

std::shared_ptr<const Transport> World::transport(std::size_t camera, double angle_rad,
                                                  const Region& region) {
  const CacheKey key{camera, angle_rad, region.x, region.y, region.width, region.height};
  {
    const std::lock_guard hold(lock_);
    if (const auto found = index_.find(key); found != index_.end()) {
      kept_.splice(kept_.begin(), kept_, found->second);
      return kept_.front().transport;
    }
  }
  auto traced = std::make_shared<const Transport>(
      renderer_.trace(scene_.cameras[camera], rig_from_object(angle_rad), region));
  const std::lock_guard hold(lock_);
  ++figures_.traces;
  figures_.rays += traced->ray_count;
  if (index_.contains(key)) return traced;  // another thread was quicker; both are equal
  kept_.push_front({key, traced});
  index_[key] = kept_.begin();
  figures_.cached_bytes += traced->bytes();
  while (figures_.cached_bytes > scene_.renderer.memory_bytes && kept_.size() > 1) {
    figures_.cached_bytes -= kept_.back().transport->bytes();
    index_.erase(kept_.back().key);
    kept_.pop_back();
  }
  return traced;
}

Image World::expose(const Exposure& exposure) {
  const Time end = exposure.begin + exposure.duration;
  std::vector<Slice> slices;
  {
    const std::lock_guard hold(lock_);
    pending_.erase(exposure.camera);
    constexpr int kAngles = 8;  // of a turning table: enough to smear, and to be noticed
    const int count = table_.rests(exposure.begin, end) ? 1 : kAngles;
    for (int i = 0; i < count; ++i) {
      const Time from = exposure.begin + i * exposure.duration / count,
                 to = exposure.begin + (i + 1) * exposure.duration / count;
      slices.push_back(
          {nullptr, table_.angle_rad(from + (to - from) / 2), parts_of(from, to, 1.0 / count)});
    }
    ++figures_.frames;
  }
  for (Slice& slice : slices)
    slice.transport = transport(exposure.camera, slice.angle_rad, exposure.region);
  return develop(exposure, slices);
}

Image World::develop(const Exposure& exposure, const std::vector<Slice>& slices) const {
  std::uint64_t seed = mixed(scene_.seed, exposure.camera);
  seed = mixed(seed, static_cast<std::uint64_t>(exposure.duration.count()));
  seed = mixed(seed, std::bit_cast<std::uint64_t>(exposure.gain_db));
  for (const Slice& slice : slices) {
    seed = mixed(seed, std::bit_cast<std::uint64_t>(slice.angle_rad));
    for (const Part& part : slice.parts)
      seed = mixed(mixed(mixed(seed, part.display), part.emission->hash()),
                   std::bit_cast<std::uint64_t>(part.weight));
  }
  const Sensor sensor(scene_.sensor, exposure.duration, exposure.gain_db, seed);
  const CameraTruth& camera = scene_.cameras[exposure.camera];
  const auto width = static_cast<std::size_t>(exposure.region.width);
  const std::size_t pixel_bytes = scene_.sensor.bits == 8 ? 1 : 2;
  const std::shared_ptr<std::byte[]> pixels =
      buffers_->take(width * static_cast<std::size_t>(exposure.region.height) * pixel_bytes);
  // A million pixels are a millisecond or two of work; for less, waking a thread costs more than it
  // gains, and other cameras' frames are waiting anyway.
  const int rows_at_once = std::max(1, (1 << 20) / exposure.region.width);
  tbb::parallel_for(
      tbb::blocked_range<int>(0, exposure.region.height, static_cast<std::size_t>(rows_at_once)),
      [&](const tbb::blocked_range<int>& rows) {
        std::vector<float> radiance(width);
        for (int y = rows.begin(); y < rows.end(); ++y) {
          const auto row = static_cast<std::size_t>(y);
          std::fill(radiance.begin(), radiance.end(), 0.0F);
          for (const Slice& slice : slices) {
            const Transport& transport = *slice.transport;
            const float share = 1.0F / static_cast<float>(slices.size());
            for (std::size_t x = 0; x < width; ++x)
              radiance[x] += share * transport.dark[row * width + x];
            for (const Part& part : slice.parts) {
              const Transport::Light& light = transport.lights[part.display];
              part.emission->add(light.patches, light.begin[row], light.begin[row + 1], part.weight,
                                 radiance.data());
            }
          }
          const auto first_pixel = static_cast<std::uint32_t>(
              (exposure.region.y + y) * camera.width_px + exposure.region.x);
          sensor.read(radiance.data(), width, first_pixel,
                      pixels.get() + row * width * pixel_bytes);
        }
      });
  return {exposure.region.width, exposure.region.height,
          pixel_bytes == 1 ? PixelFormat::mono8 : PixelFormat::mono16, scene_.sensor.bits, pixels};
}

std::vector<float> World::radiance(std::size_t camera, double angle_rad, const Region& region,
                                   const std::vector<std::shared_ptr<const Emission>>& shown) {
  const auto light = transport(camera, angle_rad, region);
  std::vector<float> out = light->dark;
  const auto width = static_cast<std::size_t>(region.width);
  for (std::size_t display = 0; display < shown.size(); ++display) {
    const Transport::Light& from = light->lights[display];
    for (std::size_t y = 0; y + 1 < from.begin.size(); ++y)
      shown[display]->add(from.patches, from.begin[y], from.begin[y + 1], 1,
                          out.data() + y * width);
  }
  return out;
}

std::optional<FaultRule> World::fault(const std::string& device, const std::string& call) {
  const std::lock_guard hold(lock_);
  return faults_.next(device, call);
}

std::uint64_t World::next_frame(std::size_t camera) {
  const std::lock_guard hold(lock_);
  return ++frame_counts_[camera];
}

World::Claim World::claim(const std::string& device) {
  const std::lock_guard hold(lock_);
  const auto found = claims_.find(device);
  if (found != claims_.end() && found->second != Claim::granted) return found->second;
  claims_[device] = Claim::taken;
  return Claim::granted;
}

void World::release(const std::string& device) {
  const std::lock_guard hold(lock_);
  if (claims_[device] == Claim::taken) claims_[device] = Claim::granted;
}

void World::lose_for_good(const std::string& device) {
  const std::lock_guard hold(lock_);
  claims_[device] = Claim::gone;
}

World::Figures World::figures() const {
  const std::lock_guard hold(lock_);
  return figures_;
}

}  // namespace alhazen::sim
