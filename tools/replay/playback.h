#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "tools/bench/latency_histogram.h"
#include "tools/replay/playback_log.h"
#include "tools/replay/playback_target.h"

namespace faultline {

struct PlaybackOptions {
  double speed = 1.0;        ///< 2: twice as fast; 0: as fast as the target takes it
  std::uint64_t passes = 1;  ///< 0: for ever
};

/// How far a playback is, for those who watch it.
struct PlaybackProgress {
  double at_s = 0.0;       ///< since the begin of the log
  std::uint64_t sent = 0;  ///< frames or messages
  std::uint64_t pass = 1;
  double silence_s = 0.0;  ///< how long it still has to wait for the next
};

/// What a playback came to.
struct PlaybackResult {
  /// Time of each send, taken directly before the call, less its deadline. Not of speed 0.
  LatencyHistogram lateness;
  std::uint64_t late = 0;  ///< sends more than kLate behind their deadline
  std::uint64_t sent = 0, refused = 0;
  std::uint64_t passes = 0;  ///< that came to their end
  double wall_s = 0.0;
  int signal = 0;                              ///< that stopped it; 0: none
  std::vector<std::string> realtime_problems;  ///< why its timing is not as good as it might be

  static constexpr std::chrono::nanoseconds kLate = std::chrono::milliseconds(1);
};

/// Plays a log at absolute deadlines: first stamp + (stamp - first stamp) / speed, never a sum of
/// sleeps, so that nothing adds up. A thread of its own reads ahead and prepares; the one that
/// sends only sleeps and sends (SCHED_FIFO, memory locked and CPUs awake where that is permitted).
/// A send that is late does not move the others. SIGINT and SIGTERM end it.
/// @param on_progress called about ten times a second, on the calling thread
/// @throws std::system_error the log cannot be read any more.
[[nodiscard]] PlaybackResult play(const PlaybackLog& log, PlaybackTarget& target,
                                  const PlaybackOptions& options,
                                  const std::function<void(const PlaybackProgress&)>& on_progress);

/// The same step by step: sends `ask()` groups (frames or messages of one time), then asks again,
/// until that says 0 or the log ends.
/// @param on_group called after each group
[[nodiscard]] PlaybackResult play_stepwise(
    const PlaybackLog& log, PlaybackTarget& target, const PlaybackOptions& options,
    const std::function<std::uint64_t()>& ask,
    const std::function<void(const PlaybackProgress&)>& on_group);

}  // namespace faultline
