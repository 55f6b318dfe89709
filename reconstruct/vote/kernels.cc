#include "reconstruct/vote/kernels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "reconstruct/vote/kernels.cc"
#include <hwy/foreach_target.h>
// Must come after foreach_target.h.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace alhazen::kernels::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using FloatTag = hn::CappedTag<float, kPadding>;
using IntTag = hn::RebindToSigned<FloatTag>;
using UintTag = hn::RebindToUnsigned<FloatTag>;
using FloatVector = hn::Vec<FloatTag>;

/// exp(x) for x ≤ 0, relative error below 2e-7; 0 below −87.
/// 2^f on [−½, ½] by its Taylor polynomial of degree 6, whose error there is 1.2e-7.
HWY_INLINE FloatVector exp_negative(FloatTag d, FloatVector x) {
  const auto t = hn::Mul(hn::Max(x, hn::Set(d, -87.0F)), hn::Set(d, 1.44269504F));
  const auto whole = hn::Round(t);
  const auto f = hn::Sub(t, whole);
  auto p = hn::Set(d, 1.5403530e-4F);
  p = hn::MulAdd(p, f, hn::Set(d, 1.3333558e-3F));
  p = hn::MulAdd(p, f, hn::Set(d, 9.6181291e-3F));
  p = hn::MulAdd(p, f, hn::Set(d, 5.5504109e-2F));
  p = hn::MulAdd(p, f, hn::Set(d, 2.4022651e-1F));
  p = hn::MulAdd(p, f, hn::Set(d, 6.9314718e-1F));
  p = hn::MulAdd(p, f, hn::Set(d, 1.0F));
  const IntTag di;
  const auto scale =
      hn::BitCast(d, hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, whole), hn::Set(di, 127))));
  return hn::IfThenElseZero(hn::Ge(x, hn::Set(d, -87.0F)), hn::Mul(p, scale));
}

HWY_INLINE FloatVector inverse_sqrt(FloatTag d, FloatVector x) {
  return hn::Div(hn::Set(d, 1.0F), hn::Sqrt(x));
}

void project_impl(const LocalProjection& projection, const float* x_mm, const float* y_mm,
                  const float* z_mm, std::size_t count, float* x_px, float* y_px) {
  const FloatTag d;
  const auto polynomial = [&](const float* c, FloatVector x, FloatVector y,
                              FloatVector z) HWY_ATTR {
    // c0 + x (c1 + c4 x + c7 y + c8 z) + y (c2 + c5 y + c9 z) + z (c3 + c6 z)
    auto along_x = hn::MulAdd(hn::Set(d, c[4]), x, hn::Set(d, c[1]));
    along_x = hn::MulAdd(hn::Set(d, c[7]), y, along_x);
    along_x = hn::MulAdd(hn::Set(d, c[8]), z, along_x);
    auto along_y = hn::MulAdd(hn::Set(d, c[5]), y, hn::Set(d, c[2]));
    along_y = hn::MulAdd(hn::Set(d, c[9]), z, along_y);
    const auto along_z = hn::MulAdd(hn::Set(d, c[6]), z, hn::Set(d, c[3]));
    return hn::MulAdd(along_x, x, hn::MulAdd(along_y, y, hn::MulAdd(along_z, z, hn::Set(d, c[0]))));
  };
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto x = hn::LoadU(d, x_mm + i), y = hn::LoadU(d, y_mm + i), z = hn::LoadU(d, z_mm + i);
    hn::StoreU(polynomial(projection.x_px, x, y, z), d, x_px + i);
    hn::StoreU(polynomial(projection.y_px, x, y, z), d, y_px + i);
  }
  for (std::size_t i = count; i < count + kPadding; ++i) x_px[i] = y_px[i] = -1e9F;
}

std::size_t look_up_impl(const MapView& map, const float* x_mm, const float* y_mm,
                         const float* z_mm, const float* x_px, const float* y_px, std::size_t count,
                         float* scratch, const VoteList& votes) {
  const FloatTag d;
  const IntTag di;
  const UintTag du;
  const std::size_t lanes = hn::Lanes(d);
  const auto one = hn::Set(di, 1);
  const auto width = hn::Set(di, map.width);
  // First: which points fall into a valid cell.
  float* const found_x = scratch;
  float* const found_y = scratch + count + kPadding;
  auto* const found_point = reinterpret_cast<std::int32_t*>(scratch + 2 * (count + kPadding));
  const auto box_x = hn::Set(d, map.box_x), box_y = hn::Set(d, map.box_y);
  const auto end_x = hn::Set(d, static_cast<float>(map.width - 1));
  const auto end_y = hn::Set(d, static_cast<float>(map.height - 1));
  const auto zero = hn::Zero(d);
  const auto* const words = reinterpret_cast<const std::int32_t*>(map.cells);
  std::size_t found = 0;
  for (std::size_t i = 0; i < count; i += lanes) {
    const auto x = hn::Sub(hn::LoadU(d, x_px + i), box_x);
    const auto y = hn::Sub(hn::LoadU(d, y_px + i), box_y);
    auto inside = hn::And(hn::And(hn::Ge(x, zero), hn::Lt(x, end_x)),
                          hn::And(hn::Ge(y, zero), hn::Lt(y, end_y)));
    if (hn::AllFalse(d, inside)) continue;
    const auto column = hn::ConvertTo(di, hn::IfThenElseZero(inside, x));
    const auto row = hn::ConvertTo(di, hn::IfThenElseZero(inside, y));
    const auto cell = hn::Add(hn::Mul(row, width), column);
    const auto word = hn::GatherIndex(di, words, hn::ShiftRight<5>(cell));
    const auto bit = hn::Shl(one, hn::And(cell, hn::Set(di, 31)));
    const auto is_set = hn::TestBit(word, bit);
    inside = hn::And(inside, hn::RebindMask(d, is_set));
    if (hn::AllFalse(d, inside)) continue;
    hn::CompressStore(x, inside, d, found_x + found);
    hn::CompressStore(y, inside, d, found_y + found);
    found += hn::CompressStore(hn::Iota(di, static_cast<std::int32_t>(i)),
                               hn::RebindMask(di, inside), di, found_point + found);
  }
  if (found == 0) return 0;
  // What fills the last vector reads where the last point does: elsewhere there may be no position.
  for (std::size_t i = found; i < std::min(found + lanes, count + kPadding); ++i) {
    found_x[i] = found_x[found - 1];
    found_y[i] = found_y[found - 1];
    found_point[i] = found_point[found - 1];
  }

  // Then: their hypotheses, all lanes at work.
  const auto least = hn::Set(d, 4 * map.min_cosine * map.min_cosine);
  std::size_t written = 0;
  for (std::size_t i = 0; i < found; i += lanes) {
    const auto x = hn::LoadU(d, found_x + i), y = hn::LoadU(d, found_y + i);
    const auto point = hn::LoadU(di, found_point + i);
    const auto column = hn::ConvertTo(di, x), row = hn::ConvertTo(di, y);
    const auto fx = hn::Sub(x, hn::ConvertTo(d, column));
    const auto fy = hn::Sub(y, hn::ConvertTo(d, row));
    const auto pair_in = [&](const std::int32_t* row_pair) HWY_ATTR {
      return hn::ShiftLeft<1>(hn::Add(hn::GatherIndex(di, row_pair, row), column));
    };
    const auto above = pair_in(map.row_pair), below = pair_in(map.row_pair + 1);
    const auto two = hn::Set(di, 2);
    const auto between = [&](const float* base) HWY_ATTR {
      const auto a = hn::GatherIndex(d, base, above);
      const auto b = hn::GatherIndex(d, base, hn::Add(above, two));
      const auto c = hn::GatherIndex(d, base, below);
      const auto e = hn::GatherIndex(d, base, hn::Add(below, two));
      const auto top = hn::MulAdd(hn::Sub(b, a), fx, a);
      const auto bottom = hn::MulAdd(hn::Sub(e, c), fx, c);
      return hn::MulAdd(hn::Sub(bottom, top), fy, top);
    };
    const auto u = between(map.uv_px);
    const auto v = between(map.uv_px + 1);
    const auto at = [&](const float* list) HWY_ATTR { return hn::GatherIndex(d, list, point); };
    const auto px = at(x_mm), py = at(y_mm), pz = at(z_mm);
    const auto display = [&](int axis) HWY_ATTR {
      return hn::MulAdd(hn::Set(d, map.v_mm[axis]), v,
                        hn::MulAdd(hn::Set(d, map.u_mm[axis]), u, hn::Set(d, map.origin_mm[axis])));
    };
    const auto lx = hn::Sub(display(0), px), ly = hn::Sub(display(1), py),
               lz = hn::Sub(display(2), pz);
    const auto vx = hn::Sub(hn::Set(d, map.eye_mm[0]), px),
               vy = hn::Sub(hn::Set(d, map.eye_mm[1]), py),
               vz = hn::Sub(hn::Set(d, map.eye_mm[2]), pz);
    const auto square = [&](FloatVector a, FloatVector b, FloatVector c)
                            HWY_ATTR { return hn::MulAdd(a, a, hn::MulAdd(b, b, hn::Mul(c, c))); };
    const auto l_scale = inverse_sqrt(d, square(lx, ly, lz));
    const auto v_scale = inverse_sqrt(d, square(vx, vy, vz));
    auto nx = hn::MulAdd(vx, v_scale, hn::Mul(lx, l_scale));
    auto ny = hn::MulAdd(vy, v_scale, hn::Mul(ly, l_scale));
    auto nz = hn::MulAdd(vz, v_scale, hn::Mul(lz, l_scale));
    // |l + v| is twice the cosine of the angle of incidence.
    const auto length2 = square(nx, ny, nz);
    auto keep = hn::Gt(length2, least);
    if (i + lanes > found) keep = hn::And(keep, hn::FirstN(d, found - i));
    const auto scale = inverse_sqrt(d, length2);
    hn::CompressStore(hn::Mul(nx, scale), keep, d, votes.x + written);
    hn::CompressStore(hn::Mul(ny, scale), keep, d, votes.y + written);
    hn::CompressStore(hn::Mul(nz, scale), keep, d, votes.z + written);
    written += hn::CompressStore(hn::BitCast(du, point), hn::RebindMask(du, keep), du,
                                 votes.point + written);
  }
  return written;
}

/// k by d², and what weighs in its mean shift.
struct Gaussian {
  explicit Gaussian(float bandwidth_rad) : scale(-0.5F / (bandwidth_rad * bandwidth_rad)) {}
  HWY_INLINE FloatVector height(FloatTag d, FloatVector distance2) const {
    return exp_negative(d, hn::Mul(distance2, hn::Set(d, scale)));
  }
  HWY_INLINE FloatVector pull(FloatTag /*d*/, FloatVector height_there) const {
    return height_there;
  }
  float scale;
};
struct Epanechnikov {
  explicit Epanechnikov(float bandwidth_rad) : scale(1 / (6 * bandwidth_rad * bandwidth_rad)) {}
  HWY_INLINE FloatVector height(FloatTag d, FloatVector distance2) const {
    return hn::Max(hn::Zero(d), hn::Sub(hn::Set(d, 1.0F), hn::Mul(distance2, hn::Set(d, scale))));
  }
  HWY_INLINE FloatVector pull(FloatTag d, FloatVector height_there) const {
    return hn::IfThenElseZero(hn::Gt(height_there, hn::Zero(d)), hn::Set(d, 1.0F));
  }
  float scale;
};

template <class Profile>
Mode climb_highest(float* x, float* y, float* z, std::size_t count, float bandwidth_rad,
                   float min_support) {
  const FloatTag d;
  const std::size_t lanes = hn::Lanes(d);
  // Padding no direction is near to: its weight is exp(−1 / 2h²) or less, times a zero vector, and
  // exactly 0 for every bandwidth below 0.07 rad; the far point makes it 0 for all.
  for (std::size_t i = count; i < count + lanes; ++i) x[i] = y[i] = z[i] = 1e3F;
  const Profile profile(bandwidth_rad);
  const auto weight = [&](FloatVector mx, FloatVector my, FloatVector mz, std::size_t i) HWY_ATTR {
    const auto dx = hn::Sub(hn::LoadU(d, x + i), mx), dy = hn::Sub(hn::LoadU(d, y + i), my),
               dz = hn::Sub(hn::LoadU(d, z + i), mz);
    const auto distance2 = hn::MulAdd(dx, dx, hn::MulAdd(dy, dy, hn::Mul(dz, dz)));
    return profile.height(d, distance2);
  };
  const auto density = [&](float mx, float my, float mz) HWY_ATTR {
    auto sum = hn::Zero(d);
    for (std::size_t i = 0; i < count; i += lanes) {
      sum = hn::Add(sum, weight(hn::Set(d, mx), hn::Set(d, my), hn::Set(d, mz), i));
    }
    return hn::GetLane(hn::SumOfLanes(d, sum));
  };

  constexpr std::size_t kSeeds = 32;
  std::array<std::size_t, kSeeds> seed{};
  std::array<float, kSeeds> height{};
  const std::size_t seeds = std::min(count, kSeeds);
  std::size_t best = 0;
  for (std::size_t s = 0; s < seeds; ++s) {
    seed[s] = s * count / seeds;
    height[s] = density(x[seed[s]], y[seed[s]], z[seed[s]]);
    if (height[s] > height[best]) best = s;
  }
  Mode mode;
  if (seeds == 0) return mode;
  const auto start = [&](std::size_t s) {
    return Mode{x[seed[s]], y[seed[s]], z[seed[s]], height[s]};
  };
  mode = start(best);
  if (mode.support < min_support) return mode;
  // A second hill can only win if its best vote stands nearly as high.
  const float apart2 = 9 * bandwidth_rad * bandwidth_rad;
  std::size_t second = kSeeds;
  for (std::size_t s = 0; s < seeds; ++s) {
    const float dx = x[seed[s]] - mode.x, dy = y[seed[s]] - mode.y, dz = z[seed[s]] - mode.z;
    if (dx * dx + dy * dy + dz * dz <= apart2 || height[s] < 0.7F * height[best]) continue;
    if (second == kSeeds || height[s] > height[second]) second = s;
  }

  const auto climb = [&](Mode from) HWY_ATTR {
    constexpr int kSteps = 12;
    for (int step = 0; step < kSteps; ++step) {
      const auto mx = hn::Set(d, from.x), my = hn::Set(d, from.y), mz = hn::Set(d, from.z);
      auto sum = hn::Zero(d), sx = hn::Zero(d), sy = hn::Zero(d), sz = hn::Zero(d);
      for (std::size_t i = 0; i < count; i += lanes) {
        const auto height_there = weight(mx, my, mz, i);
        const auto w = profile.pull(d, height_there);
        sum = hn::Add(sum, height_there);
        sx = hn::MulAdd(w, hn::LoadU(d, x + i), sx);
        sy = hn::MulAdd(w, hn::LoadU(d, y + i), sy);
        sz = hn::MulAdd(w, hn::LoadU(d, z + i), sz);
      }
      from.support = hn::GetLane(hn::SumOfLanes(d, sum));
      const float tx = hn::GetLane(hn::SumOfLanes(d, sx));
      const float ty = hn::GetLane(hn::SumOfLanes(d, sy));
      const float tz = hn::GetLane(hn::SumOfLanes(d, sz));
      const float inverse = 1 / std::sqrt(tx * tx + ty * ty + tz * tz);
      const float dx = tx * inverse - from.x, dy = ty * inverse - from.y,
                  dz = tz * inverse - from.z;
      from.x = tx * inverse;
      from.y = ty * inverse;
      from.z = tz * inverse;
      // One hundredth of the bandwidth changes the support by less than 1e-4 of it.
      if (dx * dx + dy * dy + dz * dz < 1e-4F * bandwidth_rad * bandwidth_rad) break;
    }
    return from;
  };
  mode = climb(mode);
  if (second != kSeeds) {
    const Mode other = climb(start(second));
    if (other.support > mode.support) mode = other;
  }
  return mode;
}

Mode mean_shift_impl(float* x, float* y, float* z, std::size_t count, float bandwidth_rad,
                     float min_support) {
  return climb_highest<Gaussian>(x, y, z, count, bandwidth_rad, min_support);
}
Mode mean_shift_epanechnikov_impl(float* x, float* y, float* z, std::size_t count,
                                  float bandwidth_rad, float min_support) {
  return climb_highest<Epanechnikov>(x, y, z, count, bandwidth_rad, min_support);
}

}  // namespace alhazen::kernels::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace alhazen::kernels {

HWY_EXPORT(project_impl);
HWY_EXPORT(look_up_impl);
HWY_EXPORT(mean_shift_impl);
HWY_EXPORT(mean_shift_epanechnikov_impl);

void project(const LocalProjection& projection, const float* x_mm, const float* y_mm,
             const float* z_mm, std::size_t count, float* x_px, float* y_px) {
  HWY_DYNAMIC_DISPATCH(project_impl)(projection, x_mm, y_mm, z_mm, count, x_px, y_px);
}

std::size_t look_up(const MapView& map, const float* x_mm, const float* y_mm, const float* z_mm,
                    const float* x_px, const float* y_px, std::size_t count, float* scratch,
                    const VoteList& votes) {
  return HWY_DYNAMIC_DISPATCH(look_up_impl)(map, x_mm, y_mm, z_mm, x_px, y_px, count, scratch,
                                            votes);
}

Mode mean_shift(float* x, float* y, float* z, std::size_t count, float bandwidth_rad,
                float min_support) {
  return HWY_DYNAMIC_DISPATCH(mean_shift_impl)(x, y, z, count, bandwidth_rad, min_support);
}

Mode mean_shift_epanechnikov(float* x, float* y, float* z, std::size_t count, float bandwidth_rad,
                             float min_support) {
  return HWY_DYNAMIC_DISPATCH(mean_shift_epanechnikov_impl)(x, y, z, count, bandwidth_rad,
                                                            min_support);
}

}  // namespace alhazen::kernels
#endif  // HWY_ONCE
