#include "drivers/sim/faults.h"

namespace alhazen::sim {

std::optional<FaultRule> Faults::next(const std::string& device, const std::string& call) {
  const std::int64_t of_all = ++calls_[{device, ""}];
  const std::int64_t of_name = ++calls_[{device, call}];
  for (const FaultRule& rule : rules_) {
    if (rule.device != device || (!rule.on.empty() && rule.on != call)) continue;
    const std::int64_t count = rule.on.empty() ? of_all : of_name;
    if (rule.once ? count == rule.call : count >= rule.call) return rule;
  }
  return std::nullopt;
}

}  // namespace alhazen::sim
