#include "tools/lcm/frame_sequence.h"

#include <algorithm>

namespace faultline {

void FrameSequence::start_over() {
  held_.clear();
  last_.clear();
  given_up_.clear();
  is_started_ = false;
  announced_ = 0;
}

void FrameSequence::announce_end(std::int64_t message_count) {
  if (message_count <= kLargestNumber) announced_ = message_count;
}

bool FrameSequence::is_copy(const FrameBatch& batch) const noexcept {
  return std::any_of(last_.begin(), last_.end(), [&](const Delivered& known) {
    return known.sequence == batch.sequence && known.first_frame == batch.first_frame &&
           known.utime == batch.utime;
  });
}

bool FrameSequence::was_given_up(std::int64_t sequence) const noexcept {
  return std::any_of(given_up_.begin(), given_up_.end(), [sequence](const Range& range) {
    return sequence >= range.begin && sequence < range.end;
  });
}

void FrameSequence::restart_at(const FrameBatch& batch) {
  give_up();
  start_over();
  ++counters_.restarts;
  receiver_.on_restart();
  deliver(batch);
}

void FrameSequence::push(const FrameBatch& batch) {
  ++counters_.messages;
  const auto is_number = [](std::int64_t n) { return n >= 0 && n <= kLargestNumber; };
  if (!is_number(batch.sequence) || !is_number(batch.first_frame)) {
    ++counters_.malformed_messages;
    return;
  }
  counters_.malformed_frames += batch.malformed;
  if (!is_started_ || batch.sequence == next_sequence_) {
    deliver(batch);
    deliver_held_in_order();
  } else if (batch.sequence > next_sequence_) {
    const bool is_new = held_.emplace(batch.sequence, batch).second;
    if (!is_new) ++counters_.repeated_messages;
    if (held_.size() > kMostHeld) deliver_oldest_held();
  } else if (was_given_up(batch.sequence)) {
    ++counters_.late_messages;
  } else if (is_copy(batch)) {
    ++counters_.repeated_messages;
  } else {
    restart_at(batch);
  }
}

void FrameSequence::deliver(const FrameBatch& batch) {
  if (is_started_ && batch.first_frame < next_frame_) {
    // The messages go on, their frames do not: nothing that a single sender does.
    ++counters_.restarts;
    receiver_.on_restart();
  } else if (is_started_) {
    const FrameGap gap{.first_frame = next_frame_,
                       .frames = batch.first_frame - next_frame_,
                       .lost_messages = batch.sequence - next_sequence_};
    if (gap.lost_messages > 0) {
      given_up_.push_back({next_sequence_, batch.sequence});
      if (given_up_.size() > kMostHeld) given_up_.pop_front();
      counters_.lost_messages += static_cast<std::uint64_t>(gap.lost_messages);
    }
    counters_.missing_frames += static_cast<std::uint64_t>(gap.frames);
    if (gap.frames > 0 || gap.lost_messages > 0) receiver_.on_gap(gap);
  }
  is_started_ = true;
  next_sequence_ = batch.sequence + 1;
  next_frame_ = batch.first_frame + batch.frame_count;
  last_.push_back({batch.sequence, batch.first_frame, batch.utime});
  if (last_.size() > kMostHeld) last_.pop_front();
  receiver_.on_batch(batch);
}

void FrameSequence::deliver_held_in_order() {
  while (!held_.empty() && held_.begin()->first == next_sequence_) deliver_oldest_held();
}

void FrameSequence::deliver_oldest_held() {
  const auto oldest = held_.extract(held_.begin());
  deliver(oldest.mapped());
  deliver_held_in_order();
}

void FrameSequence::give_up() {
  while (!held_.empty()) deliver_oldest_held();
  if (!is_waiting()) return;
  // How many frames were in them nobody knows.
  const FrameGap gap{.first_frame = next_frame_, .lost_messages = announced_ - next_sequence_};
  counters_.lost_messages += static_cast<std::uint64_t>(gap.lost_messages);
  given_up_.push_back({next_sequence_, announced_});
  if (given_up_.size() > kMostHeld) given_up_.pop_front();
  next_sequence_ = announced_;
  receiver_.on_gap(gap);
}

}  // namespace faultline
