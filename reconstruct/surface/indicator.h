#pragma once

#include <vector>

namespace alhazen {

/// u per octree leaf (parallel to Octree::leaves()): 1 inside, 0 outside; the surface is u = ½.
struct Indicator {
  std::vector<float> u;
  double energy = 0;  ///< primal energy at the end
  double gap = 0;     ///< primal − dual energy: how far from the minimum at most
  int iterations = 0;
};

}  // namespace alhazen
