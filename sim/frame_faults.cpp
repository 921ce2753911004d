#include "sim/frame_faults.h"

#include <algorithm>
#include <array>
#include <limits>

#include "drivers/signal/cycle_counter.h"
#include "sim/frame_damage.h"
#include "sim/injection_rule.h"

namespace faultline {
namespace {

using enum InjectionKind;

constexpr std::size_t kNoMessage = std::numeric_limits<std::size_t>::max();

/// The order in which they change a frame's bytes.
constexpr std::array kByteKinds{kFrozenCounter, kWrongCrc, kCorrupted, kWrongDlc};

/// Largest v of a kind that counts.
std::size_t most(InjectionKind kind) noexcept {
  return static_cast<std::size_t>(rule_of(kind).most);
}

}  // namespace

FrameFaults::FrameFaults(const SignalMap& map, const FaultSchedule& schedule, BenchNode node,
                         double sample_time_s)
    : map_(&map),
      schedule_(&schedule),
      node_(node),
      sample_time_s_(sample_time_s),
      delayed_(map.message_count() * (most(kDelayed) + 1)) {
  entries_.reserve(FaultSchedule::kMostEntries);
  waiting_.reserve(map.message_count() + 1);
  is_waiting_changed_.resize(map.message_count());
  follow_schedule();
}

FrameFaultCounters FrameFaults::counters() const noexcept {
  FrameFaultCounters counters = counters_;
  counters.dropped += delayed_.size() + (behind_next_ ? 1U : 0U);
  return counters;
}

std::size_t FrameFaults::most_frames() const noexcept {
  const std::size_t messages = map_->message_count() + 1;
  // Every frame with its duplicates, all that was ever held back, and all there is of babble.
  return messages * (most(kDelayed) + 2) + messages * most(kDuplicated) +
         messages * most(kBabbling);
}

// --- What of the timeline concerns this node.

bool FrameFaults::is_mine(std::size_t message) const noexcept {
  const std::size_t sensors = map_->sensor_messages.size();
  const std::size_t commands = map_->command_messages.size();
  const bool is_command = message >= sensors && message < sensors + commands;
  return is_command == (node_ == BenchNode::kController);
}

void FrameFaults::follow_schedule() noexcept {
  for (; followed_ < schedule_->size(); ++followed_) add_entry(followed_);
}

void FrameFaults::add_entry(std::size_t index) noexcept {
  const InjectionKind kind = schedule_->injection(index).kind;
  if (level_of(kind) == FaultLevel::kPlant) return;
  const FaultTarget& target = schedule_->target(index);
  Entry entry;
  entry.index = index;
  entry.kind = kind;
  bool is_ours = false;
  switch (target.kind) {
    case FaultTargetKind::kInput:
    case FaultTargetKind::kOutput: {
      const bool is_input = target.kind == FaultTargetKind::kInput;
      is_ours =
          find_signal(is_input, target.index, entry.message, entry.signal) &&
          (kind != kSwapped || find_signal(is_input, target.with, entry.with_message, entry.with));
      break;
    }
    case FaultTargetKind::kMessage:
      entry.message = target.index;
      is_ours = target.index < map_->message_count() && is_mine(target.index);
      if (is_ours && kind == kBabbling) is_ours = set_babble(target, entry);
      if (is_ours) entry.v = count_of(entry, target.index);
      break;
    case FaultTargetKind::kId:
      is_ours = set_babble(target, entry);
      entry.v = count_of(entry, kNoMessage);
      break;
    case FaultTargetKind::kNode:
      is_ours = (target.index == 1) == (node_ == BenchNode::kController);
      break;
    case FaultTargetKind::kComponent:
    case FaultTargetKind::kUnknown:
      break;
  }
  if (!is_ours || entries_.size() == entries_.capacity()) return;
  entries_.push_back(entry);
  may_withhold_ = may_withhold_ || level_of(kind) == FaultLevel::kFrame;
}

bool FrameFaults::find_signal(bool is_input, std::size_t channel, std::size_t& message,
                              const MappedSignal*& signal) const noexcept {
  if (is_input != (node_ == BenchNode::kController)) return false;
  const auto& messages = is_input ? map_->command_messages : map_->sensor_messages;
  for (std::size_t i = 0; i < messages.size(); ++i) {
    for (const MappedSignal& mapped : messages[i].channels) {
      if (mapped.channel != channel) continue;
      message = i + (is_input ? map_->sensor_messages.size() : 0);
      signal = &mapped;
      return true;
    }
  }
  return false;
}

/// The frame that babbles. @return whether this node is the one that does.
bool FrameFaults::set_babble(const FaultTarget& target, Entry& entry) const noexcept {
  CanFrame& frame = entry.babble;
  frame.length = kMaxClassicPayload;
  std::size_t message = kNoMessage;
  if (target.kind == FaultTargetKind::kId) {
    frame.id = static_cast<std::uint32_t>(target.index);
    frame.is_extended = frame.id > kMaxStandardId;
    message = message_of(frame);
    if (message == kNoMessage) {
      entry.is_heard = false;
      return node_ == BenchNode::kPlant;
    }
  } else {
    message = target.index;
  }
  const auto take_place_of = [&](const auto& mapped) {
    frame.id = mapped.id;
    frame.is_extended = mapped.is_extended;
    frame.is_fd = mapped.is_fd;
    frame.bus = mapped.bus;
  };
  const std::size_t sensors = map_->sensor_messages.size();
  const std::size_t channels = sensors + map_->command_messages.size();
  if (message < sensors) {
    take_place_of(map_->sensor_messages[message]);
  } else if (message < channels) {
    take_place_of(map_->command_messages[message - sensors]);
  } else {
    take_place_of(*map_->sync);
  }
  return is_mine(message);
}

/// What the entry counts: its value, or what it stands for without one.
std::size_t FrameFaults::count_of(const Entry& entry, std::size_t message) const noexcept {
  const std::optional<double>& value = schedule_->injection(entry.index).value;
  if (value) return static_cast<std::size_t>(*value);
  if (entry.kind != kWrongDlc) return 1;
  const std::size_t sensors = map_->sensor_messages.size();
  const std::size_t channels = sensors + map_->command_messages.size();
  const std::size_t length = message < sensors    ? map_->sensor_messages[message].length
                             : message < channels ? map_->command_messages[message - sensors].length
                                                  : map_->sync->length;
  return length > 0 ? length - 1 : 0;
}

std::size_t FrameFaults::message_of(const CanFrame& frame) const noexcept {
  const auto is_it = [&](const auto& message) {
    return message.id == frame.id && message.is_extended == frame.is_extended;
  };
  std::size_t index = 0;
  for (const MappedMessage& message : map_->sensor_messages) {
    if (is_it(message)) return index;
    ++index;
  }
  for (const MappedMessage& message : map_->command_messages) {
    if (is_it(message)) return index;
    ++index;
  }
  return map_->sync && is_it(*map_->sync) ? index : kNoMessage;
}

// --- The cycle.

void FrameFaults::begin_cycle(std::uint32_t k) noexcept {
  if (followed_ < schedule_->size()) follow_schedule();
  if (entries_.empty()) return;
  pass_waiting();
  cycle_ = k;
  t_s_ = static_cast<double>(k) * sample_time_s_;
  bool is_any_active = false;
  is_bus_off_ = false;
  for (Entry& entry : entries_) {
    entry.is_active = schedule_->activity(entry.index, t_s_) > 0.0;
    is_any_active = is_any_active || entry.is_active || entry.was_active;
    if (entry.kind == kBusOff && entry.is_active) is_bus_off_ = true;
  }
  is_acting_ = is_any_active || !delayed_.is_empty() || behind_next_.has_value();
  if (!is_acting_) return;
  const auto is_overdue = [&](const QueuedFrame& queued) {
    return cycles_ahead(k, queued.due) > 0;
  };
  delayed_.release(is_overdue, [&](const QueuedFrame& queued) { pass(queued); });
  babble();
}

void FrameFaults::babble() noexcept {
  if (is_bus_off_) return;
  for (Entry& entry : entries_) {
    if (entry.kind != kBabbling || !entry.is_active) continue;
    for (std::size_t n = 0; n < entry.v; ++n) {
      const std::uint64_t drawn = schedule_->draw(entry.index, t_s_, n);
      for (std::size_t byte = 0; byte < kMaxClassicPayload; ++byte) {
        entry.babble.data[byte] = static_cast<std::uint8_t>(drawn >> (8 * byte));
      }
      ++counters_.added;
      if (!entry.is_heard) ++unheard_;
      out_->send(entry.babble);
    }
  }
}

bool FrameFaults::take(const CanFrame& frame) noexcept {
  const std::size_t message = message_of(frame);
  if (message == kNoMessage) return out_->send(frame);
  // A frame of this message is there already, so that the others will not come any more.
  bool is_taken = true;
  if (waiting_frame(message) != nullptr) is_taken = pass_waiting();
  waiting_.push_back({.frame = frame, .message = message});
  for (const Entry& entry : entries_) {
    if (entry.kind != kSwapped || !entry.is_active) continue;
    const bool has_one = waiting_frame(entry.message) != nullptr;
    const bool has_other = waiting_frame(entry.with_message) != nullptr;
    if (has_one != has_other) return is_taken;
  }
  return pass_waiting() && is_taken;
}

/// Passes on what waits, changed as it is due. @return whether the bus took it.
bool FrameFaults::pass_waiting() noexcept {
  if (waiting_.empty()) return true;
  change_signals();
  bool is_taken = true;
  for (QueuedFrame& queued : waiting_) {
    change_bytes(queued);
    release_due(queued.message);
    is_taken = route(queued) && is_taken;
  }
  waiting_.clear();
  return is_taken;
}

// --- 1. Signals.

CanFrame* FrameFaults::waiting_frame(std::size_t message) noexcept {
  for (QueuedFrame& queued : waiting_) {
    if (queued.message == message) return &queued.frame;
  }
  return nullptr;
}

void FrameFaults::change_signals() noexcept {
  std::fill(is_waiting_changed_.begin(), is_waiting_changed_.end(), std::uint8_t{0});
  for (Entry& entry : entries_) {
    if (entry.signal == nullptr) continue;
    if (entry.kind == kSwapped) {
      if (entry.is_active) swap_signals(entry);
    } else {
      change_signal(entry);
    }
  }
  for (std::size_t message = 0; message < is_waiting_changed_.size(); ++message) {
    if (is_waiting_changed_[message] != 0) protect_waiting(message);
  }
}

void FrameFaults::change_signal(Entry& entry) noexcept {
  CanFrame* const frame = waiting_frame(entry.message);
  if (frame == nullptr) return;
  const bool begins = entry.is_active && !entry.was_active;
  entry.was_active = entry.is_active;
  if (!entry.is_active) return;
  double value = channel_value(*entry.signal, *frame);
  if (entry.kind == kFrozen) {
    if (begins) entry.frozen_value = value;
    value = entry.frozen_value;
  } else {
    value += schedule_->value(entry.index, t_s_);
  }
  set_channel_value(*entry.signal, value, *frame);
  is_waiting_changed_[entry.message] = 1;
}

void FrameFaults::swap_signals(const Entry& entry) noexcept {
  CanFrame* const one = waiting_frame(entry.message);
  CanFrame* const other = waiting_frame(entry.with_message);
  if (one == nullptr || other == nullptr) return;
  const double value = channel_value(*entry.signal, *one);
  const double other_value = channel_value(*entry.with, *other);
  set_channel_value(*entry.signal, other_value, *one);
  set_channel_value(*entry.with, value, *other);
  is_waiting_changed_[entry.message] = is_waiting_changed_[entry.with_message] = 1;
}

void FrameFaults::protect_waiting(std::size_t message) noexcept {
  CanFrame* const frame = waiting_frame(message);
  protect_again(map_->message_protection(message), *frame);
}

// --- 2. Bytes.

void FrameFaults::change_bytes(QueuedFrame& queued) noexcept {
  const CanFrame before = queued.frame;
  for (const InjectionKind kind : kByteKinds) {
    for (Entry& entry : entries_) {
      if (entry.kind == kind && entry.message == queued.message) change_by(entry, queued);
    }
  }
  const bool is_changed =
      is_waiting_changed_[queued.message] != 0 || !same_on_wire(before, queued.frame);
  if (is_changed) ++counters_.changed;
}

void FrameFaults::change_by(Entry& entry, QueuedFrame& queued) noexcept {
  const bool begins = entry.is_active && !entry.was_active;
  entry.was_active = entry.is_active;
  if (!entry.is_active) return;
  const MessageProtection& protection = map_->message_protection(queued.message);
  switch (entry.kind) {
    case kFrozenCounter:
      if (begins) entry.frozen_count = count_before(protection, queued.frame);
      if (entry.frozen_count) set_count(protection, *entry.frozen_count, queued.frame);
      break;
    case kWrongCrc:
      invert_checksum(protection, queued.frame);
      break;
    case kCorrupted:
      flip_bits(entry.v, queued.frame,
                [&](std::uint64_t n) { return schedule_->draw(entry.index, t_s_, n); });
      break;
    case kWrongDlc:
      set_length(entry.v, queued.frame);
      break;
    default:
      break;
  }
}

// --- 3. Way.

bool FrameFaults::route(QueuedFrame& queued) noexcept {
  std::size_t delay = 0;
  bool is_dropped = is_bus_off_;
  for (const Entry& entry : entries_) {
    if (!entry.is_active || entry.signal != nullptr || entry.message != queued.message) continue;
    if (entry.kind == kDropped) is_dropped = true;
    if (entry.kind == kDelayed) delay += entry.v;
    if (entry.kind == kReordered) queued.is_reordered = true;
    if (entry.kind == kDuplicated) queued.copies += static_cast<std::uint32_t>(entry.v);
  }
  if (is_dropped) {
    ++counters_.dropped;
    return true;
  }
  if (delay == 0) return pass(queued);
  queued.due = cycle_ + static_cast<std::uint32_t>(delay);
  if (!delayed_.push(queued)) ++counters_.dropped;
  return true;
}

void FrameFaults::release_due(std::size_t message) noexcept {
  if (delayed_.is_empty()) return;
  const auto is_due = [&](const QueuedFrame& queued) {
    return queued.message == message && cycles_ahead(cycle_, queued.due) >= 0;
  };
  delayed_.release(is_due, [&](const QueuedFrame& queued) { pass(queued); });
}

/// Sends it, or keeps it for behind the next one; what was kept before it goes out.
bool FrameFaults::pass(const QueuedFrame& queued) noexcept {
  if (is_bus_off_) {
    ++counters_.dropped;
    return true;
  }
  const bool was_delayed = queued.due != 0;
  if (was_delayed || queued.is_reordered) ++counters_.late;
  const std::optional<QueuedFrame> kept = behind_next_;
  behind_next_.reset();
  bool is_taken = true;
  if (queued.is_reordered) {
    behind_next_ = queued;
  } else {
    is_taken = put_out(queued);
  }
  return (!kept || put_out(*kept)) && is_taken;
}

bool FrameFaults::put_out(const QueuedFrame& queued) noexcept {
  bool is_taken = out_->send(queued.frame);
  for (std::uint32_t n = 0; n < queued.copies; ++n) {
    ++counters_.added;
    is_taken = out_->send(queued.frame) && is_taken;
  }
  return is_taken;
}

}  // namespace faultline
