#include "daemon/capture/freshness.h"

#include <string>

namespace alhazen {
namespace {

bool is_plain(const Pattern& pattern) {
  return pattern.kind == PatternKind::white || pattern.kind == PatternKind::black;
}

}  // namespace

std::optional<Error> Freshness::judge(const Frame& frame, std::uint64_t checksum,
                                      const Pattern& pattern, Time triggered) {
  if (last_ && frame.device_counter <= last_->counter)
    return Error{Code::corrupt, "stale frame: the device's counter is " +
                                    std::to_string(frame.device_counter) + " after " +
                                    std::to_string(last_->counter)};
  if (frame.exposure_begin + kClockTolerance < triggered)
    return Error{Code::corrupt, "stale frame: its exposure began " +
                                    std::to_string((triggered - frame.exposure_begin).count()) +
                                    " us before the trigger"};
  const bool equal = last_ && !blind_ && checksum == last_->checksum && pattern != last_->pattern;
  if (equal && !suspected_) {
    suspected_ = true;
    return Error{Code::corrupt,
                 "stale frame suspected: its pixels equal those of the frame before although "
                 "another picture was shown"};
  }
  if (equal) {
    ++unchanged_;
    blind_ = is_plain(pattern) && is_plain(last_->pattern);
  }
  suspected_ = false;
  last_ = Last{frame.device_counter, checksum, pattern};
  return std::nullopt;
}

}  // namespace alhazen
