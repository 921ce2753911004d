#include <algorithm>

#include "drivers/signal/cycle_counter.h"
#include "drivers/signal/sampler_state.h"

namespace faultline {

const Sample* Sampler::State::take() noexcept {
  while (is_started) {
    CycleSlot* const slot = cycles.find(next);
    const bool complete = slot != nullptr && is_complete(*slot);
    if (!complete && !must_close()) return nullptr;
    if (is_skipped_at_start(complete)) continue;
    close(slot);
    return &sample;
  }
  return nullptr;
}

bool Sampler::State::must_close() const noexcept {
  // Without counters there is no telling frames of two cycles apart, so that only one is open.
  const std::int32_t lead = is_finished ? 0 : is_cycle_counted ? 2 : 1;
  return cycles_ahead(newest, next) >= lead;
}

/// Skips the next cycle if it is one of the first, and not complete.
bool Sampler::State::is_skipped_at_start(bool complete) noexcept {
  if (complete || next - joined_at >= kJoinCycles) is_joining = false;
  if (!is_joining) return false;
  ++next;
  ++counters.unstarted_cycles;
  return true;
}

bool Sampler::State::is_complete(const CycleSlot& slot) noexcept {
  return (slot.has_sync || !has_sync) && have_sensors_come(slot) && is_command_complete(slot);
}

bool Sampler::State::have_sensors_come(const CycleSlot& slot) const noexcept {
  if (slot.arrived_count == map.sensor_messages.size()) return true;
  if (!has_slow) return false;
  for (std::size_t i = 0; i < map.sensor_messages.size(); ++i) {
    if (slot.arrived[i] == 0 && is_due(i, slot.counter)) return false;
  }
  return true;
}

/// Whether the message's last value is too old for `cycle`, the next to close. Counted from its
/// last frame: a unit sends in cycles of its own choice.
bool Sampler::State::is_due(std::size_t sensor_message, std::uint32_t cycle) const noexcept {
  return has_come[sensor_message] == 0 ||
         cycle - came_in[sensor_message] >= map.sensor_messages[sensor_message].cycles_per_frame;
}

bool Sampler::State::is_command_complete(const CycleSlot& slot) noexcept {
  if (!is_command_known || map.command_messages.empty()) return true;
  if (!slot.has_sync) return false;
  if (slot.command_cycle == kNoCommand) return true;
  if (has_used_command && used_command == slot.command_cycle) return true;
  const CommandSlot* const command = commands.find(slot.command_cycle);
  return command != nullptr && command->arrived_count == map.command_messages.size();
}

/// Makes `sample` of the next cycle. `slot` is nullptr if nothing of that cycle came.
void Sampler::State::close(CycleSlot* slot) noexcept {
  y.begin();
  u.begin();
  sample.cycle = next++;
  sample.command_cycle = kNoCommand;
  sample.flags = pending_flags | (is_by_bus_order ? kSampleBusOrder : 0u);
  sample.stamp = last_stamp;
  sample.blame = pending_blame;
  pending_flags = 0;
  pending_blame = {};
  if (slot == nullptr) {
    sample.flags |= kSampleGap;
    if (sample.blame.fault == MessageFault::kNone) {
      sample.blame = {Blame::kNoMessage, MessageFault::kMissing};
    }
    for (std::size_t i = 0; i < map.sensor_messages.size(); ++i) {
      if (!is_due(i, sample.cycle)) continue;
      ++counters.missing_messages;
      watch.note_missing(i);
    }
    if (has_sync) {
      ++counters.missing_messages;
      watch.note_missing(sync_index());
    }
  } else {
    sample.flags |= slot->flags;
    if (sample.blame.fault == MessageFault::kNone) sample.blame = slot->blame;
    close_outputs(*slot);
    if (is_command_known) {
      close_inputs(*slot);
    } else {
      close_inputs_in_bus_order(*slot);
    }
    slot->is_used = false;
  }
  y.end(watch);
  u.end(watch);
  watch.end_sample();
  sample.y = y.values();
  sample.u = u.values();
  sample.y_is_fresh = y.is_fresh();
  sample.u_is_fresh = u.is_fresh();
  sample.y_age = y.age();
  sample.u_age = u.age();
  sample.y_state = y.state();
  sample.u_state = u.state();
  if (sample.is_good() || (sample.flags & kSampleReset) != 0) sample.blame = {};
  ++counters.samples;
  counters.bad_samples += sample.is_good() ? 0u : 1u;
}

void Sampler::State::close_outputs(const CycleSlot& slot) noexcept {
  y.take(slot.y, slot.y_known);
  if (has_sync && !slot.has_sync) {
    ++counters.missing_messages;
    watch.note_missing(sync_index());
    blame_missing(sync_index());
  }
  for (std::size_t i = 0; i < map.sensor_messages.size(); ++i) {
    if (slot.arrived[i] != 0) {
      has_come[i] = 1;
      came_in[i] = sample.cycle;
      continue;
    }
    if (!is_due(i, sample.cycle)) continue;
    sample.flags |= kSampleSensorMissing;
    ++counters.missing_messages;
    watch.note_missing(i);
    blame_missing(i);
  }
}

void Sampler::State::close_inputs(const CycleSlot& slot) noexcept {
  sample.command_cycle = slot.command_cycle;
  const bool is_whole = is_command_complete(slot);
  if (!is_whole) sample.flags |= kSampleCommandMissing;
  if (!slot.has_sync || map.command_messages.empty()) return;
  if (slot.command_cycle == kNoCommand) {
    u.take_zeros();
    has_used_command = false;
    return;
  }
  if (slot.command_cycle != sample.cycle - 1) mark_for_unused_answer(sample.cycle - 1);
  has_closed_command = true;
  closed_command = slot.command_cycle;
  CommandSlot* const command = commands.find(slot.command_cycle);
  if (!is_whole) {
    for (std::size_t i = 0; i < map.command_messages.size(); ++i) {
      if (command != nullptr && command->arrived[i] != 0) continue;
      watch.note_missing(command_index(i));
      if (command == nullptr || command->flags == 0) blame_missing(command_index(i));
    }
  }
  if (command == nullptr) {
    if (is_whole) u.keep_all();
    return;
  }
  sample.flags |= command->flags;
  if (sample.blame.fault == MessageFault::kNone) sample.blame = command->blame;
  // Told once: what came twice, or came good after all, has good values.
  command->flags &= ~(kSampleRepeated | kSampleChecksum | kSampleAliveGap);
  if (command->flags == 0) command->blame = {};
  u.take(command->u, command->u_known);
  has_used_command = command->arrived_count == map.command_messages.size() && command->flags == 0;
  used_command = slot.command_cycle;
}

/// The command that should act in this cycle does not, because the unit refused it, as we did: that
/// marks the sample, though it is known what acts.
void Sampler::State::mark_for_unused_answer(std::uint32_t counter) noexcept {
  CommandSlot* const command = commands.find(counter);
  if (command == nullptr || (command->flags & kBadSample) == 0) return;
  sample.flags |= command->flags;
  if (sample.blame.fault == MessageFault::kNone) sample.blame = command->blame;
  command->flags = 0;
  command->blame = {};
}

void Sampler::State::close_inputs_in_bus_order(const CycleSlot& slot) noexcept {
  const auto seen = static_cast<std::size_t>(
      std::count(command_seen.begin(), command_seen.end(), std::uint8_t{1}));
  if (seen > 0 && seen < map.command_messages.size()) {
    sample.flags |= kSampleCommandMissing;
    for (std::size_t i = 0; i < command_seen.size(); ++i) {
      if (command_seen[i] == 0) blame_missing(command_index(i));
    }
  }
  if (slot.arrived_count == 0) return;
  u.assign(slot.u, slot.u_is_fresh);
}

/// Blames a message that the sample lacks, unless another was first.
void Sampler::State::blame_missing(std::size_t message) noexcept {
  if (sample.blame.fault == MessageFault::kNone) {
    sample.blame = {message, watch.why_missing(message)};
  }
}

}  // namespace faultline
