#pragma once

#include <array>
#include <random>

#include "drivers/can/can_frame.h"

namespace faultline {

/// A well-formed frame of any kind, error frames among them if asked for; zero beyond its payload.
inline CanFrame random_can_frame(std::mt19937_64& generator, bool with_error_frames = true) {
  CanFrame frame;
  const std::uint64_t kind = generator() % (with_error_frames ? 4 : 3);
  frame.is_remote = kind == 1;
  frame.is_fd = kind == 2;
  frame.is_error = kind == 3;
  frame.is_extended = !frame.is_error && generator() % 2 == 0;
  frame.is_bit_rate_switched = frame.is_fd && generator() % 2 == 0;
  frame.is_error_state = frame.is_fd && generator() % 2 == 0;
  const bool is_long = frame.is_extended || frame.is_error;
  frame.id = static_cast<std::uint32_t>(generator()) & (is_long ? kMaxExtendedId : kMaxStandardId);
  constexpr std::array<std::uint8_t, 16> kFdLengths{0, 1,  2,  3,  4,  5,  6,  7,
                                                    8, 12, 16, 20, 24, 32, 48, 64};
  frame.length = frame.is_fd ? kFdLengths[generator() % 16]
                             : static_cast<std::uint8_t>(generator() % (kMaxClassicPayload + 1));
  if (!frame.is_remote) {
    for (std::size_t n = 0; n < frame.length; ++n) {
      frame.data[n] = static_cast<std::uint8_t>(generator());
    }
  }
  return frame;
}

}  // namespace faultline
