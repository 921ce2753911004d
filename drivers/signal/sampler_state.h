#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "drivers/signal/message_watch.h"
#include "drivers/signal/open_cycles.h"
#include "drivers/signal/sample.h"
#include "drivers/signal/sample_values.h"
#include "drivers/signal/sampler.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// Cycles that may be open at once: what Sampler::kMaxGap leaves to close.
inline constexpr std::uint32_t kOpenCycles = 128;
static_assert(kOpenCycles > Sampler::kMaxGap + 2);

/// A frame of a mapped message, checked.
struct CheckedFrame {
  const CanFrame& frame;
  std::size_t message;  ///< index in the SignalMap
  MessageFault fault;   ///< kNone: its values may be used
  bool is_after_gap;    ///< of its alive counter
};

/// Frames are put into open cycles and commands (sampler.cpp), and those closed into samples
/// (sampler_close.cpp).
struct Sampler::State {
  explicit State(const SignalMap& signal_map);

  void push(const CanFrame& frame) noexcept;
  const Sample* take() noexcept;
  void clear() noexcept;

  // Frames by kind; `index` is the message's among those of its kind.
  void push_sync(const CheckedFrame& checked) noexcept;
  void push_sensor(std::size_t index, const CheckedFrame& checked) noexcept;
  void push_command(std::size_t index, const CheckedFrame& checked) noexcept;
  void note_command_in_bus_order(std::size_t index, const CheckedFrame& checked) noexcept;

  // What is wrong with them.
  [[nodiscard]] bool is_discarded(const CheckedFrame& checked, bool is_cycle_needed) noexcept;
  void note(const CheckedFrame& checked, MessageFault fault) noexcept;
  void mark(std::uint32_t& flags, Blame& blame, std::uint32_t flag, const CheckedFrame& checked,
            MessageFault fault) noexcept;
  void mark_pending(std::uint32_t flag, const CheckedFrame& checked, MessageFault fault) noexcept {
    mark(pending_flags, pending_blame, flag, checked, fault);
  }
  template <class Slot>
  void mark(Slot& slot, std::uint32_t flag, const CheckedFrame& checked,
            MessageFault fault) noexcept {
    mark(slot.flags, slot.blame, flag, checked, fault);
  }
  void decode(const MappedMessage& message, const CheckedFrame& checked, std::span<double> values,
              std::span<std::uint8_t> known, std::uint32_t& flags, Blame& blame) noexcept;

  // Which cycle.
  bool advance_to(std::uint32_t cycle, bool may_reset, const CheckedFrame& checked) noexcept;
  [[nodiscard]] bool find_sensor_cycle(std::size_t index, const CheckedFrame& checked,
                                       std::uint32_t& cycle) noexcept;
  void start_at(std::uint32_t cycle) noexcept;

  // Closing.
  [[nodiscard]] bool is_complete(const CycleSlot& slot) noexcept;
  [[nodiscard]] bool have_sensors_come(const CycleSlot& slot) const noexcept;
  [[nodiscard]] bool is_due(std::size_t sensor_message, std::uint32_t cycle) const noexcept;
  [[nodiscard]] bool is_command_complete(const CycleSlot& slot) noexcept;
  [[nodiscard]] bool must_close() const noexcept;
  [[nodiscard]] bool is_skipped_at_start(bool complete) noexcept;
  void close(CycleSlot* slot) noexcept;
  void close_outputs(const CycleSlot& slot) noexcept;
  void close_inputs(const CycleSlot& slot) noexcept;
  void mark_for_unused_answer(std::uint32_t counter) noexcept;
  void close_inputs_in_bus_order(const CycleSlot& slot) noexcept;
  void blame_missing(std::size_t message) noexcept;

  [[nodiscard]] std::size_t command_index(std::size_t index) const noexcept {
    return map.sensor_messages.size() + index;
  }
  [[nodiscard]] std::size_t sync_index() const noexcept {
    return map.sensor_messages.size() + map.command_messages.size();
  }

  const SignalMap map;
  const bool has_sync;
  const bool is_cycle_counted;  ///< SYNC or every sensor message tells the cycle
  const bool is_command_known;  ///< SYNC tells c_k, and every command message its counter
  const bool is_by_bus_order;   ///< what kSampleBusOrder says
  const bool has_slow;          ///< a sensor message is slower than the cycle

  MessageWatch watch;

  bool is_started = false;  ///< the first cycle is known
  bool is_joining = false;  ///< no complete cycle since the start
  bool is_finished = false;
  std::uint32_t next = 0;    ///< the next cycle to close
  std::uint32_t newest = 0;  ///< the newest cycle seen
  std::uint32_t joined_at = 0;
  std::uint32_t pending_flags = 0;  ///< for the next sample to close
  Blame pending_blame;
  Timestamp last_stamp{};
  std::vector<std::uint8_t> has_come;  ///< per sensor message, in a closed cycle since the start
  std::vector<std::uint32_t> came_in;  ///< the newest such cycle

  SlotRing<CycleSlot, kOpenCycles> cycles;
  SlotRing<CommandSlot, kCommandDepth> commands;
  bool has_used_command = false;
  std::uint32_t used_command = 0;  ///< counter of the command whose values `u` holds whole
  bool has_closed_command = false;
  std::uint32_t closed_command = 0;  ///< c_k of the newest closed sample that had one

  // Bus order: the newest commands.
  std::vector<double> newest_u;
  std::vector<std::uint8_t> newest_u_is_fresh;
  std::vector<std::uint8_t> command_seen;  ///< per command message, ever
  std::uint32_t newest_command_flags = 0;
  Blame newest_command_blame;

  // The sample shown to the caller.
  SampleValues y;
  SampleValues u;
  Sample sample;
  SamplerCounters counters;
};

}  // namespace faultline
