#include "reconstruct/refine/sight.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>

#include "reconstruct/geometry/pose.h"

namespace alhazen {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

/// Where a pixel lies among those of a light map.
struct Place {
  int column, row;  ///< of the pixel at the top left
  double fx, fy;    ///< beyond it
};

std::optional<Place> place_of(const Observation& seen, const Vector2d& pixel) {
  const double x = pixel.x() - seen.box.x, y = pixel.y() - seen.box.y;
  if (!(x >= 0 && y >= 0 && x < seen.box.width - 1 && y < seen.box.height - 1)) return std::nullopt;
  const Place place{static_cast<int>(x), static_cast<int>(y), x - std::floor(x), y - std::floor(y)};
  return place;
}

bool is_cell(const Observation& seen, int column, int row) {
  const std::size_t cell =
      static_cast<std::size_t>(row) * static_cast<std::size_t>(seen.box.width) +
      static_cast<std::size_t>(column);
  return (seen.cells[cell / 32] >> (cell % 32) & 1U) != 0;
}

/// REQUIRES: a corner of a cell.
Vector2d position_px(const Observation& seen, int column, int row) {
  const auto pair =
      static_cast<std::size_t>(std::int64_t{seen.row_pair[static_cast<std::size_t>(row)]} + column);
  return {double{seen.uv_px[2 * pair]}, double{seen.uv_px[2 * pair + 1]}};
}

/// The position, as voting reads it: bilinear between four that do not jump.
std::optional<Vector2d> read(const Observation& seen, const Place& at) {
  if (!is_cell(seen, at.column, at.row)) return std::nullopt;
  const auto along = [&](int row) -> Vector2d {
    return (1 - at.fx) * position_px(seen, at.column, row) +
           at.fx * position_px(seen, at.column + 1, row);
  };
  return (1 - at.fy) * along(at.row) + at.fy * along(at.row + 1);
}

/// How the position changes from pixel to pixel (columns: right, down), by the quadratic that fits
/// 6 × 6 pixels best; nothing where they are not all valid. The difference of two
/// neighbours would hold their noise: derivatives would differ from vote to vote where in truth
/// none does, which looks like knowledge of motions that no vote can tell, such as those of the
/// whole rig.
std::optional<Eigen::Matrix2d> slope_of(const Observation& seen, const Place& at) {
  constexpr int kReach = 2;
  if (at.column < kReach || at.row < kReach || at.column + kReach + 1 >= seen.box.width ||
      at.row + kReach + 1 >= seen.box.height) {
    return std::nullopt;
  }
  // From the middle of the window x = … −½, ½, …; per row Σ x² and Σ x⁴.
  double row2 = 0, row4 = 0;
  for (int dx = -kReach; dx <= kReach + 1; ++dx) {
    row2 += std::pow(dx - 0.5, 2);
    row4 += std::pow(dx - 0.5, 4);
  }
  constexpr double kSide = 2 * kReach + 2;
  const double mean2 = row2 / kSide;
  Vector2d by_x = Vector2d::Zero(), by_y = by_x, by_xx = by_x, by_yy = by_x, by_xy = by_x;
  for (int dy = -kReach; dy <= kReach + 1; ++dy) {
    for (int dx = -kReach; dx <= kReach + 1; ++dx) {
      const int column = at.column + dx, row = at.row + dy;
      if (dx <= kReach && dy <= kReach && !is_cell(seen, column, row)) return std::nullopt;
      const double x = dx - 0.5, y = dy - 0.5;
      const Vector2d uv = position_px(seen, column, row);
      by_x += x * uv;
      by_y += y * uv;
      by_xx += (x * x - mean2) * uv;
      by_yy += (y * y - mean2) * uv;
      by_xy += x * y * uv;
    }
  }
  const double linear = 1 / (kSide * row2), square = 1 / (kSide * row4 - row2 * row2),
               product = 1 / (row2 * row2);
  const double x = at.fx - 0.5, y = at.fy - 0.5;
  Eigen::Matrix2d slope;
  slope.col(0) = linear * by_x + 2 * x * square * by_xx + y * product * by_xy;
  slope.col(1) = linear * by_y + 2 * y * square * by_yy + x * product * by_xy;
  return slope;
}

}  // namespace

Sight::Sight(const Observations& observations, const Rig& rig, const RigShift& shift,
             double min_cosine)
    : observations_(observations), rig_(rig), min_cosine_(min_cosine), pivot_mm_(shift.pivot_mm()) {
  for (const View& view : observations.views()) {
    Turned turned;
    turned.rig_from_object =
        rig.turntable.rig_from_object(observations.all()[view.begin].angle_rad);
    turned.camera_from_object = rig.cameras[view.camera].camera_from_rig * turned.rig_from_object;
    // p = c + R(x − c): a shift s of c moves p by (I − R)s; a tilt τ of the axis turns R by (I −
    // R)τ.
    turned.slip = shift.across() - turned.rig_from_object.rotation * shift.across();
    turned_.push_back(turned);
  }
  for (const Observation& seen : observations.all()) {
    const auto found =
        std::find_if(rig.displays.begin(), rig.displays.end(),
                     [&](const DisplayModel& d) { return d.name == seen.key.display; });
    display_.push_back(static_cast<std::size_t>(found - rig.displays.begin()));
  }
  for (const CameraModel& camera : rig.cameras) eyes_.push_back(camera.centre_rig_mm());
}

void Sight::look(const Vector3d& p, const Vector3d& about, double cone_rad,
                 std::vector<SightVote>& votes) const {
  votes.clear();
  const double cone2 = cone_rad * cone_rad;
  for (std::size_t k = 0; k < turned_.size(); ++k) {
    const View& view = observations_.views()[k];
    const Turned& turned = turned_[k];
    const CameraModel& camera = rig_.cameras[view.camera];
    const Vector3d p_camera = turned.camera_from_object * p;
    const auto pixel = camera.project(p_camera);
    if (!pixel) continue;
    std::optional<CameraModel::Projection> seen_at;
    const Matrix3d& turn = turned.rig_from_object.rotation;
    const Vector3d p_rig = turned.rig_from_object * p;
    const Vector3d to_eye = eyes_[view.camera] - p_rig;
    const double eye_mm = to_eye.norm();
    const Vector3d v = to_eye / eye_mm;
    for (std::size_t i = view.begin; i < view.end; ++i) {
      const Observation& seen = observations_.all()[i];
      const auto at = place_of(seen, *pixel);
      if (!at) continue;
      const auto uv_px = read(seen, *at);
      if (!uv_px) continue;
      const DisplayModel& display = rig_.displays[display_[i]];
      const bool is_turning = display.mount == Mount::turntable;
      const Vector3d q_mount = display.point_mm(uv_px->x(), uv_px->y());
      const Vector3d q = is_turning ? turned.rig_from_object * q_mount : q_mount;
      const Vector3d to_display = q - p_rig;
      const double display_mm = to_display.norm();
      const Vector3d l = to_display / display_mm;
      const Vector3d half = l + v;
      const double length = half.norm();
      if (!(length > 2 * min_cosine_)) continue;  // |l + v| = 2 n·v
      const Vector3d n = half / length;
      const Vector3d normal = turn.transpose() * n;
      if ((normal - about).squaredNorm() > cone2) continue;
      Matrix3d screen;  // columns: of the display in the rig frame
      screen << display.u_mm, display.v_mm, display.inward();
      if (is_turning) screen = turn * screen;
      if (!(to_display.dot(screen.col(2)) > 0)) continue;  // behind the display
      const auto slope = slope_of(seen, *at);
      if (!slope) continue;

      if (!seen_at) seen_at = camera.project_with_slope(p_camera);
      const Matrix3d outer = (Matrix3d::Identity() - n * n.transpose()) / length;
      const Matrix3d by_screen =
          outer * (Matrix3d::Identity() - l * l.transpose()) / display_mm;  // d n / d q
      const Matrix3d by_eye = outer * (Matrix3d::Identity() - v * v.transpose()) / eye_mm;
      const Matrix3d by_sight =  // d n / d (point in the camera frame), by what the pixel reads
          by_screen * screen.leftCols<2>() * *slope * seen_at->slope;
      const Matrix3d& rotation = camera.camera_from_rig.rotation;
      const Matrix3d by_point = by_sight * rotation - by_screen - by_eye;  // rig frame

      SightVote vote;
      vote.observation = i;
      vote.camera = view.camera;
      vote.display = display_[i];
      vote.normal = normal;
      // A point of the object moves with it; so does a display on the turntable, whose place in
      // the object frame stays.
      vote.by_point = turn.transpose() * by_point * turn;
      vote.by_camera.leftCols<3>() = turn.transpose() * (by_eye - by_sight * rotation);
      vote.by_camera.rightCols<3>() = -(turn.transpose() * by_sight * cross_of(p_camera));
      const Vector3d arm =
          q_mount - display.point_mm((display.width_px - 1) / 2.0, (display.height_px - 1) / 2.0);
      const Matrix3d by_mount =
          turn.transpose() * by_screen * (is_turning ? turn : Matrix3d(Matrix3d::Identity()));
      vote.by_display.leftCols<3>() = by_mount;
      vote.by_display.rightCols<3>() = -by_mount * cross_of(arm);
      Matrix3d by_slip = by_point, by_turn = cross_of(n) - by_point * cross_of(p_rig - pivot_mm_);
      if (is_turning) {
        by_slip += by_screen;
        by_turn -= by_screen * cross_of(q - pivot_mm_);
      }
      vote.by_axis.leftCols<2>() = turn.transpose() * by_slip * turned.slip;
      vote.by_axis.rightCols<2>() = turn.transpose() * by_turn * turned.slip;
      votes.push_back(vote);
    }
  }
}

}  // namespace alhazen
