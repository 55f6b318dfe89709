#include "daemon/jobs/event_queue.h"

#include <sys/eventfd.h>
#include <unistd.h>

#include <utility>

#include "alhazen/check.h"

namespace alhazen {

EventQueue::EventQueue() : fd_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
  // Without descriptors nothing of the daemon can work.
  ALHAZEN_CHECK(fd_ >= 0);
}

EventQueue::~EventQueue() { close(fd_); }

void EventQueue::push(LaneEvent event) {
  {
    const std::scoped_lock lock(mutex_);
    if (auto* told = std::get_if<Told>(&event.what))
      for (auto waiting = waiting_.rbegin(); waiting != waiting_.rend(); ++waiting) {
        auto* before = std::get_if<Told>(&waiting->what);
        // Never past something else: an Ended must stay the last word of its job.
        if (before == nullptr) break;
        if (waiting->job != event.job || before->progress.stage != told->progress.stage) continue;
        *before = std::move(*told);
        return;
      }
    waiting_.push_back(std::move(event));
  }
  const std::uint64_t one = 1;
  // Fails only when the counter is full: then it is readable anyway.
  [[maybe_unused]] const auto written = write(fd_, &one, sizeof one);
}

std::vector<LaneEvent> EventQueue::take() {
  std::uint64_t count = 0;
  [[maybe_unused]] const auto drained = read(fd_, &count, sizeof count);
  const std::scoped_lock lock(mutex_);
  return std::exchange(waiting_, {});
}

}  // namespace alhazen
