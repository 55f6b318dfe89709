#pragma once

#include <cstdint>
#include <optional>

#include "alhazen/image.h"
#include "alhazen/pattern.h"
#include "alhazen/result.h"

namespace alhazen {

/// Device clocks are mapped to the host's with an error of this order; the frame before began at
/// least an exposure and a display's settling time earlier.
inline constexpr Micros kClockTolerance{500};

/// How long a frame may be on its way beyond its camera's own longest readout: scheduling of a
/// loaded machine.
inline constexpr Micros kReadoutAllowance{250'000};

/// Tells the frames of one camera that belong to the last trigger from old ones handed out again.
///
/// Two certain signs: the device's counter has not risen, or the exposure began before the trigger.
/// A third is only a suspicion: the pixels equal those of the frame before although another picture
/// was shown. A camera that does not see the display, or a pattern finer than the optics resolve,
/// gives equal pixels rightly where a sensor has no noise. So the suspicion asks for one retake; if
/// that is equal too, it is believed, and where white and black were equal the camera is blind to
/// this display: no more suspicion until the next stack. A camera frozen for longer passes, but
/// does no harm: pattern and inverse are equal then, and such bits decode to nothing.
///
/// Thread-bound.
class Freshness {
 public:
  /// Another display or stop: blindness is to be found out anew.
  void begin_stack() {
    blind_ = false;
    suspected_ = false;
  }
  /// The device was opened again: its counter may start anew.
  void forget() { last_.reset(); }

  /// What is wrong with `frame`, taken of `pattern` by a trigger at `triggered`; nothing: it is
  /// fresh and becomes the one before. Errors are `corrupt`.
  /// `checksum`: over its pixels.
  [[nodiscard]] std::optional<Error> judge(const Frame& frame, std::uint64_t checksum,
                                           const Pattern& pattern, Time triggered);

  /// Frames that were equal to the one before and confirmed so by a retake.
  [[nodiscard]] std::uint64_t confirmed_unchanged() const { return unchanged_; }

 private:
  struct Last {
    std::uint64_t counter = 0, checksum = 0;
    Pattern pattern;
  };
  std::optional<Last> last_;
  bool blind_ = false;      // to the display of this stack
  bool suspected_ = false;  // the last frame judged was refused for its pixels alone
  std::uint64_t unchanged_ = 0;
};

}  // namespace alhazen
