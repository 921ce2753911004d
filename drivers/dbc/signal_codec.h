#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

enum class CodecStatus {
  kOk,
  kPayloadTooShort,  ///< the signal lies (partly) beyond the payload; nothing was read or written
  kOutOfRange,       ///< encode: the value does not fit; the nearest that fits was written
  kNotANumber,       ///< encode: NaN; decode: NaN or infinite; nothing was read or written
};

/// One signal compiled for reading and writing payloads: bounds-checked against the payload that is
/// really there, allocation-free, a few nanoseconds a call.
///
///   physical = raw·factor + offset
///
/// `minimum` and `maximum` of the signal are not enforced: they describe, they do not limit.
/// A codec made by the default constructor has no bits; every call says kPayloadTooShort.
class SignalCodec {
 public:
  SignalCodec() = default;
  /// @throws std::invalid_argument zero factor, factor or offset not finite, no bits, more than 64,
  ///   past a 64-byte payload, a float that has not 32 or 64 bits.
  explicit SignalCodec(const DbcSignal& signal);

  /// Raw bits, sign-extended for signed signals (floats: their bit pattern).
  [[nodiscard]] CodecStatus decode_raw(std::span<const std::uint8_t> payload,
                                       std::int64_t& raw) const noexcept;
  [[nodiscard]] CodecStatus decode_physical(std::span<const std::uint8_t> payload,
                                            double& physical) const noexcept;

  /// Writes the low bits of `raw`; other bits of the payload stay.
  [[nodiscard]] CodecStatus encode_raw(std::span<std::uint8_t> payload,
                                       std::int64_t raw) const noexcept;
  /// raw = (physical - offset)/factor, rounded to the nearest integer (ties to even) and clamped to
  /// what the bits can hold (kOutOfRange); for floats the nearest finite float.
  [[nodiscard]] CodecStatus encode_physical(std::span<std::uint8_t> payload,
                                            double physical) const noexcept;

  [[nodiscard]] std::uint16_t bit_count() const noexcept { return bit_count_; }
  [[nodiscard]] double factor() const noexcept { return factor_; }
  /// The step between neighbouring physical values: |factor|; 0 for a float.
  [[nodiscard]] double resolution() const noexcept {
    const bool is_float = type_ == SignalType::kFloat32 || type_ == SignalType::kFloat64;
    return is_float ? 0.0 : std::abs(factor_);
  }

 private:
  /// The bytes of the signal as they lie in the payload: the first eight in `word`, the first of
  /// them lowest, and the ninth, if there is one.
  struct Window {
    std::uint64_t word = 0;
    std::uint8_t ninth = 0;
  };

  [[nodiscard]] bool fits_in(std::span<const std::uint8_t> payload) const noexcept {
    return bit_count_ != 0 && payload.size() >= std::size_t{first_byte_} + byte_count_;
  }
  [[nodiscard]] std::uint64_t read_bits(std::span<const std::uint8_t> payload) const noexcept;
  void write_bits(std::span<std::uint8_t> payload, std::uint64_t bits) const noexcept;
  [[nodiscard]] Window place(std::uint64_t bits) const noexcept;
  [[nodiscard]] std::int64_t sign_extended(std::uint64_t bits) const noexcept;
  [[nodiscard]] double bits_to_number(std::uint64_t bits) const noexcept;
  [[nodiscard]] CodecStatus number_to_bits(double number, std::uint64_t& bits) const noexcept;

  std::uint64_t mask_ = 0;      ///< bit_count_ ones
  std::uint64_t sign_bit_ = 0;  ///< 0 for unsigned
  double factor_ = 1.0;
  double offset_ = 0.0;
  double least_ = 0.0;   ///< least number the raw value can hold
  double beyond_ = 0.0;  ///< integers: the first number too large; floats: the largest number
  std::uint16_t bit_count_ = 0;
  std::uint8_t first_byte_ = 0;
  std::uint8_t byte_count_ = 0;  ///< 1 to 9
  std::uint8_t shift_ = 0;       ///< bits of the last (Intel: first) byte below the signal's lowest
  ByteOrder byte_order_ = ByteOrder::kLittleEndian;
  SignalType type_ = SignalType::kUnsigned;
};

}  // namespace faultline
