#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/signal/message_integrity.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// Puts the messages of one side (sensors or commands) together by their cycle counter: a plant
/// node needs whole commands, a controller whole measurements. As a real unit does, it refuses
/// frames whose checksum is wrong or whose alive counter repeated or left its sequence.
///
/// A message that is slower than the cycle (N cycles) is waited for N, 2 N, .. cycles after its
/// last frame; in the others its values are those of that frame.
///
/// Keeps the newest kSlots counters. Does not allocate after construction.
class MessageAssembler {
 public:
  static constexpr std::size_t kSlots = 8;

  /// `messages` must outlive the assembler. @param channel_count channels of the side.
  MessageAssembler(const std::vector<MappedMessage>& messages, std::size_t channel_count);

  /// Takes a frame; others' frames are ignored. `near` is the newest known cycle: the counter in
  /// the frame is taken to be the one nearest to it.
  /// @return the counter that this frame completed.
  std::optional<std::uint32_t> push(const CanFrame& frame, std::uint32_t near) noexcept;

  /// Channels of a completed counter; valid until kSlots later counters have begun.
  [[nodiscard]] std::span<const double> values(std::uint32_t counter) const noexcept;

  /// Frames refused for their checksum or alive counter so far.
  [[nodiscard]] std::uint64_t refused_frames() const noexcept { return refused_frames_; }

  void reset() noexcept;

 private:
  struct Slot {
    bool is_used = false;
    std::uint32_t counter = 0;
    std::size_t missing = 0;
    std::vector<std::uint8_t> seen;    // per message
    std::vector<std::uint8_t> is_due;  // per message
    std::vector<double> values;        // per channel
  };
  Slot& open(std::uint32_t counter) noexcept;
  [[nodiscard]] bool is_due(std::size_t message, std::uint32_t counter) const noexcept;

  const std::vector<MappedMessage>* messages_;
  std::vector<MessageIntegrity> integrity_;  // per message
  std::uint64_t refused_frames_ = 0;
  std::vector<std::uint8_t> has_come_;  // per message
  std::vector<std::uint32_t> came_in_;  // the newest counter that had it
  std::vector<double> newest_;          // per channel
  std::array<Slot, kSlots> slots_;
};

}  // namespace faultline
