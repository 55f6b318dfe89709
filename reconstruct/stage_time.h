#pragma once

#include <chrono>
#include <ctime>
#include <string>
#include <utility>

namespace alhazen {

/// CPU and wall time of one stage.
struct StageTime {
  std::string stage;
  double cpu_s = 0, wall_s = 0;
};

/// Times since it was made. CPU time is the whole process's: inside the daemon it includes what
/// other lanes did meanwhile.
class StageClock {
 public:
  [[nodiscard]] StageTime read(std::string stage) const {
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - wall_;
    return {std::move(stage), cpu_now_s() - cpu_s_, wall.count()};
  }

 private:
  [[nodiscard]] static double cpu_now_s() {
    timespec now{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }
  std::chrono::steady_clock::time_point wall_ = std::chrono::steady_clock::now();
  double cpu_s_ = cpu_now_s();
};

}  // namespace alhazen
