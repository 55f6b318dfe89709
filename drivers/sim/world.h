#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "alhazen/clock.h"
#include "alhazen/image.h"
#include "alhazen/pattern.h"
#include "alhazen/result.h"
#include "drivers/sim/emission.h"
#include "drivers/sim/faults.h"
#include "drivers/sim/renderer.h"
#include "drivers/sim/scene.h"
#include "drivers/sim/shape.h"

namespace alhazen::sim {

/// The turntable's motion in time: moves with finite speed and acceleration, lags by its backlash,
/// rests where the angle says, not quite where it was sent. Every property is a function of angle
/// and direction, so a repeated approach ends at the same place bit by bit. Thread-bound.
class TableMotion {
 public:
  TableMotion(const TableTruth& truth, std::uint64_t seed) : truth_(truth), seed_(seed) {}

  /// Starts to turn at `begin` (a move under way is broken off). Returns when it will be at rest.
  Time turn(double angle_rad, Time begin);
  /// Stops at once.
  void halt(Time now);
  /// The true angle of the table.
  [[nodiscard]] double angle_rad(Time when) const;
  /// What the encoder on the table reads then.
  [[nodiscard]] double encoder_rad(Time when) const;
  [[nodiscard]] bool at_rest(Time when) const;
  /// When the table, at rest or not at `begin`, is at rest up to `end`; false when it moves
  /// between.
  [[nodiscard]] bool rests(Time begin, Time end) const;
  /// Forgets what was before `horizon`.
  void forget(Time horizon);

 private:
  struct Move {
    Time begin, end;
    double from_rad = 0, to_rad = 0;  ///< of the motor
    double lag_rad = 0;               ///< table minus motor when it began
    double peak_rad_s = 0, ramp_s = 0, total_s = 0;
    [[nodiscard]] double motor_rad(Time when) const;
  };
  [[nodiscard]] const Move* move_at(Time when) const;

  TableTruth truth_;
  std::uint64_t seed_;
  std::deque<Move> moves_;
};

/// Pixel buffers of frames, used again: fresh memory would be cleared by the kernel for each frame,
/// at the price of rendering it. Thread-safe; lives as long as its last frame.
class Buffers : public std::enable_shared_from_this<Buffers> {
 public:
  [[nodiscard]] std::shared_ptr<std::byte[]> take(std::size_t bytes);

 private:
  std::mutex lock_;  // guards all below
  std::size_t bytes_ = 0;
  std::vector<std::unique_ptr<std::byte[]>> free_;  // each of bytes_
};

/// What one exposure is taken with.
struct Exposure {
  std::size_t camera = 0;
  Time begin;
  Micros duration{0};
  double gain_db = 0;
  Region region;
};

/// The shared state of the simulated rig on one time line: what each display shows since when, how
/// the table stands. An exposure integrates what it overlaps: a transition or a turning table gives
/// the mixture, so whoever does not wait gets wrong data, as on a real rig.
///
/// Thread-safe. Time comes in as arguments alone.
class World {
 public:
  /// Fails: as Scene::load, and as Shape::make.
  [[nodiscard]] static Result<std::shared_ptr<World>> make(Scene scene);

  [[nodiscard]] const Scene& scene() const noexcept { return scene_; }
  [[nodiscard]] const Shape& shape() const noexcept { return shape_; }

  /// A picture is put on a display at `now`: it appears with a refresh after the latency and takes
  /// the response time to settle. Returns when it is steady.
  /// REQUIRES: the picture has the display's size.
  Time show(std::size_t display, const Picture& picture, Time now);

  /// Sends the table to an angle. Returns when it will rest.
  Time turn(double angle_rad, Time begin);
  void halt(Time now);
  [[nodiscard]] bool table_at_rest(Time when) const;
  [[nodiscard]] double encoder_rad(Time when) const;
  [[nodiscard]] double table_rad(Time when) const;

  /// Announces that an exposure began: the world keeps what happens from then on until expose() or
  /// cancel_exposure() of the same camera.
  void begin_exposure(std::size_t camera, Time begin);
  void cancel_exposure(std::size_t camera);
  /// What the camera recorded; a function of its arguments and of the time line alone.
  /// REQUIRES: the region lies within the picture, duration > 0, nothing later than the exposure's
  ///           end is missing from the time line.
  [[nodiscard]] Image expose(const Exposure& exposure);

  /// The radiance of each pixel of `region` at a resting angle, with a picture on each display: for
  /// pictures of the world and for tests.
  [[nodiscard]] std::vector<float> radiance(
      std::size_t camera, double angle_rad, const Region& region,
      const std::vector<std::shared_ptr<const Emission>>& shown);

  /// How the table holds the object at a true angle, wobble included.
  [[nodiscard]] Rigid rig_from_object(double angle_rad) const;

  /// The light transport of a resting stop, from the cache where it is kept.
  [[nodiscard]] std::shared_ptr<const Transport> transport(std::size_t camera, double angle_rad,
                                                           const Region& region);

  /// Counts a call of a device; the fault that befalls it, if any.
  [[nodiscard]] std::optional<FaultRule> fault(const std::string& device, const std::string& call);
  /// Number of the next frame of a camera, rising through every closing and opening.
  [[nodiscard]] std::uint64_t next_frame(std::size_t camera);

  /// Claims a device. False: it is open already, or gone for good.
  enum class Claim : std::uint8_t { granted, taken, gone };
  [[nodiscard]] Claim claim(const std::string& device);
  void release(const std::string& device);
  void lose_for_good(const std::string& device);

  struct Figures {
    std::uint64_t rays = 0, traces = 0, frames = 0;
    std::size_t cached_bytes = 0;
  };
  [[nodiscard]] Figures figures() const;

 private:
  /// One picture on a display; until `end` it fades in over what was before.
  struct Shown {
    Time begin, end;
    std::shared_ptr<const Emission> emission;
  };
  /// A share of an exposure during which a display showed one picture.
  struct Part {
    std::size_t display = 0;
    std::shared_ptr<const Emission> emission;
    double weight = 0;
  };
  /// A share of an exposure during which the table stood at one angle.
  struct Slice {
    std::shared_ptr<const Transport> transport;
    double angle_rad = 0;
    std::vector<Part> parts;
  };
  struct CacheKey {
    std::size_t camera;
    double angle_rad;
    int x, y, width, height;
    friend auto operator<=>(const CacheKey&, const CacheKey&) = default;
  };
  struct Kept {
    CacheKey key;
    std::shared_ptr<const Transport> transport;
  };

  World(Scene scene, Shape shape);
  [[nodiscard]] std::vector<Part> parts_of(Time begin, Time end, double weight) const;
  void forget_past(Time now);
  [[nodiscard]] Image develop(const Exposure& exposure, const std::vector<Slice>& slices) const;

  const Scene scene_;
  const Shape shape_;
  const Renderer renderer_;
  const std::shared_ptr<Buffers> buffers_ = std::make_shared<Buffers>();

  mutable std::mutex lock_;  // guards all below
  TableMotion table_;
  std::vector<std::deque<Shown>> shown_;  // per display, in time order; the first one never fades
  std::map<std::size_t, Time> pending_;   // begin of exposures under way, by camera
  Faults faults_;
  std::map<std::string, Claim> claims_;
  std::vector<std::uint64_t> frame_counts_;
  std::list<Kept> kept_;  // most recently used first
  std::map<CacheKey, std::list<Kept>::iterator> index_;
  Figures figures_;
};

}  // namespace alhazen::sim
