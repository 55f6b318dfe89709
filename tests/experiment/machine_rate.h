#pragma once

namespace alhazen::experiment {

/// What one core of this machine can do at most, by loops that do nothing else, with the widest
/// vectors it has; CPU time.
struct MachineRate {
  double flops_per_s = 0;    ///< single precision; a fused multiply-add counts as two
  double gathers_per_s = 0;  ///< 4-byte elements from a table that fits the second-level cache
};
[[nodiscard]] MachineRate machine_rate();

}  // namespace alhazen::experiment
