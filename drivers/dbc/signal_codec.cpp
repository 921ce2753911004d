#include "drivers/dbc/signal_codec.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>

namespace faultline {
namespace {

constexpr std::size_t kWordBytes = sizeof(std::uint64_t);
constexpr std::size_t kLargestPayload = 64;  // CAN FD

/// Checks that `signal` can be read and written. @throws std::invalid_argument
void require_codable(const DbcSignal& signal) {
  const auto refuse = [&](const std::string& what) {
    throw std::invalid_argument(fmt::format("signal {}: {}", signal.name, what));
  };
  if (signal.bit_count < 1 || signal.bit_count > 64) {
    refuse(fmt::format("{} bits, expected 1 to 64", signal.bit_count));
  }
  if (payload_bytes_needed(signal) > kLargestPayload) {
    refuse(fmt::format("start bit {} and {} bits, expected it to end within {} bytes",
                       signal.start_bit, signal.bit_count, kLargestPayload));
  }
  if (signal.factor == 0.0 || !std::isfinite(signal.factor)) {
    refuse(fmt::format("factor {}, expected a finite number other than zero", signal.factor));
  }
  if (!std::isfinite(signal.offset)) {
    refuse(fmt::format("offset {}, expected a finite number", signal.offset));
  }
  if ((signal.type == SignalType::kFloat32 && signal.bit_count != 32) ||
      (signal.type == SignalType::kFloat64 && signal.bit_count != 64)) {
    refuse(fmt::format("a float of {} bits, expected {}", signal.bit_count,
                       signal.type == SignalType::kFloat32 ? 32 : 64));
  }
}

/// The first `count` of `bytes` as one number, the first byte lowest. What lies above them in the
/// number is unspecified. @pre count <= 8, count <= bytes.size()
std::uint64_t load_word(std::span<const std::uint8_t> bytes, std::size_t count) noexcept {
  std::uint64_t word = 0;
  if (std::endian::native == std::endian::little && bytes.size() >= kWordBytes) {
    std::memcpy(&word, bytes.data(), kWordBytes);
    return word;
  }
  for (std::size_t n = 0; n < count; ++n) word |= std::uint64_t{bytes[n]} << (8 * n);
  return word;
}

}  // namespace

SignalCodec::SignalCodec(const DbcSignal& signal) {
  require_codable(signal);
  byte_order_ = signal.byte_order;
  type_ = signal.type;
  factor_ = signal.factor;
  offset_ = signal.offset;
  bit_count_ = signal.bit_count;
  mask_ = ~std::uint64_t{0} >> (64 - bit_count_);
  sign_bit_ = type_ == SignalType::kSigned ? std::uint64_t{1} << (bit_count_ - 1) : 0;
  if (type_ == SignalType::kFloat32 || type_ == SignalType::kFloat64) {
    beyond_ = type_ == SignalType::kFloat32 ? static_cast<double>(std::numeric_limits<float>::max())
                                            : std::numeric_limits<double>::max();
    least_ = -beyond_;
  } else {
    least_ = -static_cast<double>(sign_bit_);
    beyond_ = std::ldexp(1.0, bit_count_) + least_;
  }
  const std::size_t first_byte = signal.start_bit / 8;
  const std::size_t byte_count = payload_bytes_needed(signal) - first_byte;
  first_byte_ = static_cast<std::uint8_t>(first_byte);
  byte_count_ = static_cast<std::uint8_t>(byte_count);
  if (byte_order_ == ByteOrder::kLittleEndian) {
    shift_ = static_cast<std::uint8_t>(signal.start_bit % 8);
  } else {
    const std::size_t bits_above = 7 - signal.start_bit % 8;
    shift_ = static_cast<std::uint8_t>(8 * byte_count - bits_above - bit_count_);
  }
}

CodecStatus SignalCodec::decode_raw(std::span<const std::uint8_t> payload,
                                    std::int64_t& raw) const noexcept {
  if (!fits_in(payload)) return CodecStatus::kPayloadTooShort;
  raw = sign_extended(read_bits(payload));
  return CodecStatus::kOk;
}

CodecStatus SignalCodec::decode_physical(std::span<const std::uint8_t> payload,
                                         double& physical) const noexcept {
  if (!fits_in(payload)) return CodecStatus::kPayloadTooShort;
  const double value = bits_to_number(read_bits(payload)) * factor_ + offset_;
  if (!std::isfinite(value)) return CodecStatus::kNotANumber;
  physical = value;
  return CodecStatus::kOk;
}

CodecStatus SignalCodec::encode_raw(std::span<std::uint8_t> payload,
                                    std::int64_t raw) const noexcept {
  if (!fits_in(payload)) return CodecStatus::kPayloadTooShort;
  write_bits(payload, static_cast<std::uint64_t>(raw) & mask_);
  return CodecStatus::kOk;
}

CodecStatus SignalCodec::encode_physical(std::span<std::uint8_t> payload,
                                         double physical) const noexcept {
  if (!fits_in(payload)) return CodecStatus::kPayloadTooShort;
  std::uint64_t bits = 0;
  const CodecStatus status = number_to_bits((physical - offset_) / factor_, bits);
  if (status != CodecStatus::kNotANumber) write_bits(payload, bits);
  return status;
}

std::uint64_t SignalCodec::read_bits(std::span<const std::uint8_t> payload) const noexcept {
  const std::span<const std::uint8_t> bytes = payload.subspan(first_byte_);
  const bool has_ninth = byte_count_ > kWordBytes;
  const std::uint64_t word = load_word(bytes, has_ninth ? kWordBytes : byte_count_);
  std::uint64_t bits = 0;
  if (byte_order_ == ByteOrder::kLittleEndian) {
    bits = word >> shift_;
    if (has_ninth) bits |= std::uint64_t{bytes[kWordBytes]} << (64 - shift_);
  } else if (has_ninth) {
    bits = __builtin_bswap64(word) << (8 - shift_) | std::uint64_t{bytes[kWordBytes]} >> shift_;
  } else {
    bits = __builtin_bswap64(word) >> (64 - 8 * byte_count_ + shift_);
  }
  return bits & mask_;
}

SignalCodec::Window SignalCodec::place(std::uint64_t bits) const noexcept {
  const bool has_ninth = byte_count_ > kWordBytes;
  if (byte_order_ == ByteOrder::kLittleEndian) {
    const std::uint64_t ninth = has_ninth ? bits >> (64 - shift_) : 0;
    return {bits << shift_, static_cast<std::uint8_t>(ninth)};
  }
  if (has_ninth) {
    return {__builtin_bswap64(bits >> (8 - shift_)),
            static_cast<std::uint8_t>((bits << shift_) & 0xFF)};
  }
  return {__builtin_bswap64(bits << (64 - 8 * byte_count_ + shift_)), 0};
}

void SignalCodec::write_bits(std::span<std::uint8_t> payload, std::uint64_t bits) const noexcept {
  const std::span<std::uint8_t> bytes = payload.subspan(first_byte_);
  const Window ours = place(mask_);
  const Window value = place(bits);
  const auto merge = [](std::uint8_t& byte, std::uint64_t our_bits, std::uint64_t new_bits) {
    byte = static_cast<std::uint8_t>((byte & ~our_bits) | new_bits);
  };
  for (std::size_t n = 0; n < byte_count_ && n < kWordBytes; ++n) {
    merge(bytes[n], (ours.word >> (8 * n)) & 0xFF, (value.word >> (8 * n)) & 0xFF);
  }
  if (byte_count_ > kWordBytes) merge(bytes[kWordBytes], ours.ninth, value.ninth);
}

std::int64_t SignalCodec::sign_extended(std::uint64_t bits) const noexcept {
  return static_cast<std::int64_t>((bits ^ sign_bit_) - sign_bit_);
}

double SignalCodec::bits_to_number(std::uint64_t bits) const noexcept {
  switch (type_) {
    case SignalType::kUnsigned:
      return static_cast<double>(bits);
    case SignalType::kSigned:
      return static_cast<double>(sign_extended(bits));
    case SignalType::kFloat32:
      return static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(bits)));
    case SignalType::kFloat64:
      break;
  }
  return std::bit_cast<double>(bits);
}

CodecStatus SignalCodec::number_to_bits(double number, std::uint64_t& bits) const noexcept {
  if (std::isnan(number)) return CodecStatus::kNotANumber;
  if (type_ == SignalType::kFloat32 || type_ == SignalType::kFloat64) {
    const double clamped = std::clamp(number, least_, beyond_);
    bits = type_ == SignalType::kFloat32 ? std::bit_cast<std::uint32_t>(static_cast<float>(clamped))
                                         : std::bit_cast<std::uint64_t>(clamped);
    return clamped == number ? CodecStatus::kOk : CodecStatus::kOutOfRange;
  }
  // `beyond_` is a power of two and so exact; the largest raw value, 2^64 - 1 say, would not be.
  const double rounded = std::rint(number);
  if (rounded >= beyond_) {
    bits = mask_ ^ sign_bit_;
    return CodecStatus::kOutOfRange;
  }
  if (rounded < least_) {
    bits = sign_bit_;
    return CodecStatus::kOutOfRange;
  }
  bits = rounded >= 0x1p63 ? static_cast<std::uint64_t>(rounded)
                           : static_cast<std::uint64_t>(static_cast<std::int64_t>(rounded)) & mask_;
  return CodecStatus::kOk;
}

}  // namespace faultline
