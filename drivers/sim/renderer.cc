#include "drivers/sim/renderer.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace alhazen::sim {
namespace {

constexpr int kTile =
    32;  // pixels across: what is followed at once stays in the second-level cache
constexpr int kBlock = 8;  // pixels across, of the mask of what may see the object
constexpr int kNothing = -1;

/// A display as seen from the object frame.
struct Screen {
  Vec3 origin_mm, u_per_mm, v_per_mm, inward;
  double width_px = 0, height_px = 0;
  Vec3 u_mm, v_mm;
};

/// Where a sight line ended.
struct End {
  float u = 0, v = 0;  // display pixels
  float share = 0;     // of the display's radiance that arrives
  float dark = 0;      // radiance with all panels black
  std::int16_t display = kNothing;
  std::int16_t bounces = 0;

  [[nodiscard]] bool same_path(const End& other) const {
    return display == other.display && (bounces == other.bounces || display == kNothing);
  }
};

/// Sight lines that are followed together, and how each one ended.
struct Bundle {
  std::vector<SightLine> lines;
  std::vector<std::uint8_t> may_hit;  // the object, on its way from the camera
  std::vector<End> ends;
  std::vector<SurfaceHit> first_hits;  // kept only where asked for

  // What is still under way.
  std::vector<std::uint32_t> alive;
  std::vector<SightLine> alive_lines;
  std::vector<SurfaceHit> hits;

  void clear() {
    lines.clear();
    may_hit.clear();
  }
  void add(const SightLine& line, bool may) {
    lines.push_back(line);
    may_hit.push_back(may ? 1 : 0);
  }
};

/// Where the last sight line of a row met the plane z = 1 of its camera, and the way there from the
/// one before.
struct Walk {
  Vec2 plane, step;
};

/// One camera, with everything in the object frame.
class View {
 public:
  View(const Scene& scene, const Shape& shape, const CameraTruth& camera,
       const Rigid& rig_from_object, const Region& region)
      : scene_(scene), shape_(shape), lens_(camera.lens), region_(region) {
    const Rigid object_from_rig = rig_from_object.inverse();
    object_from_camera_ = object_from_rig * camera.camera_from_rig.inverse();
    for (const DisplayTruth& display : scene.displays) {
      const Rigid placed = display.fixed == Fixed::to_rig ? object_from_rig : Rigid{};
      Screen screen;
      screen.origin_mm = placed * display.origin_mm;
      screen.u_mm = placed.turn * display.u_mm;
      screen.v_mm = placed.turn * display.v_mm;
      screen.u_per_mm = screen.u_mm / screen.u_mm.squaredNorm();
      screen.v_per_mm = screen.v_mm / screen.v_mm.squaredNorm();
      screen.inward = screen.u_mm.cross(screen.v_mm).normalized();
      screen.width_px = display.width_px;
      screen.height_px = display.height_px;
      screens_.push_back(screen);
    }
    find_what_is_seen();
  }

  [[nodiscard]] const Region& region() const { return region_; }
  [[nodiscard]] const Scene& scene() const { return scene_; }
  [[nodiscard]] const std::vector<Screen>& screens() const { return screens_; }

  /// Adds the line through a point of the sensor. `plane` is the last answer of the lens and
  /// becomes this one.
  void add_line(double x, double y, Walk& walk, Bundle& bundle) const {
    const Vec2 plane = lens_.plane_point({x, y}, walk.plane + walk.step);
    walk = {plane, plane - walk.plane};
    const Vec3 direction = object_from_camera_.turn * Vec3(plane.x(), plane.y(), 1).normalized();
    bundle.add({object_from_camera_.shift_mm, direction}, (sees(x, y) & kObject) != 0);
  }
  [[nodiscard]] Walk walk_from(double x, double y) const {
    return {lens_.plane_point({x, y}), Vec2::Zero()};
  }

  /// What the pixel at (x, y) of the sensor and its corners may meet first.
  static constexpr std::uint8_t kObject = 1, kOther = 2;
  [[nodiscard]] std::uint8_t sees(double x, double y) const {
    const int i = std::clamp((static_cast<int>(x) - region_.x) / kBlock, 0, blocks_across_ - 1);
    const int j = std::clamp((static_cast<int>(y) - region_.y) / kBlock, 0, blocks_down_ - 1);
    return mask_[mask_index(i, j)];
  }

  /// Follows every line of the bundle to its end. Returns the number of lines followed, bounces
  /// counted.
  std::uint64_t follow(Bundle& bundle, bool keep_first_hits) const;

  /// Light of the displays that the matt rest of the surface sends to every direction: patches for
  /// cells of each display. Returns the radiance of it with all panels black.
  double add_diffuse(const SurfaceHit& hit, std::uint32_t x,
                     std::vector<std::vector<Patch>>& lights) const;

 private:
  [[nodiscard]] std::size_t mask_index(int i, int j) const {
    return static_cast<std::size_t>(j) * static_cast<std::size_t>(blocks_across_) +
           static_cast<std::size_t>(i);
  }
  void find_what_is_seen();
  void mark_all();
  void mark(std::uint8_t what, const Vec2& low, const Vec2& high);
  void mark_hull(const std::vector<Vec3>& corners_camera);
  /// Ends the line at the first display or at the holder; the distance to it, infinite where it
  /// leaves the rig.
  double surroundings(const SightLine& line, End& end) const;
  [[nodiscard]] double holder_distance(const SightLine& line) const;
  [[nodiscard]] bool is_blocked(const Vec3& from, const Vec3& to) const;

  const Scene& scene_;
  const Shape& shape_;
  const Lens& lens_;
  Region region_;
  Rigid object_from_camera_;
  std::vector<Screen> screens_;
  int blocks_across_ = 0, blocks_down_ = 0;
  std::vector<std::uint8_t> mask_;
};

void View::find_what_is_seen() {
  blocks_across_ = (region_.width + kBlock - 1) / kBlock;
  blocks_down_ = (region_.height + kBlock - 1) / kBlock;
  mask_.assign(mask_index(0, blocks_down_), 0);
  const Rigid camera_from_object = object_from_camera_.inverse();
  const double focal_px = std::max(lens_.fx_px, lens_.fy_px);
  for (const Ball& ball : shape_.cover()) {
    const Vec3 centre = camera_from_object * ball.centre_mm;
    if (centre.z() < 2 * ball.radius_mm) return mark_all();  // the camera all but touches it
    const Vec2 middle = lens_.project(centre);
    // Perspective and distortion stretch the disc by less than a quarter; two pixels for corners.
    const double reach = 1.25 * ball.radius_mm / (centre.z() - ball.radius_mm) * focal_px + 2;
    mark(kObject, middle.array() - reach, middle.array() + reach);
  }
  for (const Screen& screen : screens_) {
    std::vector<Vec3> corners;
    for (const double u : {-0.5, screen.width_px - 0.5})
      for (const double v : {-0.5, screen.height_px - 0.5})
        corners.push_back(camera_from_object *
                          (screen.origin_mm + u * screen.u_mm + v * screen.v_mm));
    mark_hull(corners);
  }
  if (scene_.holder.radius_mm > 0 && scene_.holder.length_mm > 0) {
    std::vector<Vec3> corners;
    for (const double z : {0.0, -scene_.holder.length_mm})
      for (const double x : {-1.0, 1.0})
        for (const double y : {-1.0, 1.0})
          corners.push_back(camera_from_object *
                            Vec3(scene_.holder.radius_mm * x, scene_.holder.radius_mm * y, z));
    mark_hull(corners);
  }
}

void View::mark_all() { std::fill(mask_.begin(), mask_.end(), std::uint8_t{kObject | kOther}); }

void View::mark(std::uint8_t what, const Vec2& low, const Vec2& high) {
  const auto block = [](double at, int first, int count) {
    return static_cast<int>(
        std::floor(std::clamp((at - first) / kBlock, -1.0, static_cast<double>(count))));
  };
  const int left = std::max(0, block(low.x(), region_.x, blocks_across_)),
            right = std::min(blocks_across_ - 1, block(high.x(), region_.x, blocks_across_)),
            top = std::max(0, block(low.y(), region_.y, blocks_down_)),
            bottom = std::min(blocks_down_ - 1, block(high.y(), region_.y, blocks_down_));
  for (int j = top; j <= bottom; ++j)
    for (int i = left; i <= right; ++i) mask_[mask_index(i, j)] |= what;
}

void View::mark_hull(const std::vector<Vec3>& corners_camera) {
  Vec2 low = Vec2::Constant(std::numeric_limits<double>::infinity()), high = -low;
  std::size_t behind = 0;
  for (const Vec3& corner : corners_camera) {
    if (corner.z() <= 0) {
      ++behind;
      continue;
    }
    // Without distortion, which means nothing far outside the picture.
    const Vec2 at(lens_.fx_px * corner.x() / corner.z() + lens_.cx_px,
                  lens_.fy_px * corner.y() / corner.z() + lens_.cy_px);
    low = low.cwiseMin(at);
    high = high.cwiseMax(at);
  }
  if (behind == corners_camera.size()) return;
  if (behind > 0) {
    low = Vec2::Constant(-std::numeric_limits<double>::infinity());
    high = -low;
  }
  // Lenses of a rig bend lines by far less than a tenth of the picture.
  const double slack = 0.1 * std::max(region_.x + region_.width, region_.y + region_.height) + 2;
  mark(kOther, low.array() - slack, high.array() + slack);
}

double View::holder_distance(const SightLine& line) const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const double radius = scene_.holder.radius_mm, foot = -scene_.holder.length_mm;
  if (radius == 0 || foot == 0) return kInfinity;
  const Vec3 &o = line.origin_mm, &d = line.direction;
  const double a = d.head<2>().squaredNorm(), b = o.head<2>().dot(d.head<2>()),
               c = o.head<2>().squaredNorm() - radius * radius, square = b * b - a * c;
  if (square < 0 || (c > 0 && b > 0))
    return kInfinity;  // passes the endless cylinder, or leaves it
  double first = kInfinity;
  const auto offer = [&](double t) {
    if (t > Shape::kSkinMm && t < first) first = t;
  };
  if (d.z() != 0)
    for (const double level : {0.0, foot}) {
      const double t = (level - o.z()) / d.z();
      if ((o.head<2>() + t * d.head<2>()).squaredNorm() <= radius * radius) offer(t);
    }
  if (a > 0)
    for (const double root : {-std::sqrt(square), std::sqrt(square)}) {
      const double t = (-b + root) / a, z = o.z() + t * d.z();
      if (z <= 0 && z >= foot) offer(t);
    }
  return first;
}

double View::surroundings(const SightLine& line, End& end) const {
  double first = holder_distance(line);
  const bool on_holder = first < std::numeric_limits<double>::infinity();
  end.display = kNothing;
  double radiance = on_holder ? scene_.ambient * scene_.holder.albedo : scene_.ambient;
  for (std::size_t i = 0; i < screens_.size(); ++i) {
    const Screen& screen = screens_[i];
    const double fall = line.direction.dot(screen.inward);
    if (fall == 0) continue;
    const Vec3 to = screen.origin_mm - line.origin_mm;
    const double t = to.dot(screen.inward) / fall;
    if (!(t > Shape::kSkinMm && t < first)) continue;
    const Vec3 at = t * line.direction - to;
    const double u = at.dot(screen.u_per_mm), v = at.dot(screen.v_per_mm);
    if (!(u >= -0.5 && u < screen.width_px - 0.5 && v >= -0.5 && v < screen.height_px - 0.5))
      continue;
    first = t;
    // The back of a panel is black.
    end.display = fall > 0 ? static_cast<std::int16_t>(i) : static_cast<std::int16_t>(kNothing);
    radiance = fall > 0 ? scene_.displays[i].black_share : 0;
    end.u = static_cast<float>(u);
    end.v = static_cast<float>(v);
  }
  end.dark += end.share * static_cast<float>(radiance);
  return first;
}

std::uint64_t View::follow(Bundle& bundle, bool keep_first_hits) const {
  const std::size_t count = bundle.lines.size();
  std::uint64_t followed = count;
  bundle.ends.assign(count, End{});
  if (keep_first_hits) bundle.first_hits.assign(count, SurfaceHit{});
  bundle.alive.clear();
  for (std::size_t i = 0; i < count; ++i) {
    bundle.ends[i].share = 1;
    if (bundle.may_hit[i] != 0)
      bundle.alive.push_back(static_cast<std::uint32_t>(i));
    else
      surroundings(bundle.lines[i], bundle.ends[i]);
  }
  const auto reflectance = static_cast<float>(scene_.object.reflectance);
  const auto matt_ambient = static_cast<float>(scene_.object.diffuse * scene_.ambient);
  for (int bounce = 0; !bundle.alive.empty(); ++bounce) {
    bundle.alive_lines.clear();
    for (const std::uint32_t i : bundle.alive) bundle.alive_lines.push_back(bundle.lines[i]);
    bundle.hits.resize(bundle.alive.size());
    shape_.intersect(bundle.alive_lines, bundle.hits);
    if (bounce > 0) followed += bundle.alive.size();
    std::size_t still = 0;
    for (std::size_t k = 0; k < bundle.alive.size(); ++k) {
      const std::uint32_t i = bundle.alive[k];
      SightLine& line = bundle.lines[i];
      const SurfaceHit& hit = bundle.hits[k];
      End& end = bundle.ends[i];
      End around = end;
      if (surroundings(line, around) < hit.distance_mm ||
          hit.distance_mm == std::numeric_limits<double>::infinity()) {
        end = around;
        continue;
      }
      if (keep_first_hits && bounce == 0) bundle.first_hits[i] = hit;
      end.dark += end.share * matt_ambient;
      const double fall = line.direction.dot(hit.normal);
      const Vec3 mirrored = line.direction - 2 * fall * hit.normal;
      // Inside, behind the rim of the visible side, or at the end of what is followed: dark.
      if (bounce >= scene_.renderer.path_depth || !(line.direction.dot(hit.face) < 0) ||
          !(mirrored.dot(hit.face) > 0))
        continue;
      end.share *= reflectance;
      end.bounces = static_cast<std::int16_t>(bounce + 1);
      line = {hit.point_mm, mirrored};
      bundle.alive[still++] = i;
    }
    bundle.alive.resize(still);
  }
  return followed;
}

bool View::is_blocked(const Vec3& from, const Vec3& to) const {
  const double distance = (to - from).norm();
  const SightLine line{from, (to - from) / distance};
  SurfaceHit hit;
  shape_.intersect({&line, 1}, {&hit, 1});
  return hit.distance_mm < distance || holder_distance(line) < distance;
}

std::uint16_t width_units(double px) {
  return static_cast<std::uint16_t>(
      std::min(px * static_cast<double>(Extent::kUnitsPerPx) + 0.5, 65535.0));
}

double View::add_diffuse(const SurfaceHit& hit, std::uint32_t x,
                         std::vector<std::vector<Patch>>& lights) const {
  double dark = 0;
  constexpr int kCells = 4;  // across a display: a matt surface tells no more of the picture
  for (std::size_t d = 0; d < screens_.size(); ++d) {
    const Screen& screen = screens_[d];
    const double cell_u = screen.width_px / kCells, cell_v = screen.height_px / kCells;
    const double area = cell_u * cell_v * screen.u_mm.cross(screen.v_mm).norm();
    for (int j = 0; j < kCells; ++j)
      for (int i = 0; i < kCells; ++i) {
        const double u = (i + 0.5) * cell_u - 0.5, v = (j + 0.5) * cell_v - 0.5;
        const Vec3 point = screen.origin_mm + u * screen.u_mm + v * screen.v_mm;
        const Vec3 to = point - hit.point_mm;
        const double square = to.squaredNorm(), distance = std::sqrt(square);
        const double here = to.dot(hit.normal) / distance, there = to.dot(screen.inward) / distance;
        if (here <= 0 || there <= 0 || is_blocked(hit.point_mm, point)) continue;
        const double weight =
            scene_.object.diffuse / std::numbers::pi * here * there * area / square;
        Patch patch;
        patch.x = x;
        patch.weight = static_cast<float>(weight);
        patch.u = static_cast<float>(u);
        patch.v = static_cast<float>(v);
        patch.extent_u = {width_units(cell_u), 0};
        patch.extent_v = {width_units(cell_v), 0};
        lights[d].push_back(patch);
        dark += weight * scene_.displays[d].black_share;
      }
  }
  return dark;
}

/// Boxes whose convolution is the shadow of the parallelogram of two edges on an axis.
Extent extent_of(double along, double across) {
  const double a = std::abs(along), b = std::abs(across);
  return {width_units(std::max(a, b)), width_units(std::min(a, b))};
}

/// What is gathered for the rows of one band of tiles.
struct Band {
  std::vector<std::vector<std::vector<Patch>>> rows;  // row, display
  std::uint64_t ray_count = 0, uneven_count = 0;
};

/// Traces tile after tile of a band; keeps the memory it works in.
class Tiler {
 public:
  Tiler(const View& view, Transport& out)
      : view_(view), out_(out), matt_(view.scene().object.diffuse > 0) {}

  /// Pixels [left, left + width) × [top, top + height), relative to the region.
  void trace(int left, int top, int width, int height, Band& band);

 private:
  [[nodiscard]] float& dark(int x, int y) {
    return out_.dark[static_cast<std::size_t>(y) * static_cast<std::size_t>(out_.region.width) +
                     static_cast<std::size_t>(x)];
  }
  using Corners = std::array<const End*, 4>;  // left top, right top, left bottom, right bottom
  [[nodiscard]] Corners corners_of(int i, int j, int width) const {
    const End* first =
        &corners_.ends[static_cast<std::size_t>(j) * static_cast<std::size_t>(width + 1) +
                       static_cast<std::size_t>(i)];
    return {first, first + 1, first + width + 1, first + width + 2};
  }
  [[nodiscard]] bool sees_anything(int left, int top, int width, int height) const {
    for (int y = top; y < top + height; y += kBlock)
      for (int x = left; x < left + width; x += kBlock)
        if (view_.sees(view_.region().x + x, view_.region().y + y) != 0) return true;
    return false;
  }
  bool add_even(const Corners& corners, const End& middle, int x, int y,
                std::vector<std::vector<Patch>>& lights);
  void add_uneven(const End* samples, int x, int y, std::vector<std::vector<Patch>>& lights);

  const View& view_;
  Transport& out_;
  bool matt_ = false;
  Bundle corners_, middles_, samples_;
  std::vector<std::pair<int, int>> lit_, uneven_;  // of the tile
};

bool Tiler::add_even(const Corners& corners, const End& middle, int x, int y,
                     std::vector<std::vector<Patch>>& lights) {
  for (const End* corner : corners)
    if (!corner->same_path(middle)) return false;
  const auto mean = [&](float End::*part) {
    return 0.25 * (static_cast<double>(corners[0]->*part) + static_cast<double>(corners[1]->*part) +
                   static_cast<double>(corners[2]->*part) + static_cast<double>(corners[3]->*part));
  };
  dark(x, y) = static_cast<float>((2.0 * static_cast<double>(middle.dark) + mean(&End::dark)) / 3);
  if (middle.display == kNothing) return true;
  struct Axis {
    double middle, along, across;
    bool is_linear;
  };
  const auto axis = [&](float End::*part) {
    const double a = static_cast<double>(corners[0]->*part),
                 b = static_cast<double>(corners[1]->*part),
                 c = static_cast<double>(corners[2]->*part),
                 d = static_cast<double>(corners[3]->*part);
    const double m = static_cast<double>(middle.*part), average = 0.25 * (a + b + c + d);
    const double along = 0.5 * (b + d - a - c), across = 0.5 * (c + d - a - b);
    const double bent = std::max(std::abs(m - average), 0.25 * std::abs(a + d - b - c));
    constexpr double kSmallPx = 0.1;  // below this nothing on the display is seen anyway
    // Corners at ±½ and the middle integrate a quadratic map over the pixel exactly: ⅔ and ⅓.
    return Axis{(2 * m + average) / 3, along, across,
                bent <= Renderer::kEvenShare * (std::abs(along) + std::abs(across)) + kSmallPx};
  };
  const Axis u = axis(&End::u), v = axis(&End::v);
  if (!u.is_linear || !v.is_linear) return false;
  Patch patch;
  patch.x = static_cast<std::uint32_t>(x);
  patch.weight = middle.share;
  patch.u = static_cast<float>(u.middle);
  patch.v = static_cast<float>(v.middle);
  patch.extent_u = extent_of(u.along, u.across);
  patch.extent_v = extent_of(v.along, v.across);
  lights[static_cast<std::size_t>(middle.display)].push_back(patch);
  return true;
}

void Tiler::add_uneven(const End* samples, int x, int y, std::vector<std::vector<Patch>>& lights) {
  const int across = view_.scene().renderer.samples_across;
  const float part = 1.0F / static_cast<float>(across * across);
  float black = 0;
  for (int j = 0; j < across; ++j)
    for (int i = 0; i < across; ++i) {
      const End& end = samples[j * across + i];
      black += part * end.dark;
      if (end.display == kNothing) continue;
      // The neighbours on the same path tell how far this sample's share reaches.
      const auto reach = [&](int di, int dj, float End::*axis) {
        double least = std::numeric_limits<double>::infinity();
        for (const int sign : {-1, 1}) {
          const int ni = i + sign * di, nj = j + sign * dj;
          if (ni < 0 || nj < 0 || ni >= across || nj >= across) continue;
          const End& next = samples[nj * across + ni];
          if (next.same_path(end))
            least = std::min(
                least, std::abs(static_cast<double>(next.*axis) - static_cast<double>(end.*axis)));
        }
        return least == std::numeric_limits<double>::infinity() ? 0.0 : least;
      };
      Patch patch;
      patch.x = static_cast<std::uint32_t>(x);
      patch.weight = part * end.share;
      patch.u = end.u;
      patch.v = end.v;
      patch.extent_u = extent_of(reach(1, 0, &End::u), reach(0, 1, &End::u));
      patch.extent_v = extent_of(reach(1, 0, &End::v), reach(0, 1, &End::v));
      lights[static_cast<std::size_t>(end.display)].push_back(patch);
    }
  dark(x, y) = black;
}

void Tiler::trace(int left, int top, int width, int height, Band& band) {
  const Region& region = view_.region();
  const double x0 = region.x + left, y0 = region.y + top;
  if (!sees_anything(left, top, width, height)) {
    for (int j = 0; j < height; ++j)
      std::fill_n(&dark(left, top + j), width, static_cast<float>(view_.scene().ambient));
    return;
  }
  corners_.clear();
  for (int j = 0; j <= height; ++j) {
    Walk walk = view_.walk_from(x0 - 0.5, y0 + j - 0.5);
    for (int i = 0; i <= width; ++i) view_.add_line(x0 + i - 0.5, y0 + j - 0.5, walk, corners_);
  }
  band.ray_count += view_.follow(corners_, false);

  // A pixel whose corners all see no display is dark. The others need their middles.
  lit_.clear();
  middles_.clear();
  for (int j = 0; j < height; ++j) {
    Walk walk = view_.walk_from(x0, y0 + j);
    int last = 0;
    for (int i = 0; i < width; ++i) {
      const Corners corners = corners_of(i, j, width);
      const bool unlit = std::all_of(corners.begin(), corners.end(),
                                     [](const End* end) { return end->display == kNothing; });
      if (unlit)
        dark(left + i, top + j) =
            0.25F * (corners[0]->dark + corners[1]->dark + corners[2]->dark + corners[3]->dark);
      if (unlit && !matt_) continue;
      if (i - last > 1) walk = view_.walk_from(x0 + i, y0 + j);
      last = i;
      view_.add_line(x0 + i, y0 + j, walk, middles_);
      lit_.emplace_back(i, j);
    }
  }
  band.ray_count += view_.follow(middles_, matt_);

  uneven_.clear();
  for (std::size_t k = 0; k < lit_.size(); ++k) {
    const auto [i, j] = lit_[k];
    auto& lights = band.rows[static_cast<std::size_t>(j)];
    if (!add_even(corners_of(i, j, width), middles_.ends[k], left + i, top + j, lights))
      uneven_.emplace_back(i, j);
    if (matt_ && middles_.first_hits[k].distance_mm < std::numeric_limits<double>::infinity())
      dark(left + i, top + j) += static_cast<float>(
          view_.add_diffuse(middles_.first_hits[k], static_cast<std::uint32_t>(left + i), lights));
  }

  const int across = view_.scene().renderer.samples_across;
  samples_.clear();
  for (const auto& [i, j] : uneven_)
    for (int b = 0; b < across; ++b) {
      const double x = x0 + i + 0.5 / across - 0.5, y = y0 + j + (b + 0.5) / across - 0.5;
      Walk walk = view_.walk_from(x, y);
      for (int a = 0; a < across; ++a)
        view_.add_line(x + static_cast<double>(a) / across, y, walk, samples_);
    }
  band.ray_count += view_.follow(samples_, false);
  band.uneven_count += uneven_.size();
  for (std::size_t k = 0; k < uneven_.size(); ++k)
    add_uneven(
        &samples_.ends[k * static_cast<std::size_t>(across) * static_cast<std::size_t>(across)],
        left + uneven_[k].first, top + uneven_[k].second,
        band.rows[static_cast<std::size_t>(uneven_[k].second)]);
}

}  // namespace

std::size_t Transport::bytes() const noexcept {
  std::size_t sum = sizeof(Transport) + dark.capacity() * sizeof(float);
  for (const Light& light : lights)
    sum += light.patches.size() * sizeof(Patch) + light.begin.capacity() * sizeof(std::uint32_t);
  return sum;
}

Transport Renderer::trace(const CameraTruth& camera, const Rigid& rig_from_object,
                          const Region& region) const {
  ALHAZEN_CHECK(region.x >= 0 && region.y >= 0 && region.width > 0 && region.height > 0 &&
                region.x + region.width <= camera.width_px &&
                region.y + region.height <= camera.height_px);
  const View view(scene_, shape_, camera, rig_from_object, region);
  Transport out;
  out.region = region;
  const auto rows = static_cast<std::size_t>(region.height);
  out.dark.assign(rows * static_cast<std::size_t>(region.width), 0);
  const int band_count = (region.height + kTile - 1) / kTile;
  std::vector<Band> bands(static_cast<std::size_t>(band_count));
  tbb::parallel_for(0, band_count, [&](int b) {
    Band& band = bands[static_cast<std::size_t>(b)];
    const int top = b * kTile, height = std::min(kTile, region.height - top);
    band.rows.assign(static_cast<std::size_t>(height),
                     std::vector<std::vector<Patch>>(scene_.displays.size()));
    Tiler tiler(view, out);
    for (int left = 0; left < region.width; left += kTile)
      tiler.trace(left, top, std::min(kTile, region.width - left), height, band);
  });
  out.lights.resize(scene_.displays.size());
  for (std::size_t d = 0; d < out.lights.size(); ++d) {
    Transport::Light& light = out.lights[d];
    std::size_t total = 0;
    for (const Band& band : bands)
      for (const auto& row : band.rows) total += row[d].size();
    light.patches.reserve(total);
    light.begin.reserve(rows + 1);
    for (const Band& band : bands)
      for (const auto& row : band.rows) {
        light.begin.push_back(static_cast<std::uint32_t>(light.patches.size()));
        for (const Patch& patch : row[d]) light.patches.push_back(patch);
      }
    light.begin.push_back(static_cast<std::uint32_t>(light.patches.size()));
  }
  for (const Band& band : bands) {
    out.ray_count += band.ray_count;
    out.uneven_count += band.uneven_count;
  }
  return out;
}

}  // namespace alhazen::sim
