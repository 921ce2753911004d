#include "tools/bench/frame_message.h"

#include <algorithm>
#include <chrono>

namespace faultline {

can_frame_t to_message(const CanFrame& frame) {
  int flags = 0;
  if (frame.is_extended) flags |= can_frame_t::EXTENDED;
  if (frame.is_fd) flags |= can_frame_t::FD;
  if (frame.is_bit_rate_switched) flags |= can_frame_t::BIT_RATE_SWITCH;
  if (frame.is_error_state) flags |= can_frame_t::ERROR_STATE;
  if (frame.is_remote) flags |= can_frame_t::REMOTE;
  if (frame.is_error) flags |= can_frame_t::ERROR;
  can_frame_t message;
  message.stamp_ns = frame.stamp.time_since_epoch().count();
  message.id = static_cast<std::int32_t>(frame.id);
  message.flags = static_cast<std::int8_t>(flags);
  message.length = static_cast<std::int8_t>(frame.length);
  message.data.assign(frame.data.begin(), frame.data.begin() + frame.length);
  return message;
}

std::optional<CanFrame> to_frame(const can_frame_t& message) {
  const auto has = [&](std::int32_t flag) { return (message.flags & flag) != 0; };
  CanFrame frame;
  frame.stamp = Timestamp(std::chrono::nanoseconds(message.stamp_ns));
  frame.id = static_cast<std::uint32_t>(message.id);
  frame.is_extended = has(can_frame_t::EXTENDED);
  frame.is_fd = has(can_frame_t::FD);
  frame.is_bit_rate_switched = has(can_frame_t::BIT_RATE_SWITCH);
  frame.is_error_state = has(can_frame_t::ERROR_STATE);
  frame.is_remote = has(can_frame_t::REMOTE);
  frame.is_error = has(can_frame_t::ERROR);
  // lcm-gen's decoder leaves an array alone whose count is zero: `data` may hold an older frame's.
  if (message.length < 0 || message.data.size() < static_cast<std::size_t>(message.length)) {
    return std::nullopt;
  }
  frame.length = static_cast<std::uint8_t>(message.length);
  if (!is_well_formed(frame)) return std::nullopt;
  if (!frame.is_remote) std::copy_n(message.data.begin(), message.length, frame.data.begin());
  return frame;
}

}  // namespace faultline
