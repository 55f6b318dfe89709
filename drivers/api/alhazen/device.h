#pragma once

#include <string>
#include <vector>

namespace alhazen {

/// One read-only figure a device reports about itself (packets lost, temperature, link speed).
struct Reading {
  std::string name;
  double value = 0;
  std::string unit;
  bool warn = false;  ///< an operator should look at it before the next scan
};

using Readings = std::vector<Reading>;

}  // namespace alhazen
