#pragma once

#include <atomic>
#include <filesystem>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/base/bounded_queue.h"
#include "daemon/capture/capture.h"
#include "daemon/jobs/event_queue.h"
#include "daemon/jobs/lane.h"
#include "daemon/jobs/rig_room.h"
#include "reconstruct/options.h"
#include "reconstruct/scan/scan.h"

namespace alhazen {

/// How a reconstruction is done and where its results go.
struct ReconstructionChoices {
  std::optional<int> level;  ///< nothing: the manifest's
  Options options;
  std::vector<std::string> formats;  ///< besides ply: obj, stl
  std::filesystem::path output;      ///< folder of mesh.ply, report.json, report.html
  int threads = 1;                   ///< of the arena
};

/// A light map on its way to the compute lane. Without `map` it is read from the scan directory:
/// what lies there is as good, and memory stays bounded when reconstruction falls behind.
struct FedMap {
  StackKey key;
  std::shared_ptr<const LightMap> map;
};

/// A scan being taken (rig lane) and reconstructed (compute lane) at the same time. Made by the
/// control thread, shared by both lanes; each part says whose it is.
struct ScanWork {
  ScanWork(std::string job_id, std::filesystem::path scan_directory, const std::stop_source& wish,
           std::size_t stacks)
      : job(std::move(job_id)),
        directory(std::move(scan_directory)),
        stop(wish.get_token()),
        feed(stacks + 1) {}

  const std::string job;
  const std::filesystem::path directory;
  const std::stop_token stop;
  Hold hold;  ///< thread-safe

  // Constant once the lanes run.
  std::optional<Manifest> plan;  ///< of a scan that has no directory yet
  Rig rig;                       ///< likewise
  std::string job_record;        ///< first job.json
  CaptureOptions capture;
  ReconstructionChoices reconstruction;

  /// Room for every stack of the plan, so that the writer never waits for it.
  BoundedQueue<FedMap> feed;
  /// Maps that are carried in memory; beyond it they are read back.
  static constexpr std::size_t kMostCarried = 8;
  /// Every stack that can be had is in the feed. Set before the feed is closed.
  std::atomic<bool> complete{false};

  /// Set by the rig lane before it announces ScanOpened; from then on the compute lane reads light
  /// maps through it (const, reentrant) while the rig lane's writer commits.
  std::optional<Scan> scan;
};

/// The rig lane's part: makes or opens the directory, takes what is missing, feeds the compute
/// lane. Its answer is the body of Ended.
Ended run_capture(ScanWork& work, RigRoom& room, EventQueue& events, Lane& lane);

/// The compute lane's part: takes in light maps as they become safe, shows a preview mesh after
/// each stop, and once all are in writes mesh and report.
Ended run_scan_reconstruction(ScanWork& work, EventQueue& events, Lane& lane);

/// Reconstructs a finished scan directory again.
/// Fails: as Scan::open() and Reconstruction. Caller: compute lane.
Ended run_reconstruction(const std::string& job, const std::filesystem::path& scan_directory,
                         const ReconstructionChoices& choices, const std::string& job_record,
                         EventQueue& events, Lane& lane, std::stop_token stop);

}  // namespace alhazen
