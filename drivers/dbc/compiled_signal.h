#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

/// Where a signal's bits lie in a payload, and what they mean: what SignalCodec and MessageCodec
/// are made of.
///
///   physical = raw·F + O, F and O the decimal numbers of the DBC text
///            = fma(raw, factor, offset) + fma(raw, factor_rest, offset_rest)
///
/// with F = factor + factor_rest, O = offset + offset_rest: a product and a sum of plain doubles
/// would lose all digits where raw·F and O nearly cancel. The result is within 2 ulp of the exact
/// one, also there.
struct CompiledSignal {
  double factor = 1.0;
  double offset = 0.0;
  double factor_rest = 0.0;
  double offset_rest = 0.0;
  std::uint64_t mask = 0;      ///< bit_count ones
  std::uint64_t sign_bit = 0;  ///< 0 for unsigned
  double least = 0.0;          ///< least number the raw value can hold
  double beyond = 0.0;         ///< integers: the first one too large; floats: the largest
  std::uint16_t bit_count = 0;
  std::uint8_t first_byte = 0;
  std::uint8_t byte_count = 0;  ///< 1 to 9
  std::uint8_t shift = 0;       ///< bits of the last (Intel: first) byte below the signal's lowest
  ByteOrder byte_order = ByteOrder::kLittleEndian;
  SignalType type = SignalType::kUnsigned;

  [[nodiscard]] bool is_float() const noexcept {
    return type == SignalType::kFloat32 || type == SignalType::kFloat64;
  }
  [[nodiscard]] std::size_t bytes_needed() const noexcept {
    return std::size_t{first_byte} + byte_count;
  }
  [[nodiscard]] bool fits_in(std::span<const std::uint8_t> payload) const noexcept {
    return bit_count != 0 && payload.size() >= bytes_needed();
  }

  /// The signal's bits, lowest first. @pre fits_in(payload)
  [[nodiscard]] std::uint64_t read(std::span<const std::uint8_t> payload) const noexcept;
  /// @pre fits_in(payload); bits within mask
  void write(std::span<std::uint8_t> payload, std::uint64_t bits) const noexcept;
  [[nodiscard]] std::int64_t sign_extended(std::uint64_t bits) const noexcept {
    return static_cast<std::int64_t>((bits ^ sign_bit) - sign_bit);
  }
  /// Not finite for a float that is not.
  [[nodiscard]] double to_physical(std::uint64_t bits) const noexcept;

  enum class Fit : std::uint8_t { kFits, kClamped, kNotANumber };
  /// Nearest raw value, clamped to what the bits hold; unchanged for NaN.
  [[nodiscard]] Fit to_bits(double physical, std::uint64_t& bits) const noexcept;

 private:
  [[nodiscard]] double wide_to_physical(std::uint64_t bits) const noexcept;
};

/// physical of a raw value that a double holds. Explicitly fused: every build gives the same bits.
[[nodiscard]] inline double scaled(double raw, double factor, double offset, double factor_rest,
                                   double offset_rest) noexcept {
  return std::fma(raw, factor, offset) + std::fma(raw, factor_rest, offset_rest);
}

/// Why `signal` has no bits that can be read: none or more than 64, or beyond a 64-byte payload.
/// Empty if it has.
[[nodiscard]] std::string layout_fault(const DbcSignal& signal);
/// Why `signal` has no physical value, also if its bits can be read. Empty if it has.
[[nodiscard]] std::string value_fault(const DbcSignal& signal);

/// @pre layout_fault(signal) is empty. With a value_fault, physical values are without meaning.
[[nodiscard]] CompiledSignal compile_signal(const DbcSignal& signal);

}  // namespace faultline
