#include "drivers/signal/crc.h"

#include <array>
#include <cstddef>

namespace faultline {
namespace {

/// Register after one byte, by that byte, from a register of zero.
template <class Word>
using CrcTable = std::array<Word, 256>;

template <class Word>
consteval CrcTable<Word> make_table(Word polynomial) {
  constexpr unsigned kBits = 8 * sizeof(Word);
  CrcTable<Word> table{};
  for (std::size_t byte = 0; byte < table.size(); ++byte) {
    auto word = static_cast<Word>(byte << (kBits - 8));
    for (int bit = 0; bit < 8; ++bit) {
      const bool carry = (word >> (kBits - 1)) != 0;
      word = static_cast<Word>(word << 1);
      if (carry) word = static_cast<Word>(word ^ polynomial);
    }
    table[byte] = word;
  }
  return table;
}

template <class Word>
Word extend(const CrcTable<Word>& table, Word start, std::span<const std::uint8_t> bytes) noexcept {
  constexpr unsigned kTopByte = 8 * (sizeof(Word) - 1);
  unsigned word = start;
  for (const std::uint8_t byte : bytes) {
    const unsigned top = ((word >> kTopByte) ^ byte) & 0xFF;
    word = (word << 8) ^ table[top];
  }
  return static_cast<Word>(word);
}

constexpr CrcTable<std::uint8_t> kTable1d = make_table<std::uint8_t>(0x1D);
constexpr CrcTable<std::uint8_t> kTable2f = make_table<std::uint8_t>(0x2F);
constexpr CrcTable<std::uint16_t> kTable1021 = make_table<std::uint16_t>(0x1021);

}  // namespace

std::uint8_t extend_crc8_1d(std::uint8_t start, std::span<const std::uint8_t> bytes) noexcept {
  return extend(kTable1d, start, bytes);
}

std::uint8_t extend_crc8_2f(std::uint8_t start, std::span<const std::uint8_t> bytes) noexcept {
  return extend(kTable2f, start, bytes);
}

std::uint16_t extend_crc16_1021(std::uint16_t start, std::span<const std::uint8_t> bytes) noexcept {
  return extend(kTable1021, start, bytes);
}

std::uint8_t crc8_j1850(std::span<const std::uint8_t> bytes) noexcept {
  return static_cast<std::uint8_t>(extend_crc8_1d(0xFF, bytes) ^ 0xFF);
}

std::uint8_t crc8_h2f(std::span<const std::uint8_t> bytes) noexcept {
  return static_cast<std::uint8_t>(extend_crc8_2f(0xFF, bytes) ^ 0xFF);
}

std::uint16_t crc16_ccitt_false(std::span<const std::uint8_t> bytes) noexcept {
  return extend_crc16_1021(0xFFFF, bytes);
}

}  // namespace faultline
