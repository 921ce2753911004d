#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/signal/message_integrity.h"
#include "drivers/signal/sample.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// What one mapped message did. Counters only grow (until the sampler's reset).
struct MessageCounters {
  IntegrityCounters integrity;   ///< of a protected message
  std::uint64_t missing = 0;     ///< samples that lacked it
  std::uint64_t late = 0;        ///< frames of a closed cycle
  std::uint64_t repeated = 0;    ///< frames that came twice in a cycle
  std::uint64_t too_short = 0;   ///< frames, with those of `integrity`
  std::uint64_t not_finite = 0;  ///< frames with a NaN or an infinity

  /// Frames whose alive counter or checksum found something.
  [[nodiscard]] bool is_integrity_clean() const noexcept {
    return integrity.bad_frames() == 0 && integrity.gaps == 0;
  }
};

/// Checks the frames of every mapped message and remembers for a while what it refused, so that a
/// missing value can say why. Messages are counted as in SignalMap::message_name. Does not allocate
/// after construction.
class MessageWatch {
 public:
  explicit MessageWatch(const SignalMap& map);

  /// Alive counter and checksum of a frame of `message`.
  IntegrityResult check(std::size_t message, const CanFrame& frame) noexcept {
    return watched_[message].integrity.check(frame);
  }
  /// A frame of `message` cannot be used, or does not belong where it came.
  void note(std::size_t message, MessageFault fault) noexcept;
  /// A sample lacks `message`.
  void note_missing(std::size_t message) noexcept { ++watched_[message].counters.missing; }
  /// A sample has closed.
  void end_sample() noexcept;
  void reset() noexcept;

  /// Why a sample lacks `message`: what the last refused frame did, if that was not long ago; else
  /// kMissing.
  [[nodiscard]] MessageFault why_missing(std::size_t message) const noexcept;
  [[nodiscard]] MessageCounters counters(std::size_t message) const noexcept;

 private:
  struct Watched {
    MessageIntegrity integrity;
    MessageCounters counters;  ///< without `integrity`
    MessageFault refusal = MessageFault::kNone;
    std::uint8_t refusal_left = 0;  ///< samples for which it explains
  };
  std::vector<Watched> watched_;
};

/// What the check of a frame says against it; kNone if its values may be used.
[[nodiscard]] MessageFault fault_of(IntegrityStatus status) noexcept;

/// State of a value that is held because of `why` (why_missing).
[[nodiscard]] SignalState held_state(MessageFault why, bool ever_came) noexcept;

}  // namespace faultline
