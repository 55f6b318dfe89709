#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "drivers/sim/scene.h"

namespace alhazen::sim {

/// Decides which call of which device misbehaves. Calls are counted from 1, over the device's whole
/// life, through every closing and opening. Thread-bound (World holds its lock).
class Faults {
 public:
  explicit Faults(std::vector<FaultRule> rules) : rules_(std::move(rules)) {}

  /// Counts one call; the fault that befalls it, if any.
  [[nodiscard]] std::optional<FaultRule> next(const std::string& device, const std::string& call);

 private:
  std::vector<FaultRule> rules_;
  std::map<std::pair<std::string, std::string>, std::int64_t> calls_;  // ("", "call") counts all
};

}  // namespace alhazen::sim
