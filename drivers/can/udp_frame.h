#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/can/can_frame.h"

namespace faultline {

/// Longest datagram that `encode_udp_frame` writes.
inline constexpr std::size_t kLongestUdpFrame = 256;

/// Reads one datagram of python-can's `udp_multicast` interface: a msgpack map with the keys
/// timestamp, arbitration_id, is_extended_id, is_remote_frame, is_error_frame, channel, dlc, data,
/// is_fd, bitrate_switch and error_state_indicator, in any order. As in python-can, a key that is
/// missing has can.Message's default (an extended identifier, everything else none), and `dlc` is
/// the length in bytes, also of an FD frame. `channel` and keys that are none of these are read
/// over. `frame.stamp` is the sender's timestamp to the microsecond, 1970 if it is no time.
/// @return false, and leaves `frame` as it is, if the datagram is no such map from its first byte
/// to its last, or the frame is not well-formed, or the length of the data is not `dlc`.
/// Real-time: does not allocate.
///
/// Source: python-can 4.1, can/interfaces/udp_multicast/utils.py and can/message.py.
[[nodiscard]] bool decode_udp_frame(std::span<const std::uint8_t> datagram,
                                    CanFrame& frame) noexcept;

/// Writes `frame` to the byte as python-can does (without a channel), its stamp as the timestamp.
/// An error frame whose class has more than 11 bits is marked extended, else python-can would
/// refuse it. Real-time: does not allocate.
/// @return bytes written; 0 if `out` is too small or the frame not well-formed.
std::size_t encode_udp_frame(const CanFrame& frame, std::span<std::uint8_t> out) noexcept;

}  // namespace faultline
