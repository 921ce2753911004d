#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/signal/cycle_counter.h"
#include "drivers/signal/sample.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// What is known of one open cycle. A part of the sampler.
struct CycleSlot {
  bool is_used = false;
  std::uint32_t counter = 0;  ///< the cycle
  bool has_sync = false;
  std::uint32_t command_cycle = kNoCommand;
  std::uint32_t flags = 0;
  Blame blame;
  std::size_t arrived_count = 0;
  std::vector<std::uint8_t> arrived;  ///< per sensor message: its values are used
  std::vector<std::uint8_t> refused;  ///< per sensor message: a frame came that is not
  std::vector<std::uint8_t> y_known;  ///< per output: `y` holds this cycle's value
  std::vector<double> y;
  // Bus order: what commands had said when the first sensor frame came.
  std::vector<double> u;
  std::vector<std::uint8_t> u_is_fresh;

  void size_for(const SignalMap& map) {
    arrived.resize(map.sensor_messages.size());
    refused.resize(map.sensor_messages.size());
    y_known.resize(map.output_names.size());
    y.resize(map.output_names.size());
    u.resize(map.input_names.size());
    u_is_fresh.resize(map.input_names.size());
  }
  void clear() noexcept {
    has_sync = false;
    command_cycle = kNoCommand;
    flags = 0;
    blame = {};
    arrived_count = 0;
    std::fill(arrived.begin(), arrived.end(), std::uint8_t{0});
    std::fill(refused.begin(), refused.end(), std::uint8_t{0});
    std::fill(y_known.begin(), y_known.end(), std::uint8_t{0});
  }
};

/// What is known of one command. A part of the sampler.
struct CommandSlot {
  bool is_used = false;
  std::uint32_t counter = 0;
  std::uint32_t flags = 0;
  Blame blame;
  std::size_t arrived_count = 0;
  std::vector<std::uint8_t> arrived;  ///< per command message: its values are used
  std::vector<std::uint8_t> u_known;  ///< per input
  std::vector<double> u;

  void size_for(const SignalMap& map) {
    arrived.resize(map.command_messages.size());
    u_known.resize(map.input_names.size());
    u.resize(map.input_names.size());
  }
  void clear() noexcept {
    flags = 0;
    blame = {};
    arrived_count = 0;
    std::fill(arrived.begin(), arrived.end(), std::uint8_t{0});
    std::fill(u_known.begin(), u_known.end(), std::uint8_t{0});
  }
};

/// The newest slots by counter. `capacity` is a power of two, so that the low bits of the counter,
/// which wrap without a seam at 2^32, find the slot.
template <class Slot, std::uint32_t capacity>
class SlotRing {
 public:
  static_assert((capacity & (capacity - 1)) == 0);

  explicit SlotRing(const SignalMap& map) {
    for (Slot& slot : slots_) slot.size_for(map);
  }
  void clear() noexcept {
    for (Slot& slot : slots_) slot.is_used = false;
  }
  /// The slot of `counter`, or nullptr.
  [[nodiscard]] Slot* find(std::uint32_t counter) noexcept {
    Slot& slot = slots_[counter % capacity];
    return slot.is_used && slot.counter == counter ? &slot : nullptr;
  }
  /// The slot of `counter`; an empty one, in place of another's, if it has none.
  [[nodiscard]] Slot& open(std::uint32_t counter) noexcept {
    Slot& slot = slots_[counter % capacity];
    if (slot.is_used && slot.counter == counter) return slot;
    slot.is_used = true;
    slot.counter = counter;
    slot.clear();
    return slot;
  }
  /// True if the place of `counter` belongs to a newer one.
  [[nodiscard]] bool is_overtaken(std::uint32_t counter) const noexcept {
    const Slot& slot = slots_[counter % capacity];
    return slot.is_used && cycles_ahead(slot.counter, counter) > 0;
  }

 private:
  std::array<Slot, capacity> slots_;
};

}  // namespace faultline
