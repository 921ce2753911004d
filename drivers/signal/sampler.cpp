#include "drivers/signal/sampler.h"

#include <algorithm>
#include <array>
#include <vector>

#include "drivers/signal/cycle_counter.h"

namespace faultline {
namespace {

/// Cycles that may be open at once: what kMaxGap leaves to close, a power of two so that slots are
/// found by the low bits of the cycle, which wrap without a seam at 2^32.
constexpr std::uint32_t kOpenCycles = 128;
static_assert(kOpenCycles > Sampler::kMaxGap + 2);

/// What is known of one open cycle.
struct CycleSlot {
  bool is_used = false;
  std::uint32_t cycle = 0;
  bool has_sync = false;
  std::uint32_t command_cycle = kNoCommand;
  std::uint32_t flags = 0;
  std::size_t arrived_count = 0;
  std::vector<std::uint8_t> arrived;  ///< per sensor message
  std::vector<std::uint8_t> y_known;  ///< per output: `y` holds this cycle's value
  std::vector<double> y;
  // Bus order: what commands had said when the first sensor frame came.
  std::vector<double> u;
  std::vector<std::uint8_t> u_is_fresh;
};

/// What is known of one command.
struct CommandSlot {
  bool is_used = false;
  std::uint32_t counter = 0;
  std::uint32_t flags = 0;
  std::size_t arrived_count = 0;
  std::vector<std::uint8_t> arrived;  ///< per command message
  std::vector<std::uint8_t> u_known;  ///< per input
  std::vector<double> u;
};

/// True if every message of one side has a counter.
bool all_counted(const std::vector<MappedMessage>& messages) noexcept {
  return std::all_of(messages.begin(), messages.end(),
                     [](const MappedMessage& message) { return message.cycle.has_value(); });
}

}  // namespace

struct Sampler::State {
  explicit State(const SignalMap& signal_map);

  void push(const CanFrame& frame) noexcept;
  const Sample* take() noexcept;
  void clear() noexcept;

  // Frames by kind.
  void push_sync(const CanFrame& frame) noexcept;
  void push_sensor(std::size_t message, const CanFrame& frame) noexcept;
  void push_command(std::size_t message, const CanFrame& frame) noexcept;
  void note_command_in_bus_order(std::size_t message, const CanFrame& frame) noexcept;

  // Which cycle.
  bool advance_to(std::uint32_t cycle, bool may_reset) noexcept;
  [[nodiscard]] bool find_sensor_cycle(std::size_t message, const CanFrame& frame,
                                       std::uint32_t& cycle) noexcept;
  void start_at(std::uint32_t cycle) noexcept;
  [[nodiscard]] CycleSlot& open_cycle(std::uint32_t cycle) noexcept;
  [[nodiscard]] CycleSlot* find_cycle(std::uint32_t cycle) noexcept;
  [[nodiscard]] bool is_command_overtaken(std::uint32_t counter) const noexcept;
  [[nodiscard]] CommandSlot& open_command(std::uint32_t counter) noexcept;
  [[nodiscard]] CommandSlot* find_command(std::uint32_t counter) noexcept;

  // Closing.
  [[nodiscard]] bool is_complete(const CycleSlot& slot) noexcept;
  [[nodiscard]] bool is_command_complete(const CycleSlot& slot) noexcept;
  [[nodiscard]] bool must_close() const noexcept;
  [[nodiscard]] bool is_skipped_at_start(bool complete) noexcept;
  void close(CycleSlot* slot) noexcept;
  void close_outputs(const CycleSlot& slot) noexcept;
  void close_inputs(const CycleSlot& slot) noexcept;
  void close_inputs_in_bus_order(const CycleSlot& slot) noexcept;
  [[nodiscard]] std::uint32_t decode_values(const MappedMessage& message, const CanFrame& frame,
                                            std::span<double> values,
                                            std::span<std::uint8_t> known) noexcept;

  const SignalMap map;
  const bool has_sync;
  const bool is_cycle_counted;  ///< SYNC or every sensor message tells the cycle
  const bool is_command_known;  ///< SYNC tells c_k, and every command message its counter
  const bool is_by_bus_order;   ///< what kSampleBusOrder says

  bool is_started = false;  ///< the first cycle is known
  bool is_joining = false;  ///< no complete cycle since the start
  bool is_finished = false;
  std::uint32_t next = 0;    ///< the next cycle to close
  std::uint32_t newest = 0;  ///< the newest cycle seen
  std::uint32_t joined_at = 0;
  std::uint32_t pending_flags = 0;  ///< for the next sample to close
  Timestamp last_stamp{};

  std::array<CycleSlot, kOpenCycles> cycles;
  std::array<CommandSlot, kCommandDepth> commands;
  bool has_used_command = false;
  std::uint32_t used_command = 0;  ///< counter of the command whose values `u` holds whole
  bool has_closed_command = false;
  std::uint32_t closed_command = 0;  ///< c_k of the newest closed sample that had one

  // Bus order: the newest commands.
  std::vector<double> newest_u;
  std::vector<std::uint8_t> newest_u_is_fresh;
  std::vector<std::uint8_t> command_seen;  ///< per command message, ever
  std::uint32_t newest_command_flags = 0;

  // The sample shown to the caller.
  std::vector<double> y;
  std::vector<double> u;
  std::vector<std::uint8_t> y_is_fresh;
  std::vector<std::uint8_t> u_is_fresh;
  Sample sample;
  SamplerCounters counters;
};

Sampler::State::State(const SignalMap& signal_map)
    : map(signal_map),
      has_sync(map.sync.has_value()),
      is_cycle_counted(has_sync || all_counted(map.sensor_messages)),
      is_command_known(map.command_messages.empty() ||
                       (has_sync && map.sync->command_cycle && all_counted(map.command_messages))),
      is_by_bus_order(!has_sync || !is_command_known || !all_counted(map.sensor_messages)) {
  const std::size_t output_count = map.output_names.size();
  const std::size_t input_count = map.input_names.size();
  for (CycleSlot& slot : cycles) {
    slot.arrived.resize(map.sensor_messages.size());
    slot.y_known.resize(output_count);
    slot.y.resize(output_count);
    slot.u.resize(input_count);
    slot.u_is_fresh.resize(input_count);
  }
  for (CommandSlot& slot : commands) {
    slot.arrived.resize(map.command_messages.size());
    slot.u_known.resize(input_count);
    slot.u.resize(input_count);
  }
  newest_u.resize(input_count);
  newest_u_is_fresh.resize(input_count);
  command_seen.resize(map.command_messages.size());
  y.resize(output_count);
  u.resize(input_count);
  y_is_fresh.resize(output_count);
  u_is_fresh.resize(input_count);
}

void Sampler::State::clear() noexcept {
  is_started = is_joining = is_finished = false;
  has_used_command = has_closed_command = false;
  next = newest = joined_at = pending_flags = newest_command_flags = 0;
  last_stamp = {};
  for (CycleSlot& slot : cycles) slot.is_used = false;
  for (CommandSlot& slot : commands) slot.is_used = false;
  std::fill(newest_u.begin(), newest_u.end(), 0.0);
  std::fill(newest_u_is_fresh.begin(), newest_u_is_fresh.end(), std::uint8_t{0});
  std::fill(command_seen.begin(), command_seen.end(), std::uint8_t{0});
  std::fill(y.begin(), y.end(), 0.0);
  std::fill(u.begin(), u.end(), 0.0);
  counters = {};
}

void Sampler::State::push(const CanFrame& frame) noexcept {
  if (is_finished) {
    ++counters.ignored_frames;
    return;
  }
  last_stamp = frame.stamp;
  if (map.sync && map.sync->matches(frame)) return push_sync(frame);
  const auto matches = [&](const MappedMessage& message) { return message.matches(frame); };
  const auto& sensors = map.sensor_messages;
  if (const auto found = std::find_if(sensors.begin(), sensors.end(), matches);
      found != sensors.end()) {
    return push_sensor(static_cast<std::size_t>(found - sensors.begin()), frame);
  }
  const auto& command_messages = map.command_messages;
  if (const auto found = std::find_if(command_messages.begin(), command_messages.end(), matches);
      found != command_messages.end()) {
    const auto message = static_cast<std::size_t>(found - command_messages.begin());
    return is_command_known ? push_command(message, frame)
                            : note_command_in_bus_order(message, frame);
  }
  ++counters.ignored_frames;
}

void Sampler::State::push_sync(const CanFrame& frame) noexcept {
  std::int64_t k = 0;
  std::int64_t c_k = kNoCommand;
  const bool has_k = map.sync->cycle.decode_raw(frame.payload(), k) == CodecStatus::kOk;
  const bool has_c_k = !map.sync->command_cycle || map.sync->command_cycle->decode_raw(
                                                       frame.payload(), c_k) == CodecStatus::kOk;
  if (!has_k || !has_c_k) {
    ++counters.short_frames;
    pending_flags |= kSampleShortPayload;
    return;
  }
  const auto cycle = static_cast<std::uint32_t>(k);
  if (!advance_to(cycle, true)) return;
  CycleSlot& slot = open_cycle(cycle);
  if (slot.has_sync) {
    ++counters.repeated_frames;
    slot.flags |= kSampleRepeated;
    return;
  }
  slot.has_sync = true;
  slot.command_cycle = static_cast<std::uint32_t>(c_k);
}

void Sampler::State::push_sensor(std::size_t message, const CanFrame& frame) noexcept {
  std::uint32_t cycle = 0;
  if (!find_sensor_cycle(message, frame, cycle) || !advance_to(cycle, !has_sync)) return;
  CycleSlot& slot = open_cycle(cycle);
  if (slot.arrived[message] != 0) {
    ++counters.repeated_frames;
    slot.flags |= kSampleRepeated;
    return;
  }
  if (!is_command_known && slot.arrived_count == 0) {
    slot.u = newest_u;
    slot.u_is_fresh = newest_u_is_fresh;
    slot.flags |= newest_command_flags;
    newest_command_flags = 0;
    std::fill(newest_u_is_fresh.begin(), newest_u_is_fresh.end(), std::uint8_t{0});
  }
  slot.arrived[message] = 1;
  ++slot.arrived_count;
  slot.flags |= decode_values(map.sensor_messages[message], frame, slot.y, slot.y_known);
}

void Sampler::State::push_command(std::size_t message, const CanFrame& frame) noexcept {
  if (!is_started) {
    ++counters.ignored_frames;
    return;
  }
  const SignalCodec& codec = *map.command_messages[message].cycle;
  std::int64_t low_bits = 0;
  if (codec.decode_raw(frame.payload(), low_bits) != CodecStatus::kOk) {
    ++counters.short_frames;
    pending_flags |= kSampleShortPayload;
    return;
  }
  const std::uint32_t counter =
      unwrap_cycle(static_cast<std::uint32_t>(low_bits), codec.bit_count(), newest);
  const bool is_closed = has_closed_command && cycles_ahead(counter, closed_command) <= 0;
  CommandSlot* const known = find_command(counter);
  if (known == nullptr && (is_closed || is_command_overtaken(counter))) {
    ++counters.late_frames;
    pending_flags |= kSampleLate;
    return;
  }
  CommandSlot& slot = known != nullptr ? *known : open_command(counter);
  if (slot.arrived[message] != 0) {
    ++counters.repeated_frames;
    (is_closed ? pending_flags : slot.flags) |= kSampleRepeated;
    return;
  }
  slot.arrived[message] = 1;
  ++slot.arrived_count;
  slot.flags |= decode_values(map.command_messages[message], frame, slot.u, slot.u_known);
}

void Sampler::State::note_command_in_bus_order(std::size_t message,
                                               const CanFrame& frame) noexcept {
  command_seen[message] = 1;
  newest_command_flags |=
      decode_values(map.command_messages[message], frame, newest_u, newest_u_is_fresh);
}

/// Decodes the channels of `message` and marks them as known. @return the flags this earns.
std::uint32_t Sampler::State::decode_values(const MappedMessage& message, const CanFrame& frame,
                                            std::span<double> values,
                                            std::span<std::uint8_t> known) noexcept {
  switch (message.decode(frame, values)) {
    case CodecStatus::kPayloadTooShort:
      ++counters.short_frames;
      return kSampleShortPayload;
    case CodecStatus::kNotANumber:
      ++counters.not_finite_frames;
      return kSampleNotFinite;
    case CodecStatus::kOk:
    case CodecStatus::kOutOfRange:
      break;
  }
  for (const MappedSignal& mapped : message.channels) known[mapped.channel] = 1;
  return 0;
}

/// The cycle a sensor frame is of. @return false if that cannot be told; then it is counted.
bool Sampler::State::find_sensor_cycle(std::size_t message, const CanFrame& frame,
                                       std::uint32_t& cycle) noexcept {
  if (has_sync && !is_started) {
    ++counters.ignored_frames;
    return false;
  }
  const auto& codec = map.sensor_messages[message].cycle;
  if (!is_cycle_counted) {
    // We count: a message that comes again, or after its cycle has closed, begins the next cycle.
    const CycleSlot* const slot = is_started ? find_cycle(newest) : nullptr;
    const bool is_next = is_started && (cycles_ahead(next, newest) > 0 ||
                                        (slot != nullptr && slot->arrived[message] != 0));
    cycle = is_next ? newest + 1 : newest;
    return true;
  }
  if (!codec) {
    cycle = newest;
    return true;
  }
  std::int64_t low_bits = 0;
  if (codec->decode_raw(frame.payload(), low_bits) != CodecStatus::kOk) {
    ++counters.short_frames;
    pending_flags |= kSampleShortPayload;
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
bool Sampler::State::advance_to(std::uint32_t cycle, bool may_reset) noexcept {
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
    ++counters.late_frames;
    pending_flags |= kSampleLate;
    return false;
  }
  if (step > 0) newest = cycle;
  return true;
}

/// Drops what is open and begins at `cycle`.
void Sampler::State::start_at(std::uint32_t cycle) noexcept {
  for (CycleSlot& slot : cycles) slot.is_used = false;
  for (CommandSlot& slot : commands) slot.is_used = false;
  is_started = true;
  is_joining = true;
  has_used_command = has_closed_command = false;
  next = newest = joined_at = cycle;
}

CycleSlot& Sampler::State::open_cycle(std::uint32_t cycle) noexcept {
  CycleSlot& slot = cycles[cycle % kOpenCycles];
  if (slot.is_used && slot.cycle == cycle) return slot;
  slot.is_used = true;
  slot.cycle = cycle;
  slot.has_sync = false;
  slot.command_cycle = kNoCommand;
  slot.flags = 0;
  slot.arrived_count = 0;
  std::fill(slot.arrived.begin(), slot.arrived.end(), std::uint8_t{0});
  std::fill(slot.y_known.begin(), slot.y_known.end(), std::uint8_t{0});
  return slot;
}

CycleSlot* Sampler::State::find_cycle(std::uint32_t cycle) noexcept {
  CycleSlot& slot = cycles[cycle % kOpenCycles];
  return slot.is_used && slot.cycle == cycle ? &slot : nullptr;
}

/// True if the slot of command `counter` belongs to a newer command.
bool Sampler::State::is_command_overtaken(std::uint32_t counter) const noexcept {
  const CommandSlot& slot = commands[counter % kCommandDepth];
  return slot.is_used && cycles_ahead(slot.counter, counter) > 0;
}

CommandSlot& Sampler::State::open_command(std::uint32_t counter) noexcept {
  CommandSlot& slot = commands[counter % kCommandDepth];
  slot.is_used = true;
  slot.counter = counter;
  slot.flags = 0;
  slot.arrived_count = 0;
  std::fill(slot.arrived.begin(), slot.arrived.end(), std::uint8_t{0});
  std::fill(slot.u_known.begin(), slot.u_known.end(), std::uint8_t{0});
  return slot;
}

CommandSlot* Sampler::State::find_command(std::uint32_t counter) noexcept {
  CommandSlot& slot = commands[counter % kCommandDepth];
  return slot.is_used && slot.counter == counter ? &slot : nullptr;
}

const Sample* Sampler::State::take() noexcept {
  while (is_started) {
    CycleSlot* const slot = find_cycle(next);
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
  return (slot.has_sync || !has_sync) && slot.arrived_count == map.sensor_messages.size() &&
         is_command_complete(slot);
}

bool Sampler::State::is_command_complete(const CycleSlot& slot) noexcept {
  if (!is_command_known || map.command_messages.empty()) return true;
  if (!slot.has_sync) return false;
  if (slot.command_cycle == kNoCommand) return true;
  if (has_used_command && used_command == slot.command_cycle) return true;
  const CommandSlot* const command = find_command(slot.command_cycle);
  return command != nullptr && command->arrived_count == map.command_messages.size();
}

/// Makes `sample` of the next cycle. `slot` is nullptr if nothing of that cycle came.
void Sampler::State::close(CycleSlot* slot) noexcept {
  std::fill(y_is_fresh.begin(), y_is_fresh.end(), std::uint8_t{0});
  std::fill(u_is_fresh.begin(), u_is_fresh.end(), std::uint8_t{0});
  sample.cycle = next++;
  sample.command_cycle = kNoCommand;
  sample.flags = pending_flags | (is_by_bus_order ? kSampleBusOrder : 0u);
  sample.stamp = last_stamp;
  pending_flags = 0;
  if (slot == nullptr) {
    sample.flags |= kSampleGap;
    counters.missing_messages += map.sensor_messages.size() + (has_sync ? 1u : 0u);
  } else {
    sample.flags |= slot->flags;
    close_outputs(*slot);
    if (is_command_known) {
      close_inputs(*slot);
    } else {
      close_inputs_in_bus_order(*slot);
    }
    slot->is_used = false;
  }
  sample.y = y;
  sample.u = u;
  sample.y_is_fresh = y_is_fresh;
  sample.u_is_fresh = u_is_fresh;
  ++counters.samples;
  counters.bad_samples += sample.is_good() ? 0u : 1u;
}

void Sampler::State::close_outputs(const CycleSlot& slot) noexcept {
  for (std::size_t channel = 0; channel < y.size(); ++channel) {
    if (slot.y_known[channel] == 0) continue;
    y[channel] = slot.y[channel];
    y_is_fresh[channel] = 1;
  }
  const std::size_t missing = map.sensor_messages.size() - slot.arrived_count;
  if (missing > 0) sample.flags |= kSampleSensorMissing;
  counters.missing_messages += missing + (has_sync && !slot.has_sync ? 1u : 0u);
}

void Sampler::State::close_inputs(const CycleSlot& slot) noexcept {
  sample.command_cycle = slot.command_cycle;
  if (!is_command_complete(slot)) sample.flags |= kSampleCommandMissing;
  if (!slot.has_sync || map.command_messages.empty()) return;
  if (slot.command_cycle == kNoCommand) {
    std::fill(u.begin(), u.end(), 0.0);
    std::fill(u_is_fresh.begin(), u_is_fresh.end(), std::uint8_t{1});
    has_used_command = false;
    return;
  }
  has_closed_command = true;
  closed_command = slot.command_cycle;
  CommandSlot* const command = find_command(slot.command_cycle);
  if (command == nullptr) {
    const bool still_acts = has_used_command && used_command == slot.command_cycle;
    std::fill(u_is_fresh.begin(), u_is_fresh.end(), static_cast<std::uint8_t>(still_acts));
    return;
  }
  sample.flags |= command->flags;
  command->flags &= ~kSampleRepeated;  // told once; its values are good
  for (std::size_t channel = 0; channel < u.size(); ++channel) {
    if (command->u_known[channel] == 0) continue;
    u[channel] = command->u[channel];
    u_is_fresh[channel] = 1;
  }
  has_used_command = command->arrived_count == map.command_messages.size() && command->flags == 0;
  used_command = slot.command_cycle;
}

void Sampler::State::close_inputs_in_bus_order(const CycleSlot& slot) noexcept {
  const auto seen = static_cast<std::size_t>(
      std::count(command_seen.begin(), command_seen.end(), std::uint8_t{1}));
  if (seen > 0 && seen < map.command_messages.size()) sample.flags |= kSampleCommandMissing;
  if (slot.arrived_count == 0) return;
  u = slot.u;
  u_is_fresh = slot.u_is_fresh;
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

}  // namespace faultline
