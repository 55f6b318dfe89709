#pragma once

#include <Eigen/Core>
#include <compare>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "alhazen/result.h"
#include "reconstruct/geometry/rig.h"
#include "reconstruct/options.h"
#include "reconstruct/scan/light_map.h"
#include "reconstruct/vote/clearance.h"
#include "reconstruct/vote/normal_view.h"
#include "reconstruct/vote/tiles.h"

namespace alhazen {

/// What voting keeps of one light map, cropped to where it knows something.
struct Observation {
  StackKey key;
  double angle_rad = 0;
  std::size_t camera = 0;            ///< of the rig
  Eigen::Vector3d origin_object_mm;  ///< the display at this stop, object frame
  Eigen::Vector3d u_object_mm, v_object_mm;
  Eigen::Vector3d inward_object;  ///< unit normal into the screen
  float noise_rad = 0;  ///< median standard deviation of a hypothesis by the map's own sigmas

  /// Mirror positions: the box of sensor pixels that holds all of them, and one bit per *cell* (the
  /// square between four pixels, named by the top left one): all four have a position and do not
  /// jump. Of each row the (u, v) pairs from the first to the last pixel of a cell, row after row:
  /// a display's reflection fills little of its box. Pixel (x, y) of the box has pair
  /// row_pair[y] + x, which is negative only where there is none.
  Region box;
  std::vector<std::uint32_t> cells;
  std::vector<float> uv_px;
  std::vector<std::int32_t> row_pair;
  Tiles tiles;  ///< of the cells: 1 where one is set

  Clearance sight;  ///< the pixels that see the display itself
  [[nodiscard]] std::size_t bytes() const noexcept;
};

/// All light maps and normal maps so far, in an order that does not depend on the order of arrival:
/// by stop, camera and display.
///
/// Thread: add() by one thread; reading is reentrant.
class Observations {
 public:
  /// Fails: invalid (options).
  Observations(Rig rig, const VoteOptions& options, const Eigen::Vector3d& centre_object_mm);

  /// Fails: invalid (camera or display not of the rig, region outside the sensor, lists of another
  /// length, a position that is not finite), conflict (this key came before).
  Status add(const LightMap& map);
  /// Fails: as make_normal_view(), conflict (this key came before), exhausted (more than 65535
  /// maps).
  Status add(const NormalMap& map);

  /// The same light maps as if `rig` had taken them: what is asked of a rig that may be wrong.
  /// Direct sight stays what it was taken for when the maps came. Fails: invalid (it lacks a camera
  /// or display, or a map is not within its sensor); nothing has
  ///        changed then.
  Status assume(Rig rig);

  [[nodiscard]] const Rig& rig() const noexcept { return rig_; }
  [[nodiscard]] const std::vector<Observation>& all() const noexcept { return observations_; }
  [[nodiscard]] std::size_t size() const noexcept { return observations_.size(); }
  [[nodiscard]] const std::vector<NormalView>& normal_views() const noexcept {
    return normal_views_;
  }
  /// Of both kinds.
  [[nodiscard]] std::size_t map_count() const noexcept {
    return observations_.size() + normal_views_.size();
  }
  /// Views in order, each with its run of all().
  [[nodiscard]] const std::vector<View>& views() const noexcept { return views_; }
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  void make_views();

  Rig rig_;
  VoteOptions options_;
  Eigen::Vector3d centre_object_mm_;
  std::vector<Observation> observations_;
  std::vector<View> views_;
  std::vector<NormalView> normal_views_;
};

}  // namespace alhazen
