#pragma once

#include <condition_variable>
#include <cstddef>
#include <list>
#include <mutex>
#include <optional>
#include <stop_token>
#include <utility>

#include "alhazen/check.h"

namespace alhazen {

/// Hands items from one thread to another, at most `capacity` waiting: who is faster waits, nothing
/// is ever dropped. Thread-safe.
template <class T>
class BoundedQueue {
 public:
  /// REQUIRES: capacity > 0.
  explicit BoundedQueue(std::size_t capacity) : capacity_(capacity) { ALHAZEN_CHECK(capacity > 0); }

  /// Waits for room. False, and the item is dropped, once `stop` is requested or the queue closed.
  [[nodiscard]] bool push(T item, std::stop_token stop) {
    std::unique_lock lock(mutex_);
    const bool room =
        room_.wait(lock, std::move(stop), [this] { return closed_ || items_.size() < capacity_; });
    if (!room || closed_) return false;
    items_.push_back(std::move(item));
    items_there_.notify_one();
    return true;
  }

  /// Waits for an item. Nothing once `stop` is requested, or the queue is closed and empty.
  [[nodiscard]] std::optional<T> pop(std::stop_token stop) {
    std::unique_lock lock(mutex_);
    const bool there =
        items_there_.wait(lock, std::move(stop), [this] { return closed_ || !items_.empty(); });
    if (!there || items_.empty()) return std::nullopt;
    std::list<T> taken;
    taken.splice(taken.begin(), items_, items_.begin());
    room_.notify_one();
    return std::move(taken.front());
  }

  /// No push from now on; pop() hands out what is left.
  void close() {
    {
      const std::scoped_lock lock(mutex_);
      closed_ = true;
    }
    room_.notify_all();
    items_there_.notify_all();
  }

  [[nodiscard]] std::size_t size() const {
    const std::scoped_lock lock(mutex_);
    return items_.size();
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable_any room_, items_there_;
  std::list<T> items_;
  const std::size_t capacity_;
  bool closed_ = false;
};

}  // namespace alhazen
