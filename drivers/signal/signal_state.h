#pragma once

#include <cstdint>
#include <string_view>

namespace faultline {

/// What is known of a signal's newest value, or of the message that carries it.
enum class SignalState : std::uint8_t {
  kFresh,         ///< received in time, and nothing speaks against it
  kStale,         ///< the last one is too old
  kCounterError,  ///< the last frame's alive counter repeated, or is no number of its sequence
  kCrcError,      ///< the last frame's checksum was wrong
  kNeverSeen,     ///< none has come yet
};

/// The state in words for people and logs.
[[nodiscard]] constexpr std::string_view signal_state_name(SignalState state) noexcept {
  switch (state) {
    case SignalState::kFresh:
      return "fresh";
    case SignalState::kStale:
      return "stale";
    case SignalState::kCounterError:
      return "counter error";
    case SignalState::kCrcError:
      return "CRC error";
    case SignalState::kNeverSeen:
      break;
  }
  return "never seen";
}

}  // namespace faultline
