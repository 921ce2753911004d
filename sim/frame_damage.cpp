#include "sim/frame_damage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

namespace faultline {
namespace {

/// Payload lengths of CAN FD beyond those of classic CAN (ISO 11898-1:2015, table of DLCs).
constexpr std::array<std::size_t, 7> kFdLengths{12, 16, 20, 24, 32, 48, 64};

std::span<std::uint8_t> payload_of(CanFrame& frame) noexcept {
  return std::span(frame.data).first(frame.length);
}

bool is_whole(const MessageProtection& protection, const CanFrame& frame) noexcept {
  return frame.length >= protection.length;
}

}  // namespace

double channel_value(const MappedSignal& signal, const CanFrame& frame) noexcept {
  double physical = 0.0;
  if (signal.codec.decode_physical(frame.payload(), physical) != CodecStatus::kOk) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  return signal.scale * physical + signal.offset;
}

void set_channel_value(const MappedSignal& signal, double value, CanFrame& frame) noexcept {
  const double physical = (value - signal.offset) / signal.scale;
  static_cast<void>(signal.codec.encode_physical(payload_of(frame), physical));
}

void protect_again(const MessageProtection& protection, CanFrame& frame) noexcept {
  if (protection.is_none() || !is_whole(protection, frame)) return;
  const std::uint64_t count = protection.has_counter() ? protection.count(frame.payload()) : 0;
  protection.write(payload_of(frame), count);
}

std::optional<std::uint64_t> count_before(const MessageProtection& protection,
                                          const CanFrame& frame) noexcept {
  if (!protection.has_counter() || !is_whole(protection, frame)) return std::nullopt;
  const std::uint64_t count = protection.count(frame.payload());
  return count == 0 ? protection.last_count : count - 1;
}

void set_count(const MessageProtection& protection, std::uint64_t count, CanFrame& frame) noexcept {
  if (is_whole(protection, frame)) protection.write(payload_of(frame), count);
}

void invert_checksum(const MessageProtection& protection, CanFrame& frame) noexcept {
  if (!protection.has_crc() || !is_whole(protection, frame)) return;
  const std::size_t bytes = protection.profile == ProtectionProfile::kE2eP05 ? 2 : 1;
  for (std::size_t n = 0; n < bytes; ++n) {
    std::uint8_t& byte = frame.data[protection.crc_byte + n];
    byte = static_cast<std::uint8_t>(~byte);
  }
}

void set_length(std::size_t length, CanFrame& frame) noexcept {
  std::size_t possible = std::min(length, kMaxClassicPayload);
  if (frame.is_fd) {
    for (const std::size_t fd_length : kFdLengths) {
      if (fd_length <= length) possible = fd_length;
    }
  }
  if (possible < frame.length) {
    std::fill(frame.data.begin() + static_cast<std::ptrdiff_t>(possible),
              frame.data.begin() + frame.length, std::uint8_t{0});
  }
  frame.length = static_cast<std::uint8_t>(possible);
}

}  // namespace faultline
