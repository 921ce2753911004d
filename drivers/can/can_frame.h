#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>

namespace faultline {

/// Time at which the kernel (or the loop bus's clock) received a frame: CLOCK_REALTIME.
using Timestamp = std::chrono::time_point<std::chrono::system_clock, std::chrono::nanoseconds>;

/// Longest payload of a CAN FD frame, in bytes (ISO 11898-1:2015).
inline constexpr std::size_t kMaxPayload = 64;
/// Longest payload of a classic CAN frame, in bytes.
inline constexpr std::size_t kMaxClassicPayload = 8;

/// Largest 11-bit and 29-bit identifier.
inline constexpr std::uint32_t kMaxStandardId = 0x7FF;
inline constexpr std::uint32_t kMaxExtendedId = 0x1FFF'FFFF;

/// One frame on a CAN bus, classic or FD, with its receive time. Plain data; copying is cheap.
///
/// Invariant kept by every bus: `length` <= 8 for classic frames, <= 64 for FD frames; bytes of
/// `data` from `length` on are zero.
struct CanFrame {
  Timestamp stamp{};                  ///< receive time; ignored on sending
  std::uint32_t id = 0;               ///< 11 or 29 bits, no flag bits
  std::uint8_t length = 0;            ///< payload bytes
  std::uint8_t bus = 0;               ///< which bus of several (BusGroup); 0 where there is one
  bool is_extended = false;           ///< 29-bit identifier
  bool is_fd = false;                 ///< CAN FD frame
  bool is_bit_rate_switched = false;  ///< FD only: BRS
  bool is_error_state = false;        ///< FD only: ESI
  bool is_remote = false;             ///< classic only: RTR
  bool is_error = false;              ///< error frame made by the controller; `id` is its class,
                                      ///< neither extended nor remote (error_frame.h)
  std::array<std::uint8_t, kMaxPayload> data{};

  /// View of the payload; valid as long as the frame.
  [[nodiscard]] std::span<const std::uint8_t> payload() const noexcept {
    return {data.data(), length};
  }

  /// True if `a` and `b` are the same frame on the wire; receive time and bus do not count.
  [[nodiscard]] friend bool same_on_wire(const CanFrame& a, const CanFrame& b) noexcept {
    return a.id == b.id && a.length == b.length && a.is_extended == b.is_extended &&
           a.is_fd == b.is_fd && a.is_bit_rate_switched == b.is_bit_rate_switched &&
           a.is_error_state == b.is_error_state && a.is_remote == b.is_remote &&
           a.is_error == b.is_error && a.data == b.data;
  }
};

/// True if a bus can carry `frame`: identifier and length within its format, FD flags only on FD
/// frames, remote only on classic ones, error frames of no other kind. Every bus refuses (and
/// counts) any other frame.
[[nodiscard]] inline bool is_well_formed(const CanFrame& frame) noexcept {
  const bool has_fd_flag = frame.is_bit_rate_switched || frame.is_error_state;
  return frame.id <= (frame.is_extended || frame.is_error ? kMaxExtendedId : kMaxStandardId) &&
         frame.length <= (frame.is_fd ? kMaxPayload : kMaxClassicPayload) &&
         (frame.is_fd ? !frame.is_remote && !frame.is_error : !has_fd_flag) &&
         !(frame.is_error && (frame.is_extended || frame.is_remote));
}

}  // namespace faultline
