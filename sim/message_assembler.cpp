#include "sim/message_assembler.h"

#include <algorithm>
#include <cassert>

#include "drivers/signal/cycle_counter.h"

namespace faultline {

MessageAssembler::MessageAssembler(const std::vector<MappedMessage>& messages,
                                   std::size_t channel_count)
    : messages_(&messages),
      has_come_(messages.size()),
      came_in_(messages.size()),
      newest_(channel_count) {
  integrity_.reserve(messages.size());
  for (const MappedMessage& message : messages) integrity_.emplace_back(message.protection);
  for (Slot& slot : slots_) {
    slot.seen.assign(messages.size(), 0);
    slot.is_due.assign(messages.size(), 0);
    slot.values.assign(channel_count, 0.0);
  }
}

void MessageAssembler::reset() noexcept {
  for (Slot& slot : slots_) slot.is_used = false;
  std::fill(has_come_.begin(), has_come_.end(), std::uint8_t{0});
  for (MessageIntegrity& integrity : integrity_) integrity.reset();
}

MessageAssembler::Slot& MessageAssembler::open(std::uint32_t counter) noexcept {
  Slot& slot = slots_[counter % kSlots];
  if (!slot.is_used || slot.counter != counter) {
    slot.is_used = true;
    slot.counter = counter;
    slot.missing = 0;
    std::fill(slot.seen.begin(), slot.seen.end(), std::uint8_t{0});
    for (std::size_t i = 0; i < messages_->size(); ++i) {
      slot.is_due[i] = is_due(i, counter) ? 1 : 0;
      slot.missing += slot.is_due[i];
    }
    // What is not due keeps its value; all else is overwritten before the counter is complete.
    std::copy(newest_.begin(), newest_.end(), slot.values.begin());
  }
  return slot;
}

bool MessageAssembler::is_due(std::size_t message, std::uint32_t counter) const noexcept {
  const std::uint32_t period = (*messages_)[message].cycles_per_frame;
  return period == 1 || has_come_[message] == 0 || (counter - came_in_[message]) % period == 0;
}

std::optional<std::uint32_t> MessageAssembler::push(const CanFrame& frame,
                                                    std::uint32_t near) noexcept {
  for (std::size_t i = 0; i < messages_->size(); ++i) {
    const MappedMessage& message = (*messages_)[i];
    if (!message.matches(frame)) continue;
    if (!is_usable(integrity_[i].check(frame).status)) {
      ++refused_frames_;
      return std::nullopt;
    }
    std::uint32_t counter = near;
    if (message.cycle) {
      std::int64_t low = 0;
      if (message.cycle->decode_raw(frame.payload(), low) != CodecStatus::kOk) return std::nullopt;
      counter = unwrap_cycle(static_cast<std::uint32_t>(low), message.cycle->bit_count(), near);
    }
    Slot& slot = open(counter);
    if (slot.seen[i] != 0) return std::nullopt;
    if (message.decode(frame, slot.values) != CodecStatus::kOk) return std::nullopt;
    slot.seen[i] = 1;
    // Far behind: the unit has started again.
    const std::int32_t ahead = cycles_ahead(counter, came_in_[i]);
    if (has_come_[i] == 0 || ahead > 0 || ahead < -static_cast<std::int32_t>(kSlots)) {
      has_come_[i] = 1;
      came_in_[i] = counter;
      for (const MappedSignal& mapped : message.channels) {
        newest_[mapped.channel] = slot.values[mapped.channel];
      }
    }
    // One that came unasked may find the counter complete: that was told before.
    if (slot.is_due[i] == 0) return std::nullopt;
    --slot.missing;
    return slot.missing == 0 ? std::optional(counter) : std::nullopt;
  }
  return std::nullopt;
}

std::span<const double> MessageAssembler::values(std::uint32_t counter) const noexcept {
  const Slot& slot = slots_[counter % kSlots];
  assert(slot.is_used && slot.counter == counter && slot.missing == 0);
  return slot.values;
}

}  // namespace faultline
