#pragma once

#include <cstdint>
#include <span>

namespace faultline {

// Cyclic redundancy checks as they are used on CAN: most significant bit first, not reflected.

/// The register of a CRC with polynomial x⁸+x⁴+x³+x²+1 (0x1D) after `bytes`, from `start` on.
[[nodiscard]] std::uint8_t extend_crc8_1d(std::uint8_t start,
                                          std::span<const std::uint8_t> bytes) noexcept;
/// With x⁸+x⁵+x³+x²+x+1 (0x2F).
[[nodiscard]] std::uint8_t extend_crc8_2f(std::uint8_t start,
                                          std::span<const std::uint8_t> bytes) noexcept;
/// With x¹⁶+x¹²+x⁵+1 (0x1021).
[[nodiscard]] std::uint16_t extend_crc16_1021(std::uint16_t start,
                                              std::span<const std::uint8_t> bytes) noexcept;

/// CRC-8 SAE J1850: 0x1D from 0xFF on, inverted. Of "123456789": 0x4B. AUTOSAR: Crc_CalculateCRC8.
[[nodiscard]] std::uint8_t crc8_j1850(std::span<const std::uint8_t> bytes) noexcept;
/// CRC-8 0x2F from 0xFF on, inverted. Of "123456789": 0xDF. AUTOSAR: Crc_CalculateCRC8H2F.
[[nodiscard]] std::uint8_t crc8_h2f(std::span<const std::uint8_t> bytes) noexcept;
/// CRC-16/CCITT-FALSE: 0x1021 from 0xFFFF on. Of "123456789": 0x29B1. AUTOSAR: Crc_CalculateCRC16.
[[nodiscard]] std::uint16_t crc16_ccitt_false(std::span<const std::uint8_t> bytes) noexcept;

}  // namespace faultline
