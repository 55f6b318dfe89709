#pragma once

#include <cstdint>
#include <memory>
#include <stop_token>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "alhazen/image.h"
#include "daemon/base/bounded_queue.h"
#include "daemon/capture/capture.h"

namespace alhazen {

/// A frame that was accepted, or refused on the way to it.
struct Shot {
  int camera = 0;  ///< index into the plan's cameras
  Frame frame;
  std::uint64_t checksum = 0;  ///< XXH3-64 of the pixels
  int attempt = 1;
};

/// From now on frames of this stack set come (one display at one stop); what was unfinished of an
/// earlier one is dropped.
struct StackStart {
  int stop = 0, display = 0;
  double angle_rad = 0;      ///< measured
  std::vector<int> cameras;  ///< indices into the plan's cameras
};

/// One capture: complete, a frame of every camera of the stack set that has not become a gap; or
/// what was refused alone, where the step has failed.
struct ShotSet {
  Step step;
  std::vector<Shot> shots;
  std::vector<Shot> refused;  ///< retaken frames; kept on disk only with KeepFrames::failed or all
};

/// The stack set is complete: its light maps are to be made safe.
struct StackEnd {};

using WriterItem = std::variant<StackStart, ShotSet, StackEnd>;

/// The writer: a thread that stores frames, feeds one decoder a camera and commits light maps. It
/// is the only one that writes to the scan while it runs.
///
/// Thread: push() and finish() belong to the sequencer's thread.
class Writer {
 public:
  /// `failed` is asked to stop when the writer cannot go on. Everything given must outlive it.
  Writer(Scan& scan, const CaptureOptions& options, Hold& hold, const CaptureHooks& hooks,
         std::stop_token stop, std::stop_source failed);
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer();

  /// Waits while the queue is full. False once `stop` is requested or the writer has failed.
  [[nodiscard]] bool push(WriterItem item, std::stop_token stop);

  /// Nothing follows: commits what is complete, ends the thread. Fails: as the first that failed.
  Status finish();
  /// After finish().
  [[nodiscard]] std::uint64_t committed() const noexcept { return committed_; }

 private:
  struct Stack;  // the running stack set
  void run();
  Status handle(StackStart start);
  Status handle(ShotSet set);
  Status handle(StackEnd end);
  /// Runs `save` until the disk has room for it: meanwhile the capture is held.
  template <class Save>
  auto with_room(Save save) -> decltype(save());

  Scan& scan_;
  const CaptureOptions options_;
  Hold& hold_;
  const CaptureHooks& hooks_;
  const std::stop_token stop_;
  std::stop_source failed_;
  BoundedQueue<WriterItem> queue_;
  std::unique_ptr<Stack> stack_;
  Status outcome_;
  std::uint64_t committed_ = 0;
  std::thread thread_;
};

}  // namespace alhazen
