#include "drivers/dbc/compiled_signal.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>

#include <fmt/format.h>

#include "drivers/dbc/exact_decimal.h"

namespace faultline {
namespace {

constexpr std::size_t kWordBytes = sizeof(std::uint64_t);
constexpr std::size_t kLargestPayload = 64;  // CAN FD
/// Up to here two roundings stay below half a step of the raw value, so that encoding finds it
/// back.
constexpr int kPlainBits = 51;

__extension__ using Wide = __int128;

/// sum + error is exactly a + b (D. E. Knuth, The Art of Computer Programming 2, 4.2.2).
struct Sum {
  double sum = 0.0;
  double error = 0.0;
};

Sum exact_sum(double a, double b) noexcept {
  const double sum = a + b;
  const double b_part = sum - a;
  return {sum, (a - (sum - b_part)) + (b - b_part)};
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

/// The bytes of a signal as they lie in the payload: the first eight in `word`, the first of them
/// lowest, and the ninth, if there is one.
struct Window {
  std::uint64_t word = 0;
  std::uint8_t ninth = 0;
};

Window place(const CompiledSignal& signal, std::uint64_t bits) noexcept {
  const bool has_ninth = signal.byte_count > kWordBytes;
  const int shift = signal.shift;
  if (signal.byte_order == ByteOrder::kLittleEndian) {
    const std::uint64_t ninth = has_ninth ? bits >> (64 - shift) : 0;
    return {bits << shift, static_cast<std::uint8_t>(ninth)};
  }
  if (has_ninth) {
    return {__builtin_bswap64(bits >> (8 - shift)),
            static_cast<std::uint8_t>((bits << shift) & 0xFF)};
  }
  return {__builtin_bswap64(bits << (64 - 8 * signal.byte_count + shift)), 0};
}

/// Makes zero come out as exactly zero where the decimals say so: rounding the rests leaves an
/// error near 2^-106, which is not within any fraction of zero.
void settle_root(CompiledSignal& signal) {
  double root = 0.0;
  if (!find_decimal_root(signal.factor, signal.offset, root)) return;
  if (root < signal.least || root >= signal.beyond) return;
  const auto bits = static_cast<std::uint64_t>(static_cast<std::int64_t>(root)) & signal.mask;
  // The rests are right to half a unit in the last place, so a few units reach.
  constexpr int kMostSteps = 8;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const double before = signal.offset_rest;
  for (int n = 0; n < kMostSteps && signal.to_physical(bits) != 0.0; ++n) {
    const double towards = signal.to_physical(bits) > 0.0 ? -kInfinity : kInfinity;
    signal.offset_rest = std::nextafter(signal.offset_rest, towards);
  }
  if (signal.to_physical(bits) != 0.0) signal.offset_rest = before;
}

}  // namespace

std::string layout_fault(const DbcSignal& signal) {
  if (signal.bit_count < 1 || signal.bit_count > 64) {
    return fmt::format("{} bits, expected 1 to 64", signal.bit_count);
  }
  if (payload_bytes_needed(signal) > kLargestPayload) {
    return fmt::format("start bit {} and {} bits, expected it to end within {} bytes",
                       signal.start_bit, signal.bit_count, kLargestPayload);
  }
  return {};
}

std::string value_fault(const DbcSignal& signal) {
  if (signal.factor == 0.0 || !std::isfinite(signal.factor)) {
    return fmt::format("factor {}, expected a finite number other than zero", signal.factor);
  }
  if (!std::isfinite(signal.offset)) {
    return fmt::format("offset {}, expected a finite number", signal.offset);
  }
  if ((signal.type == SignalType::kFloat32 && signal.bit_count != 32) ||
      (signal.type == SignalType::kFloat64 && signal.bit_count != 64)) {
    return fmt::format("a float of {} bits, expected {}", signal.bit_count,
                       signal.type == SignalType::kFloat32 ? 32 : 64);
  }
  return {};
}

CompiledSignal compile_signal(const DbcSignal& signal) {
  CompiledSignal compiled;
  compiled.byte_order = signal.byte_order;
  compiled.type = signal.type;
  compiled.bit_count = signal.bit_count;
  compiled.mask = ~std::uint64_t{0} >> (64 - signal.bit_count);
  const std::uint64_t top_bit = std::uint64_t{1} << (signal.bit_count - 1);
  compiled.sign_bit = signal.type == SignalType::kSigned ? top_bit : 0;
  const std::size_t first_byte = signal.start_bit / 8;
  const std::size_t byte_count = payload_bytes_needed(signal) - first_byte;
  compiled.first_byte = static_cast<std::uint8_t>(first_byte);
  compiled.byte_count = static_cast<std::uint8_t>(byte_count);
  if (signal.byte_order == ByteOrder::kLittleEndian) {
    compiled.shift = static_cast<std::uint8_t>(signal.start_bit % 8);
  } else {
    const std::size_t bits_above = 7 - signal.start_bit % 8;
    compiled.shift = static_cast<std::uint8_t>(8 * byte_count - bits_above - signal.bit_count);
  }
  if (compiled.is_float()) {
    compiled.beyond = signal.type == SignalType::kFloat32
                          ? static_cast<double>(std::numeric_limits<float>::max())
                          : std::numeric_limits<double>::max();
    compiled.least = -compiled.beyond;
  } else {
    compiled.least = -static_cast<double>(compiled.sign_bit);
    compiled.beyond = std::ldexp(1.0, signal.bit_count) + compiled.least;
  }
  if (!value_fault(signal).empty()) return compiled;
  const ExactDecimal factor = exact_decimal(signal.factor);
  const ExactDecimal offset = exact_decimal(signal.offset);
  compiled.factor = factor.value;
  compiled.factor_rest = factor.rest;
  compiled.offset = offset.value;
  compiled.offset_rest = offset.rest;
  if (!compiled.is_float()) {
    settle_root(compiled);
  } else if (compiled.offset == 0.0) {
    // Adding +0 would take the sign of a float's -0 away, and encoding would not give it back.
    compiled.offset = compiled.offset_rest = -0.0;
  }
  return compiled;
}

std::uint64_t CompiledSignal::read(std::span<const std::uint8_t> payload) const noexcept {
  const std::span<const std::uint8_t> bytes = payload.subspan(first_byte);
  const bool has_ninth = byte_count > kWordBytes;
  const std::uint64_t word = load_word(bytes, has_ninth ? kWordBytes : byte_count);
  std::uint64_t bits = 0;
  if (byte_order == ByteOrder::kLittleEndian) {
    bits = word >> shift;
    if (has_ninth) bits |= std::uint64_t{bytes[kWordBytes]} << (64 - shift);
  } else if (has_ninth) {
    bits = __builtin_bswap64(word) << (8 - shift) | std::uint64_t{bytes[kWordBytes]} >> shift;
  } else {
    bits = __builtin_bswap64(word) >> (64 - 8 * byte_count + shift);
  }
  return bits & mask;
}

void CompiledSignal::write(std::span<std::uint8_t> payload, std::uint64_t bits) const noexcept {
  const std::span<std::uint8_t> bytes = payload.subspan(first_byte);
  const Window ours = place(*this, mask);
  const Window value = place(*this, bits);
  const auto merge = [](std::uint8_t& byte, std::uint64_t our_bits, std::uint64_t new_bits) {
    byte = static_cast<std::uint8_t>((byte & ~our_bits) | new_bits);
  };
  for (std::size_t n = 0; n < byte_count && n < kWordBytes; ++n) {
    merge(bytes[n], (ours.word >> (8 * n)) & 0xFF, (value.word >> (8 * n)) & 0xFF);
  }
  if (byte_count > kWordBytes) merge(bytes[kWordBytes], ours.ninth, value.ninth);
}

/// Of wide integers, which a double may not even hold: every product and sum with its rounding
/// error, and one rounding at the end.
double CompiledSignal::wide_to_physical(std::uint64_t bits) const noexcept {
  constexpr std::uint64_t kLow = (std::uint64_t{1} << 32) - 1;
  const double high = type == SignalType::kSigned
                          ? static_cast<double>(sign_extended(bits) & ~std::int64_t{kLow})
                          : static_cast<double>(bits & ~kLow);
  const auto low = static_cast<double>(bits & kLow);
  const double high_part = high * factor;
  const double low_part = low * factor;
  const Sum with_offset = exact_sum(high_part, offset);
  const Sum all = exact_sum(with_offset.sum, low_part);
  const double rounding = (std::fma(high, factor, -high_part) + with_offset.error) +
                          (std::fma(low, factor, -low_part) + all.error);
  return all.sum + (rounding + std::fma(high + low, factor_rest, offset_rest));
}

double CompiledSignal::to_physical(std::uint64_t bits) const noexcept {
  double raw = 0.0;
  if (type == SignalType::kFloat32) {
    raw = static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(bits)));
  } else if (type == SignalType::kFloat64) {
    raw = std::bit_cast<double>(bits);
  } else if (bit_count <= kPlainBits) {
    raw = static_cast<double>(sign_extended(bits));
  } else {
    return wide_to_physical(bits);
  }
  return scaled(raw, factor, offset, factor_rest, offset_rest);
}

CompiledSignal::Fit CompiledSignal::to_bits(double physical, std::uint64_t& bits) const noexcept {
  if (std::isnan(physical)) return Fit::kNotANumber;
  // Without this, -0 would lose its sign.
  const Sum wanted = offset == 0.0 ? Sum{physical, 0.0} : exact_sum(physical, -offset);
  const double first = wanted.sum / factor;
  // What is left of the quotient `raw`, in steps of the raw value.
  const auto rest_of = [&](double raw) {
    return (std::fma(-raw, factor, wanted.sum) +
            (wanted.error - std::fma(raw, factor_rest, offset_rest))) /
           factor;
  };
  if (is_float()) {
    const double rest = std::isfinite(first) ? rest_of(first) : 0.0;
    const double number = rest != 0.0 ? first + rest : first;
    const double clamped = std::clamp(number, least, beyond);
    bits = type == SignalType::kFloat32 ? std::bit_cast<std::uint32_t>(static_cast<float>(clamped))
                                        : std::bit_cast<std::uint64_t>(clamped);
    return clamped == number ? Fit::kFits : Fit::kClamped;
  }
  // 64 bits and a correction fit, and what is far beyond them is clamped anyway.
  constexpr double kFar = 0x1p70;
  const double rounded = std::rint(std::clamp(first, -kFar, kFar));
  const double rest = std::abs(rounded) < kFar ? rest_of(rounded) : 0.0;
  auto raw = static_cast<Wide>(rounded);
  if (std::abs(rest) > 0.5) {
    raw += static_cast<Wide>(std::rint(std::clamp(rest, -kFar, kFar)));
  } else if (std::abs(rest) == 0.5 && (raw & 1) != 0) {
    raw += rest > 0.0 ? 1 : -1;  // a tie goes to the even raw value
  }
  const Wide least_raw = -static_cast<Wide>(sign_bit);
  const Wide most_raw = static_cast<Wide>(mask ^ sign_bit);
  bits = static_cast<std::uint64_t>(std::clamp(raw, least_raw, most_raw)) & mask;
  return raw < least_raw || raw > most_raw ? Fit::kClamped : Fit::kFits;
}

}  // namespace faultline
