#include "drivers/dbc/message_codec.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#if defined(__AVX__) && defined(__FMA__)
#include <immintrin.h>
#endif

namespace faultline {
namespace {

constexpr std::size_t kWordBytes = sizeof(std::uint64_t);
/// See to_doubles.
constexpr int kMostStepBits = 51;
/// Multiplexers may hang on one another this deep; the parser allows fewer.
constexpr int kMaxDepth = 16;

std::uint64_t load_word(const std::uint8_t* bytes) noexcept {
  std::uint64_t word = 0;
  std::memcpy(&word, bytes, kWordBytes);
  return std::endian::native == std::endian::little ? word : __builtin_bswap64(word);
}

/// Up to eight bytes as a number, the first lowest; what is missing is zero. No read past the end.
std::uint64_t load_up_to_word(std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.size() >= kWordBytes) return load_word(bytes.data());
  std::uint64_t word = 0;
  for (std::size_t n = 0; n < bytes.size(); ++n) word |= std::uint64_t{bytes[n]} << (8 * n);
  return word;
}

// Four numbers at once, in the compilers' own vectors: they need no instruction set in particular.
using Words [[gnu::vector_size(32)]] = std::uint64_t;
using Doubles [[gnu::vector_size(32)]] = double;

template <class Vector, class Lanes>
[[gnu::always_inline]] inline Vector load(const Lanes& lanes) noexcept {
  static_assert(sizeof(Vector) == sizeof lanes);
  Vector vector;
  std::memcpy(&vector, lanes.data(), sizeof vector);
  return vector;
}

/// a·b + c, rounded once.
[[gnu::always_inline]] inline Doubles fused(Doubles a, Doubles b, Doubles c) noexcept {
#if defined(__AVX__) && defined(__FMA__)
  return _mm256_fmadd_pd(a, b, c);
#else
  return Doubles{std::fma(a[0], b[0], c[0]), std::fma(a[1], b[1], c[1]), std::fma(a[2], b[2], c[2]),
                 std::fma(a[3], b[3], c[3])};
#endif
}

/// Whole numbers from -2^51 to 2^51 - 1 (two's complement) as doubles: added to the bits of
/// 1.5·2^52, whose last place is one, they make its sum with them.
[[gnu::always_inline]] inline Doubles to_doubles(Words whole) noexcept {
  constexpr double kBias = 0x1.8p52;
  Doubles sums;
  const Words bits = whole + std::bit_cast<std::uint64_t>(kBias);
  std::memcpy(&sums, &bits, sizeof sums);
  return sums - kBias;
}

/// @param words the eight bytes of each, the most significant highest
template <class Steps>
[[gnu::always_inline]] inline Doubles step_values(const Steps& steps, Words words) noexcept {
  const Words bits = (words << load<Words>(steps.left)) >> load<Words>(steps.right);
  const Words sign = load<Words>(steps.sign_bit);
  const Doubles raw = to_doubles((bits ^ sign) - sign);
  return fused(raw, load<Doubles>(steps.factor), load<Doubles>(steps.offset)) +
         fused(raw, load<Doubles>(steps.factor_rest), load<Doubles>(steps.offset_rest));
}

/// True if no raw value gives an infinity.
bool is_always_finite(const CompiledSignal& signal) noexcept {
  const double largest = std::max(-signal.least, signal.beyond);
  return std::isfinite(2.0 * (largest * std::abs(signal.factor) + std::abs(signal.offset)));
}

}  // namespace

MessageCodec::MessageCodec(const DbcMessage& message) {
  const std::size_t count = message.signals.size();
  signals_.reserve(count);
  for (const DbcSignal& source : message.signals) {
    Signal& signal = signals_.emplace_back();
    if (layout_fault(source).empty()) {
      signal.bits = compile_signal(source);
      signal.is_codable = value_fault(source).empty();
    }
    if (source.multiplexer < 0) continue;
    const bool has_multiplexer = static_cast<std::size_t>(source.multiplexer) < count;
    if (!has_multiplexer) signal.is_codable = false;
    signal.multiplexer = has_multiplexer ? source.multiplexer : DbcSignal::kAlwaysPresent;
    signal.first_range = static_cast<std::uint32_t>(ranges_.size());
    signal.range_count = static_cast<std::uint32_t>(source.multiplexer_ranges.size());
    ranges_.insert(ranges_.end(), source.multiplexer_ranges.begin(),
                   source.multiplexer_ranges.end());
  }
  for (Signal& signal : signals_) {
    int depth = 0;
    for (const Signal* at = &signal; at->multiplexer >= 0 && depth <= kMaxDepth; ++depth) {
      at = &signals_[static_cast<std::size_t>(at->multiplexer)];
      if (at->bits.bit_count == 0) signal.is_codable = false;
    }
    if (depth > kMaxDepth) signal.is_codable = false;
  }
  compile_steps();
}

void MessageCodec::compile_steps() {
  for (std::uint32_t n = 0; n < signals_.size(); ++n) {
    const CompiledSignal& bits = signals_[n].bits;
    const bool is_step = signals_[n].is_codable && signals_[n].multiplexer < 0 &&
                         !bits.is_float() && bits.bit_count <= kMostStepBits &&
                         bits.byte_count <= kWordBytes && is_always_finite(bits);
    if (!is_step) {
      others_.push_back(n);
      continue;
    }
    if (step_count_ % kLanes == 0) steps_.emplace_back();
    Steps& steps = steps_.back();
    const std::size_t lane = step_count_++ % kLanes;
    ++steps.count;
    steps.factor[lane] = bits.factor;
    steps.offset[lane] = bits.offset;
    steps.factor_rest[lane] = bits.factor_rest;
    steps.offset_rest[lane] = bits.offset_rest;
    steps.sign_bit[lane] = bits.sign_bit;
    steps.signal[lane] = n;
    const bool is_big_endian = bits.byte_order == ByteOrder::kBigEndian;
    steps.swap[lane] = is_big_endian ? ~std::uint64_t{0} : 0;
    // The word begins with the payload if it can; further on it ends with the signal, so that it
    // asks for no byte behind it.
    const std::size_t end = bits.bytes_needed();
    const std::size_t first_byte = end <= kWordBytes ? 0 : end - kWordBytes;
    steps.first_byte[lane] = static_cast<std::uint8_t>(first_byte);
    const std::size_t bytes_before = bits.first_byte - first_byte;
    const std::size_t bytes_behind = first_byte + kWordBytes - end;
    const std::size_t low_bits = bits.shift + 8 * (is_big_endian ? bytes_behind : bytes_before);
    steps.left[lane] = 64 - low_bits - bits.bit_count;
    steps.right[lane] = std::uint64_t{64} - bits.bit_count;
    step_bytes_needed_ = std::max(step_bytes_needed_, end);
  }
  is_one_word_ = others_.empty() && step_bytes_needed_ <= kWordBytes;
}

bool MessageCodec::is_selected_by(const Signal& signal, std::uint64_t value) const noexcept {
  const auto begin = ranges_.begin() + signal.first_range;
  const auto end = begin + signal.range_count;
  // Ascending: of the ranges that begin at or below the value the last decides.
  const auto above = std::upper_bound(
      begin, end, value,
      [](std::uint64_t wanted, const DbcMultiplexRange& range) { return wanted < range.first; });
  return above != begin && value <= std::prev(above)->last;
}

SignalPresence MessageCodec::selection(const Signal& signal,
                                       std::span<const std::uint8_t> payload) const noexcept {
  SignalPresence presence = SignalPresence::kPresent;
  for (const Signal* at = &signal; at->multiplexer >= 0;) {
    const Signal& multiplexer = signals_[static_cast<std::size_t>(at->multiplexer)];
    if (!multiplexer.bits.fits_in(payload)) {
      presence = SignalPresence::kBeyondPayload;
    } else if (!is_selected_by(*at, multiplexer.bits.read(payload))) {
      return SignalPresence::kNotSelected;
    }
    at = &multiplexer;
  }
  return presence;
}

SignalPresence MessageCodec::decode_signal(const Signal& signal,
                                           std::span<const std::uint8_t> payload,
                                           double& value) const noexcept {
  if (!signal.is_codable) return SignalPresence::kNotCodable;
  const SignalPresence presence = selection(signal, payload);
  if (presence != SignalPresence::kPresent) return presence;
  if (!signal.bits.fits_in(payload)) return SignalPresence::kBeyondPayload;
  const double physical = signal.bits.to_physical(signal.bits.read(payload));
  if (!std::isfinite(physical)) return SignalPresence::kNotANumber;
  value = physical;
  return SignalPresence::kPresent;
}

std::size_t MessageCodec::decode_any(std::span<const std::uint8_t> payload,
                                     std::span<double> values,
                                     std::span<SignalPresence> presence) const noexcept {
  std::size_t present = 0;
  const auto decode_one = [&](std::size_t n) {
    presence[n] = decode_signal(signals_[n], payload, values[n]);
    present += presence[n] == SignalPresence::kPresent ? 1u : 0u;
  };
  if (payload.size() < step_bytes_needed_) {
    for (std::size_t n = 0; n < signals_.size(); ++n) decode_one(n);
    return present;
  }
  const std::uint64_t first_word = load_up_to_word(payload);
  for (const Steps& steps : steps_) {
    const auto word = [&](std::size_t lane) {
      // A word that begins behind the first byte ends with its signal, within the payload.
      const std::size_t first_byte = steps.first_byte[lane];
      const std::uint64_t bytes =
          first_byte == 0 ? first_word : load_word(payload.data() + first_byte);
      return bytes ^ ((bytes ^ __builtin_bswap64(bytes)) & steps.swap[lane]);
    };
    const Doubles results = step_values(steps, Words{word(0), word(1), word(2), word(3)});
    for (std::size_t lane = 0; lane < steps.count; ++lane) {
      values[steps.signal[lane]] = results[lane];
      presence[steps.signal[lane]] = SignalPresence::kPresent;
    }
  }
  present = step_count_;
  for (const std::uint32_t n : others_) decode_one(n);
  return present;
}

std::size_t MessageCodec::decode(std::span<const std::uint8_t> payload, std::span<double> values,
                                 std::span<SignalPresence> presence) const noexcept {
  if (!is_one_word_ || payload.size() < kWordBytes) return decode_any(payload, values, presence);
  const std::uint64_t word = load_word(payload.data());
  const Words words = Words{} + word;
  const Words change = words ^ (Words{} + __builtin_bswap64(word));
  constexpr auto kPresent = SignalPresence::kPresent;
  double* value = values.data();
  SignalPresence* present = presence.data();
  for (const Steps& steps : steps_) {
    const Doubles results = step_values(steps, words ^ (change & load<Words>(steps.swap)));
    if (steps.count != kLanes) {  // the last
      for (std::size_t lane = 0; lane < steps.count; ++lane) present[lane] = kPresent;
      value[0] = results[0];
      if (steps.count > 1) value[1] = results[1];
      if (steps.count > 2) value[2] = results[2];
      break;
    }
    std::memcpy(value, &results, sizeof results);
    std::fill_n(present, kLanes, kPresent);
    value += kLanes;
    present += kLanes;
  }
  return step_count_;
}

bool MessageCodec::is_selected(const Signal& signal, std::span<const double> values,
                               std::span<const std::uint8_t> payload) const noexcept {
  for (const Signal* at = &signal; at->multiplexer >= 0;) {
    const auto n = static_cast<std::size_t>(at->multiplexer);
    const Signal& multiplexer = signals_[n];
    std::uint64_t bits = 0;
    const bool has_value = multiplexer.is_codable && multiplexer.bits.to_bits(values[n], bits) !=
                                                         CompiledSignal::Fit::kNotANumber;
    if (!has_value) {
      if (!multiplexer.bits.fits_in(payload)) return false;
      bits = multiplexer.bits.read(payload);
    }
    if (!is_selected_by(*at, bits)) return false;
    at = &multiplexer;
  }
  return true;
}

std::size_t MessageCodec::encode(std::span<const double> values, std::span<std::uint8_t> payload,
                                 OutOfRange out_of_range) const noexcept {
  // Counted first, written then: with kRefuse it is all or nothing.
  std::size_t misfits = 0;
  const auto for_each_selected = [&](auto&& use) {
    for (std::size_t n = 0; n < signals_.size(); ++n) {
      const Signal& signal = signals_[n];
      if (!signal.is_codable || !is_selected(signal, values, payload)) continue;
      std::uint64_t bits = 0;
      const bool fits_in = signal.bits.fits_in(payload);
      const auto fit =
          fits_in ? signal.bits.to_bits(values[n], bits) : CompiledSignal::Fit::kNotANumber;
      use(signal, fit, bits);
    }
  };
  const auto count = [&](const Signal&, CompiledSignal::Fit fit, std::uint64_t) {
    misfits += fit == CompiledSignal::Fit::kFits ? 0u : 1u;
  };
  const auto write = [&](const Signal& signal, CompiledSignal::Fit fit, std::uint64_t bits) {
    if (fit != CompiledSignal::Fit::kNotANumber) signal.bits.write(payload, bits);
  };
  for_each_selected(count);
  if (misfits == 0 || out_of_range == OutOfRange::kClamp) for_each_selected(write);
  return misfits;
}

}  // namespace faultline
