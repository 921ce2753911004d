#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "drivers/can/can_frame.h"
#include "drivers/signal/message_protection.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

// What faults do to the bytes of one frame. None allocates or throws.

/// The channel's value in the frame; NaN if its signal is not whole in it.
[[nodiscard]] double channel_value(const MappedSignal& signal, const CanFrame& frame) noexcept;

/// Writes the channel's value, clamped to what its signal can hold; NaN leaves the frame as it is.
void set_channel_value(const MappedSignal& signal, double value, CanFrame& frame) noexcept;

/// Makes checksum and data id nibble right for the payload; the alive counter stays. Nothing to a
/// frame shorter than its message.
void protect_again(const MessageProtection& protection, CanFrame& frame) noexcept;

/// The alive counter of the frame sent before this one; nothing where there is none to read.
[[nodiscard]] std::optional<std::uint64_t> count_before(const MessageProtection& protection,
                                                        const CanFrame& frame) noexcept;

/// Writes the alive counter, and the checksum that is right for it.
void set_count(const MessageProtection& protection, std::uint64_t count, CanFrame& frame) noexcept;

/// Inverts the checksum's bits; nothing without one.
void invert_checksum(const MessageProtection& protection, CanFrame& frame) noexcept;

/// Flips `bits` different bits of the payload (all, if it has no more). `draw(n)` is the n-th of a
/// stream of random 64-bit numbers.
template <class Draw>
void flip_bits(std::size_t bits, CanFrame& frame, const Draw& draw) noexcept {
  const std::size_t in_all = std::size_t{8} * frame.length;
  std::array<std::uint8_t, kMaxPayload> flipped{};
  std::size_t left = bits < in_all ? bits : in_all;
  for (std::size_t chosen = in_all - left; left > 0; --left, ++chosen) {
    // Floyd's sampling: each set of so many bits is equally likely.
    std::size_t bit = draw(left) % (chosen + 1);
    if ((flipped[bit / 8] >> (bit % 8) & 1U) != 0) bit = chosen;
    const auto mask = static_cast<std::uint8_t>(1U << (bit % 8));
    flipped[bit / 8] = static_cast<std::uint8_t>(flipped[bit / 8] | mask);
    frame.data[bit / 8] = static_cast<std::uint8_t>(frame.data[bit / 8] ^ mask);
  }
}

/// Cuts the payload to `length` bytes or fills it up with zeros, as far as the frame's format has
/// such a length: classic frames up to 8, FD frames the next lower one of ISO 11898-1 (.. 8, 12,
/// 16, 20, 24, 32, 48, 64).
void set_length(std::size_t length, CanFrame& frame) noexcept;

}  // namespace faultline
