#include "drivers/signal/sampler.h"

#include <algorithm>

#include "drivers/signal/cycle_counter.h"
#include "drivers/signal/sampler_state.h"

namespace faultline {
namespace {

/// True if every message of one side has a counter.
bool all_counted(const std::vector<MappedMessage>& messages) noexcept {
  return std::all_of(messages.begin(), messages.end(),
                     [](const MappedMessage& message) { return message.cycle.has_value(); });
}

}  // namespace

Sampler::State::State(const SignalMap& signal_map)
    : map(signal_map),
      has_sync(map.sync.has_value()),
      is_cycle_counted(has_sync || all_counted(map.sensor_messages)),
      is_command_known(map.command_messages.empty() ||
                       (has_sync && map.sync->command_cycle && all_counted(map.command_messages))),
      is_by_bus_order(!has_sync || !is_command_known || !all_counted(map.sensor_messages)),
      has_slow(
          std::any_of(map.sensor_messages.begin(), map.sensor_messages.end(),
                      [](const MappedMessage& message) { return message.cycles_per_frame > 1; })),
      watch(map),
      has_come(map.sensor_messages.size()),
      came_in(map.sensor_messages.size()),
      cycles(map),
      commands(map),
      newest_u(map.input_names.size()),
      newest_u_is_fresh(map.input_names.size()),
      command_seen(map.command_messages.size()),
      y(map.sensor_messages, 0, map.output_names.size()),
      u(map.command_messages, command_index(0), map.input_names.size()) {}

void Sampler::State::clear() noexcept {
  is_started = is_joining = is_finished = false;
  has_used_command = has_closed_command = false;
  next = newest = joined_at = pending_flags = newest_command_flags = 0;
  pending_blame = newest_command_blame = {};
  last_stamp = {};
  cycles.clear();
  commands.clear();
  std::fill(has_come.begin(), has_come.end(), std::uint8_t{0});
  watch.reset();
  std::fill(newest_u.begin(), newest_u.end(), 0.0);
  std::fill(newest_u_is_fresh.begin(), newest_u_is_fresh.end(), std::uint8_t{0});
  std::fill(command_seen.begin(), command_seen.end(), std::uint8_t{0});
  y.reset();
  u.reset();
  counters = {};
}

void Sampler::State::push(const CanFrame& frame) noexcept {
  if (is_finished) {
    ++counters.ignored_frames;
    return;
  }
  last_stamp = frame.stamp;
  const auto check = [&](std::size_t message) {
    const IntegrityStatus status = watch.check(message, frame).status;
    return CheckedFrame{frame, message, fault_of(status), status == IntegrityStatus::kCounterGap};
  };
  if (map.sync && map.sync->matches(frame)) return push_sync(check(sync_index()));
  const auto matches = [&](const MappedMessage& message) { return message.matches(frame); };
  const auto& sensors = map.sensor_messages;
  if (const auto found = std::find_if(sensors.begin(), sensors.end(), matches);
      found != sensors.end()) {
    const auto index = static_cast<std::size_t>(found - sensors.begin());
    return push_sensor(index, check(index));
  }
  const auto& command_messages = map.command_messages;
  if (const auto found = std::find_if(command_messages.begin(), command_messages.end(), matches);
      found != command_messages.end()) {
    const auto index = static_cast<std::size_t>(found - command_messages.begin());
    const CheckedFrame checked = check(command_index(index));
    return is_command_known ? push_command(index, checked)
                            : note_command_in_bus_order(index, checked);
  }
  ++counters.ignored_frames;
}

void Sampler::State::push_sync(const CheckedFrame& checked) noexcept {
  if (is_discarded(checked, true)) return;
  const std::span<const std::uint8_t> payload = checked.frame.payload();
  std::int64_t k = 0;
  std::int64_t c_k = kNoCommand;
  const bool has_k = map.sync->cycle.decode_raw(payload, k) == CodecStatus::kOk;
  const bool has_c_k = !map.sync->command_cycle ||
                       map.sync->command_cycle->decode_raw(payload, c_k) == CodecStatus::kOk;
  if (!has_k || !has_c_k) {
    return mark_pending(kSampleShortPayload, checked, MessageFault::kTooShort);
  }
  const bool is_used = checked.fault == MessageFault::kNone;
  const auto cycle = static_cast<std::uint32_t>(k);
  if (!advance_to(cycle, is_used, checked)) return;
  CycleSlot& slot = cycles.open(cycle);
  if (slot.has_sync) return mark(slot, kSampleRepeated, checked, MessageFault::kRepeated);
  if (!is_used) return mark(slot, kSampleChecksum, checked, checked.fault);
  slot.has_sync = true;
  slot.command_cycle = static_cast<std::uint32_t>(c_k);
  slot.flags |= checked.is_after_gap ? kSampleAliveGap : 0u;
}

void Sampler::State::push_sensor(std::size_t index, const CheckedFrame& checked) noexcept {
  const MappedMessage& message = map.sensor_messages[index];
  if (is_discarded(checked, message.cycle.has_value())) return;
  const bool is_used = checked.fault == MessageFault::kNone;
  std::uint32_t cycle = 0;
  if (!find_sensor_cycle(index, checked, cycle) ||
      !advance_to(cycle, !has_sync && is_used, checked)) {
    return;
  }
  CycleSlot& slot = cycles.open(cycle);
  if (slot.arrived[index] != 0) {
    return mark(slot, kSampleRepeated, checked, MessageFault::kRepeated);
  }
  if (!is_used) {
    slot.refused[index] = 1;
    return mark(slot, kSampleChecksum, checked, checked.fault);
  }
  if (!is_command_known && slot.arrived_count == 0) {
    slot.u = newest_u;
    slot.u_is_fresh = newest_u_is_fresh;
    slot.flags |= newest_command_flags;
    if (slot.blame.fault == MessageFault::kNone) slot.blame = newest_command_blame;
    newest_command_flags = 0;
    newest_command_blame = {};
    std::fill(newest_u_is_fresh.begin(), newest_u_is_fresh.end(), std::uint8_t{0});
  }
  slot.arrived[index] = 1;
  ++slot.arrived_count;
  decode(message, checked, slot.y, slot.y_known, slot.flags, slot.blame);
}

void Sampler::State::push_command(std::size_t index, const CheckedFrame& checked) noexcept {
  if (!is_started) {
    ++counters.ignored_frames;
    return;
  }
  if (is_discarded(checked, true)) return;
  const SignalCodec& codec = *map.command_messages[index].cycle;
  std::int64_t low_bits = 0;
  if (codec.decode_raw(checked.frame.payload(), low_bits) != CodecStatus::kOk) {
    return mark_pending(kSampleShortPayload, checked, MessageFault::kTooShort);
  }
  const std::uint32_t counter =
      unwrap_cycle(static_cast<std::uint32_t>(low_bits), codec.bit_count(), newest);
  const bool is_closed = has_closed_command && cycles_ahead(counter, closed_command) <= 0;
  CommandSlot* const known = commands.find(counter);
  if (known == nullptr && (is_closed || commands.is_overtaken(counter))) {
    return mark_pending(kSampleLate, checked, MessageFault::kLate);
  }
  CommandSlot& slot = known != nullptr ? *known : commands.open(counter);
  if (slot.arrived[index] != 0) {
    if (is_closed) return mark_pending(kSampleRepeated, checked, MessageFault::kRepeated);
    return mark(slot, kSampleRepeated, checked, MessageFault::kRepeated);
  }
  if (checked.fault != MessageFault::kNone) {
    // The sample in which it should act, or where that has closed the next one.
    if (cycles_ahead(next, counter) > 1) {
      return mark_pending(kSampleChecksum, checked, checked.fault);
    }
    return mark(slot, kSampleChecksum, checked, checked.fault);
  }
  slot.arrived[index] = 1;
  ++slot.arrived_count;
  decode(map.command_messages[index], checked, slot.u, slot.u_known, slot.flags, slot.blame);
}

void Sampler::State::note_command_in_bus_order(std::size_t index,
                                               const CheckedFrame& checked) noexcept {
  if (checked.fault == MessageFault::kTooShort || checked.fault == MessageFault::kNone) {
    command_seen[index] = 1;
  }
  if (checked.fault != MessageFault::kNone) {
    const bool is_short = checked.fault == MessageFault::kTooShort;
    return mark(newest_command_flags, newest_command_blame,
                is_short ? kSampleShortPayload : kSampleChecksum, checked, checked.fault);
  }
  decode(map.command_messages[index], checked, newest_u, newest_u_is_fresh, newest_command_flags,
         newest_command_blame);
}

/// True if the frame's check leaves nothing of it to look at; then it is counted and has marked the
/// next sample. Without a checksum that is right its cycle is not known, if it carries one.
bool Sampler::State::is_discarded(const CheckedFrame& checked, bool is_cycle_needed) noexcept {
  if (checked.fault == MessageFault::kNone) return false;
  if (!is_started) {
    ++counters.ignored_frames;
    return true;
  }
  if (checked.fault == MessageFault::kTooShort) {
    mark_pending(kSampleShortPayload, checked, checked.fault);
    return true;
  }
  if (checked.fault != MessageFault::kWrongCrc || !is_cycle_needed) return false;
  mark_pending(kSampleChecksum, checked, checked.fault);
  return true;
}

/// Marks a sample for what a frame did, and counts that.
void Sampler::State::mark(std::uint32_t& flags, Blame& blame, std::uint32_t flag,
                          const CheckedFrame& checked, MessageFault fault) noexcept {
  flags |= flag;
  if (blame.fault == MessageFault::kNone) blame = {checked.message, fault};
  note(checked, fault);
}

void Sampler::State::note(const CheckedFrame& checked, MessageFault fault) noexcept {
  switch (fault) {
    case MessageFault::kLate:
      ++counters.late_frames;
      break;
    case MessageFault::kRepeated:
      ++counters.repeated_frames;
      break;
    case MessageFault::kTooShort:
      ++counters.short_frames;
      break;
    case MessageFault::kNotFinite:
      ++counters.not_finite_frames;
      break;
    case MessageFault::kWrongCrc:
    case MessageFault::kCounterRepeated:
    case MessageFault::kCounterOutOfRange:
      ++counters.refused_frames;
      break;
    case MessageFault::kNone:
    case MessageFault::kMissing:
    case MessageFault::kCounterGap:
      break;
  }
  watch.note(checked.message, fault);
}

/// Decodes the channels of `message`, marks them as known and the sample for what is wrong.
void Sampler::State::decode(const MappedMessage& message, const CheckedFrame& checked,
                            std::span<double> values, std::span<std::uint8_t> known,
                            std::uint32_t& flags, Blame& blame) noexcept {
  switch (message.decode(checked.frame, values)) {
    case CodecStatus::kPayloadTooShort:
      return mark(flags, blame, kSampleShortPayload, checked, MessageFault::kTooShort);
    case CodecStatus::kNotANumber:
      return mark(flags, blame, kSampleNotFinite, checked, MessageFault::kNotFinite);
    case CodecStatus::kOk:
    case CodecStatus::kOutOfRange:
      break;
  }
  for (const MappedSignal& mapped : message.channels) known[mapped.channel] = 1;
  if (!checked.is_after_gap) return;
  flags |= kSampleAliveGap;
  if (!message.cycle) mark(flags, blame, kSampleChecksum, checked, MessageFault::kCounterGap);
}

/// The cycle a sensor frame is of. @return false if that cannot be told; then it is counted.
bool Sampler::State::find_sensor_cycle(std::size_t index, const CheckedFrame& checked,
                                       std::uint32_t& cycle) noexcept {
  if (has_sync && !is_started) {
    ++counters.ignored_frames;
    return false;
  }
  const auto& codec = map.sensor_messages[index].cycle;
  if (!is_cycle_counted) {
    // We count: a message that comes again, or after its cycle has closed, begins the next cycle.
    const CycleSlot* const slot = is_started ? cycles.find(newest) : nullptr;
    const bool came_before =
        slot != nullptr && (slot->arrived[index] != 0 || slot->refused[index] != 0);
    const bool is_next = is_started && (cycles_ahead(next, newest) > 0 || came_before);
    cycle = is_next ? newest + 1 : newest;
    return true;
  }
  if (!codec) {
    cycle = newest;
    return true;
  }
  std::int64_t low_bits = 0;
  if (codec->decode_raw(checked.frame.payload(), low_bits) != CodecStatus::kOk) {
    mark_pending(kSampleShortPayload, checked, MessageFault::kTooShort);
    return false;
  }
  const std::uint32_t bits = std::min<std::uint32_t>(codec->bit_count(), 32);
  const std::uint32_t near = is_started ? newest : 1u << (bits - 1);  // the first: 0 .. 2^bits - 1
  cycle = unwrap_cycle(static_cast<std::uint32_t>(low_bits), bits, near);
  return true;
}

/// Makes `cycle` the newest if it is newer; starts or resets if it must.
/// @return false if the frame has no place: its cycle is closed or out of reach. Then it is
/// counted.
bool Sampler::State::advance_to(std::uint32_t cycle, bool may_reset,
                                const CheckedFrame& checked) noexcept {
  if (!is_started) {
    start_at(cycle);
    return true;
  }
  const std::int32_t step = cycles_ahead(cycle, newest);
  const bool is_far =
      step > static_cast<std::int32_t>(kMaxGap) || step < -static_cast<std::int32_t>(kMaxBack);
  if (is_far && may_reset) {
    ++counters.resets;
    start_at(cycle);
    pending_flags = kSampleReset;
    pending_blame = {};
    return true;
  }
  if (is_far && step > 0) {
    ++counters.ignored_frames;
    return false;
  }
  if (cycles_ahead(cycle, next) < 0 && is_joining) {
    ++counters.ignored_frames;  // of a cycle that began before we listened
    return false;
  }
  if (cycles_ahead(cycle, next) < 0) {
    mark_pending(kSampleLate, checked, MessageFault::kLate);
    return false;
  }
  if (step > 0) newest = cycle;
  return true;
}

/// Drops what is open and begins at `cycle`.
void Sampler::State::start_at(std::uint32_t cycle) noexcept {
  cycles.clear();
  commands.clear();
  std::fill(has_come.begin(), has_come.end(), std::uint8_t{0});
  is_started = true;
  is_joining = true;
  has_used_command = has_closed_command = false;
  next = newest = joined_at = cycle;
}

Sampler::Sampler(const SignalMap& map) : state_(std::make_unique<State>(map)) {}
Sampler::~Sampler() = default;
Sampler::Sampler(Sampler&&) noexcept = default;
Sampler& Sampler::operator=(Sampler&&) noexcept = default;

void Sampler::push(const CanFrame& frame) noexcept { state_->push(frame); }
void Sampler::finish() noexcept { state_->is_finished = true; }
const Sample* Sampler::take() noexcept { return state_->take(); }
void Sampler::reset() noexcept { state_->clear(); }
const SamplerCounters& Sampler::counters() const noexcept { return state_->counters; }
MessageCounters Sampler::message_counters(std::size_t message) const noexcept {
  return state_->watch.counters(message);
}

}  // namespace faultline
