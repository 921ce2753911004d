#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <utility>

#include "tools/lcm/frame_message.h"

namespace faultline {

/// What was wrong with FAULTLINE_CAN messages as they came. Counters only grow.
struct FrameSequenceCounters {
  std::uint64_t messages = 0;       ///< that came
  std::uint64_t lost_messages = 0;  ///< of which the numbers tell that they never came
  std::uint64_t missing_frames =
      0;  ///< lost with messages, or already missing where they were sent
  std::uint64_t malformed_frames = 0;    ///< that no bus could have carried
  std::uint64_t malformed_messages = 0;  ///< whose numbers nobody can have counted to; not used
  std::uint64_t late_messages = 0;       ///< came when they had been given up; not used
  std::uint64_t repeated_messages = 0;   ///< came twice; used once
  std::uint64_t restarts = 0;            ///< the numbers began again
};

/// Frames that are missing before the next batch.
struct FrameGap {
  std::int64_t first_frame = 0;  ///< number of the first one
  std::int64_t frames = 0;
  std::int64_t lost_messages = 0;  ///< 0: they were dropped before they were sent
};

/// FAULTLINE_CAN messages in the order of their numbers, whatever order they came in.
///
/// LCM over UDP may lose or swap messages and never says so: `sequence` tells of messages, and
/// `first_frame` of frames. A message whose predecessor is missing is held until that comes, or
/// until kMostHeld are held, or `give_up`. A message that goes back behind what has been handed on,
/// and is neither late nor a copy, begins the numbers anew: a playback in a loop, a new sender.
class FrameSequence {
 public:
  static constexpr std::size_t kMostHeld = 16;
  /// A sender that counts from 0 does not get there; keeps differences far from overflow.
  static constexpr std::int64_t kLargestNumber = std::int64_t{1} << 60;

  struct Receiver {
    std::function<void(const FrameBatch&)> on_batch;
    std::function<void(const FrameGap&)> on_gap;
    std::function<void()> on_restart;  ///< before the first batch of the new numbers
  };

  explicit FrameSequence(Receiver receiver) : receiver_(std::move(receiver)) {}

  void push(const FrameBatch& batch);
  /// The sender says that so many messages were all: those that are missing at the end are, too.
  void announce_end(std::int64_t message_count);
  /// What is missing will not come any more: hands on what is held.
  void give_up();
  /// The next message begins the numbers, whatever they are.
  void start_over();

  /// Something is missing that may still come.
  [[nodiscard]] bool is_waiting() const noexcept {
    return !held_.empty() || (is_started_ && next_sequence_ < announced_);
  }
  [[nodiscard]] const FrameSequenceCounters& counters() const noexcept { return counters_; }

 private:
  struct Delivered {
    std::int64_t sequence, first_frame, utime;
  };
  struct Range {
    std::int64_t begin, end;
  };

  void deliver(const FrameBatch& batch);
  void deliver_held_in_order();
  void deliver_oldest_held();
  void restart_at(const FrameBatch& batch);
  [[nodiscard]] bool is_copy(const FrameBatch& batch) const noexcept;
  [[nodiscard]] bool was_given_up(std::int64_t sequence) const noexcept;

  Receiver receiver_;
  FrameSequenceCounters counters_;
  bool is_started_ = false;
  std::int64_t next_sequence_ = 0, next_frame_ = 0;
  std::int64_t announced_ = 0;  ///< messages in all; 0: not known
  std::map<std::int64_t, FrameBatch> held_;
  std::deque<Delivered> last_;  ///< the last ones handed on, at most kMostHeld
  std::deque<Range> given_up_;  ///< the last gaps, at most kMostHeld
};

}  // namespace faultline
