#include "tools/lcm/frame_message.h"

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <limits>
#include <type_traits>

#include <faultline/can_t.hpp>

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

namespace {

/// Takes big-endian integers off the front of a message.
class BytesReader {
 public:
  explicit BytesReader(std::span<const std::uint8_t> bytes) noexcept : bytes_(bytes) {}

  [[nodiscard]] std::size_t left() const noexcept { return bytes_.size(); }
  /// @pre left() >= sizeof(Integer)
  template <class Integer>
  Integer take() noexcept {
    std::make_unsigned_t<Integer> value = 0;
    for (std::size_t i = 0; i < sizeof value; ++i) {
      value = static_cast<decltype(value)>(value << 7 << 1 | bytes_[i]);
    }
    bytes_ = bytes_.subspan(sizeof value);
    return static_cast<Integer>(value);
  }
  /// @pre left() >= count
  std::span<const std::uint8_t> take_bytes(std::size_t count) noexcept {
    const auto taken = bytes_.first(count);
    bytes_ = bytes_.subspan(count);
    return taken;
  }

 private:
  std::span<const std::uint8_t> bytes_;
};

/// Fingerprint, utime, sequence, first_frame; bus, frame_count (can_t.lcm).
constexpr std::size_t kBatchHeaderBytes = 4 * 8 + 2 * 4;
/// stamp_ns, id, flags, length (can_frame_t.lcm).
constexpr std::size_t kFrameHeaderBytes = 8 + 4 + 1 + 1;

/// @return whether a bus could have carried it. @pre the header is there
bool take_frame(BytesReader& reader, CanFrame& frame, bool& is_whole) noexcept {
  frame = {};
  frame.stamp = Timestamp(std::chrono::nanoseconds(reader.take<std::int64_t>()));
  frame.id = reader.take<std::uint32_t>();
  const int flags = reader.take<std::int8_t>();
  const auto length = reader.take<std::int8_t>();
  is_whole = length >= 0 && reader.left() >= static_cast<std::size_t>(length);
  if (!is_whole) return false;
  const auto data = reader.take_bytes(static_cast<std::size_t>(length));
  const auto has = [flags](std::int32_t flag) { return (flags & flag) != 0; };
  frame.is_extended = has(can_frame_t::EXTENDED);
  frame.is_fd = has(can_frame_t::FD);
  frame.is_bit_rate_switched = has(can_frame_t::BIT_RATE_SWITCH);
  frame.is_error_state = has(can_frame_t::ERROR_STATE);
  frame.is_remote = has(can_frame_t::REMOTE);
  frame.is_error = has(can_frame_t::ERROR);
  frame.length = static_cast<std::uint8_t>(length);
  if (!is_well_formed(frame)) return false;
  if (!frame.is_remote) std::copy(data.begin(), data.end(), frame.data.begin());
  return true;
}

}  // namespace

bool decode_frames(std::span<const std::uint8_t> message, FrameBatch& batch) {
  BytesReader reader(message);
  if (reader.left() < kBatchHeaderBytes) return false;
  if (reader.take<std::int64_t>() != can_t::getHash()) return false;
  batch.utime = reader.take<std::int64_t>();
  batch.sequence = reader.take<std::int64_t>();
  batch.first_frame = reader.take<std::int64_t>();
  const auto bus = reader.take<std::int32_t>();
  batch.frame_count = reader.take<std::int32_t>();
  batch.frames.clear();
  batch.malformed = 0;
  if (bus < 0 || bus > std::numeric_limits<std::uint8_t>::max() || batch.frame_count < 0) {
    return false;
  }
  batch.bus = static_cast<std::uint8_t>(bus);
  for (std::int32_t i = 0; i < batch.frame_count; ++i) {
    if (reader.left() < kFrameHeaderBytes) return false;
    CanFrame& frame = batch.frames.emplace_back();
    bool is_whole = false;
    const bool is_frame = take_frame(reader, frame, is_whole);
    if (!is_whole) return false;
    frame.bus = batch.bus;
    if (is_frame) continue;
    batch.frames.pop_back();
    ++batch.malformed;
  }
  return true;
}

}  // namespace faultline
