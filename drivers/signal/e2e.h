#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace faultline {

// Checksums of AUTOSAR's end-to-end protection (Specification of the E2E Protocol, AUTOSAR
// Foundation; profiles 1, 2 and 5). Each covers the payload but the checksum's own bytes, in
// order; what differs is the CRC and how the data id joins in. The id is not sent (of profile 1C:
// a nibble of it), so that a frame of another message with the same layout does not pass.

/// How profile 1 puts the data id into the CRC.
enum class E2eP01Variant {
  kBoth,         ///< 1A: low byte, high byte
  kAlternating,  ///< 1B: with an even counter the low byte, with an odd one the high byte
  kNibble,       ///< 1C: low byte, zero; the high byte's low nibble is part of the payload
};

/// Profile 1: the data id's bytes, then the payload, through CRC-8 0x1D. The register begins with
/// 0 and is not inverted at the end: the specification calls Crc_CalculateCRC8 with start value
/// 0xFF but not as first call, and inverts what comes back, which undoes both of that function's
/// inversions.
/// @pre crc_byte < payload.size()
[[nodiscard]] std::uint8_t e2e_p01_crc(E2eP01Variant variant, std::uint16_t data_id,
                                       std::uint64_t counter, std::span<const std::uint8_t> payload,
                                       std::size_t crc_byte) noexcept;

/// Profile 2: the payload, then the data id of the frame's counter, through CRC-8 0x2F.
/// @pre crc_byte < payload.size()
[[nodiscard]] std::uint8_t e2e_p02_crc(std::uint8_t data_id, std::span<const std::uint8_t> payload,
                                       std::size_t crc_byte) noexcept;

/// Profile 5: the payload, then the data id, low byte first, through CRC-16/CCITT-FALSE. The frame
/// carries the checksum's low byte first, at `crc_byte`.
/// @pre crc_byte + 2 <= payload.size()
[[nodiscard]] std::uint16_t e2e_p05_crc(std::uint16_t data_id,
                                        std::span<const std::uint8_t> payload,
                                        std::size_t crc_byte) noexcept;

}  // namespace faultline
