#pragma once

#include <chrono>
#include <cstdint>

#include "drivers/can/can_frame.h"

namespace faultline {

/// Length of a frame on the wire in bits, by the rate they go at.
struct FrameBits {
  std::uint32_t nominal = 0;  ///< at the bit rate of arbitration
  std::uint32_t data = 0;     ///< at the data bit rate; 0 but for FD frames with BRS

  friend bool operator==(const FrameBits&, const FrameBits&) = default;
};

/// Bits that `frame` takes on the wire, stuff bits counted one by one, from its start of frame to
/// the end of the three bits of intermission behind it.
///
/// Classic: SOF, identifier, control, data and CRC-15, with a bit of opposite value stuffed in
/// behind each five equal ones; then 13 bits without stuffing (CRC delimiter, acknowledgement and
/// its delimiter, 7 of end of frame, 3 of intermission). FD: stuffed likewise to the end of the
/// data; then stuff count (4 bits) and CRC-17, or CRC-21 from 17 bytes on, with a fixed stuff bit
/// in front and behind each four bits; then the same 13. With BRS the bits after the BRS bit to the
/// CRC delimiter are data bits; truly the rate changes at the sample point of the BRS bit and back
/// at that of the CRC delimiter, which comes to the same time if both rates have the same one.
///
/// An FD payload whose length no DLC stands for is padded with zeros to the next. An error frame is
/// none on the wire and has no bits. @pre is_well_formed(frame).
///
/// Source: ISO 11898-1:2015, 10.4 (frames) and 10.5 (bit stuffing); sizes of fields as in Linux,
/// linux/can/length.h. Assumes no error, no overload
/// frame, and the edge of the acknowledgement in its own bit.
[[nodiscard]] FrameBits frame_bits(const CanFrame& frame) noexcept;

/// How long `bits` occupy the bus. @pre bit_rate_Hz > 0; data_bit_rate_Hz > 0 if there are data
/// bits.
[[nodiscard]] std::chrono::nanoseconds frame_time(const FrameBits& bits, double bit_rate_Hz,
                                                  double data_bit_rate_Hz = 0.0) noexcept;

/// Bytes that an FD frame with a payload of `length` has on the wire: the next of 0 to 8, 12, 16,
/// 20, 24, 32, 48, 64. @pre length <= kMaxPayload.
[[nodiscard]] std::uint8_t padded_fd_length(std::uint8_t length) noexcept;

}  // namespace faultline
