#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "drivers/dbc/compiled_signal.h"
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
///   physical = raw·factor + offset      (factor and offset: the decimal numbers of the DBC text)
///
/// Decoding is right to 2 ulp, and encoding what was decoded gives the same raw value back, for raw
/// values of up to 53 bits (as far as |offset/factor| leaves the double room for them). A raw value
/// of more bits has no double of its own: several give the same physical value, and encoding that
/// gives one of them; decode_raw and encode_raw keep all 64.
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

  [[nodiscard]] std::uint16_t bit_count() const noexcept { return signal_.bit_count; }
  [[nodiscard]] double factor() const noexcept { return signal_.factor; }
  /// The step between neighbouring physical values: |factor|; 0 for a float.
  [[nodiscard]] double resolution() const noexcept {
    return signal_.is_float() ? 0.0 : std::abs(signal_.factor);
  }

 private:
  CompiledSignal signal_;
};

}  // namespace faultline
