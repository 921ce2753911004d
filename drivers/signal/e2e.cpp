#include "drivers/signal/e2e.h"

#include <array>

#include "drivers/signal/crc.h"

namespace faultline {
namespace {

std::array<std::uint8_t, 2> bytes_of(std::uint16_t data_id) noexcept {
  return {static_cast<std::uint8_t>(data_id & 0xFF), static_cast<std::uint8_t>(data_id >> 8)};
}

std::uint8_t start_p01(E2eP01Variant variant, std::uint16_t data_id,
                       std::uint64_t counter) noexcept {
  std::array<std::uint8_t, 2> id = bytes_of(data_id);
  switch (variant) {
    case E2eP01Variant::kBoth:
      break;
    case E2eP01Variant::kAlternating:
      return extend_crc8_1d(0, std::span(id).subspan(counter % 2, 1));
    case E2eP01Variant::kNibble:
      id[1] = 0;
      break;
  }
  return extend_crc8_1d(0, id);
}

}  // namespace

std::uint8_t e2e_p01_crc(E2eP01Variant variant, std::uint16_t data_id, std::uint64_t counter,
                         std::span<const std::uint8_t> payload, std::size_t crc_byte) noexcept {
  const std::uint8_t before =
      extend_crc8_1d(start_p01(variant, data_id, counter), payload.first(crc_byte));
  return extend_crc8_1d(before, payload.subspan(crc_byte + 1));
}

std::uint8_t e2e_p02_crc(std::uint8_t data_id, std::span<const std::uint8_t> payload,
                         std::size_t crc_byte) noexcept {
  std::uint8_t word = extend_crc8_2f(0xFF, payload.first(crc_byte));
  word = extend_crc8_2f(word, payload.subspan(crc_byte + 1));
  return static_cast<std::uint8_t>(extend_crc8_2f(word, std::span(&data_id, 1)) ^ 0xFF);
}

std::uint16_t e2e_p05_crc(std::uint16_t data_id, std::span<const std::uint8_t> payload,
                          std::size_t crc_byte) noexcept {
  std::uint16_t word = extend_crc16_1021(0xFFFF, payload.first(crc_byte));
  word = extend_crc16_1021(word, payload.subspan(crc_byte + 2));
  return extend_crc16_1021(word, bytes_of(data_id));
}

}  // namespace faultline
