#include "daemon/jobs/lane.h"

#include <pthread.h>

#include <utility>

#include "alhazen/check.h"

namespace alhazen {

using std::chrono::steady_clock;

Lane::Lane(std::string name) : name_(std::move(name)), thread_([this] { run(); }) {}

Lane::~Lane() { inbox_.close(); }

void Lane::start(Work work) { ALHAZEN_CHECK(inbox_.push(std::move(work), std::stop_token())); }

void Lane::beat() noexcept {
  last_beat_.store(steady_clock::now().time_since_epoch().count(), std::memory_order_relaxed);
}

std::chrono::milliseconds Lane::silence() const noexcept {
  if (!busy_.load(std::memory_order_acquire)) return std::chrono::milliseconds(0);
  const steady_clock::duration since =
      steady_clock::now().time_since_epoch() -
      steady_clock::duration(last_beat_.load(std::memory_order_relaxed));
  return std::chrono::duration_cast<std::chrono::milliseconds>(since);
}

void Lane::run() {
  // At most 15 characters, for people with top -H.
  pthread_setname_np(pthread_self(), ("alhazen-" + name_).substr(0, 15).c_str());
  while (auto work = inbox_.pop(std::stop_token())) {
    beat();
    busy_.store(true, std::memory_order_release);
    (*work)();
    busy_.store(false, std::memory_order_release);
  }
}

}  // namespace alhazen
