#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <vector>

#include <faultline/can_frame_t.hpp>

#include "drivers/can/can_frame.h"

namespace faultline {

/// A receive time as messages have it: µs since 1970, the rest cut off.
[[nodiscard]] inline std::int64_t to_utime(Timestamp stamp) noexcept {
  return std::chrono::floor<std::chrono::microseconds>(stamp.time_since_epoch()).count();
}

/// A frame as FAULTLINE_CAN carries it; its bus stands in the batch.
[[nodiscard]] can_frame_t to_message(const CanFrame& frame);

/// A FAULTLINE_CAN message (can_t).
struct FrameBatch {
  std::int64_t utime = 0;
  std::int64_t sequence = 0;
  std::int64_t first_frame = 0;  ///< running number of the first frame
  std::int32_t frame_count = 0;  ///< as the message says; frames.size() unless some are malformed
  std::uint8_t bus = 0;
  std::vector<CanFrame> frames;
  std::uint32_t malformed = 0;  ///< frames that no bus could have carried; left out of `frames`
};

/// Reads an encoded can_t into `batch`, whose memory is reused. Faster than lcm-gen's decoder,
/// which allocates for every frame, and safe on any bytes.
/// @return false if `message` is of another type or damaged; `batch` is unspecified then.
[[nodiscard]] bool decode_frames(std::span<const std::uint8_t> message, FrameBatch& batch);

}  // namespace faultline
