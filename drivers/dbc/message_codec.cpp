#include "drivers/dbc/message_codec.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace faultline {
namespace {

constexpr std::size_t kWordBytes = sizeof(std::uint64_t);
constexpr int kExactBits = 53;  // integers a double holds
/// Multiplexers may hang on one another this deep; the parser allows fewer.
constexpr int kMaxDepth = 16;

/// Up to eight bytes as a number, the first lowest; what is missing is zero. No read past the end.
std::uint64_t load_up_to_word(std::span<const std::uint8_t> bytes) noexcept {
  std::uint64_t word = 0;
  const std::size_t size = std::min(bytes.size(), kWordBytes);
  for (std::size_t n = 0; n < size; ++n) word |= std::uint64_t{bytes[n]} << (8 * n);
  return word;
}

std::uint64_t load_word(const std::uint8_t* bytes) noexcept {
  std::uint64_t word = 0;
  std::memcpy(&word, bytes, kWordBytes);
  return std::endian::native == std::endian::little ? word : __builtin_bswap64(word);
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
  steps_share_a_word_ = true;
  for (std::uint32_t n = 0; n < signals_.size(); ++n) {
    const CompiledSignal& bits = signals_[n].bits;
    const bool is_step = signals_[n].is_codable && signals_[n].multiplexer < 0 &&
                         !bits.is_float() && bits.bit_count <= kExactBits &&
                         bits.byte_count <= kWordBytes && is_always_finite(bits);
    if (!is_step) {
      others_.push_back(n);
      continue;
    }
    Step step;
    step.factor = bits.factor;
    step.offset = bits.offset;
    step.factor_rest = bits.factor_rest;
    step.offset_rest = bits.offset_rest;
    step.keep = bits.type == SignalType::kSigned ? ~std::uint64_t{0} : bits.mask;
    step.signal = n;
    step.is_big_endian = bits.byte_order == ByteOrder::kBigEndian ? 1 : 0;
    // The word begins with the payload if it can; further on it ends with the signal, so that it
    // asks for no byte behind it.
    const std::size_t end = bits.bytes_needed();
    const std::size_t first_byte = end <= kWordBytes ? 0 : end - kWordBytes;
    step.first_byte = static_cast<std::uint8_t>(first_byte);
    const std::size_t bytes_before = bits.first_byte - first_byte;
    const std::size_t bytes_behind = first_byte + kWordBytes - end;
    const std::size_t low_bits =
        bits.shift + 8 * (step.is_big_endian != 0 ? bytes_behind : bytes_before);
    step.left = static_cast<std::uint8_t>(64 - low_bits - bits.bit_count);
    step.right = static_cast<std::uint8_t>(64 - bits.bit_count);
    if (end > kWordBytes) steps_share_a_word_ = false;
    step_bytes_needed_ = std::max(step_bytes_needed_, end);
    steps_.push_back(step);
  }
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

void MessageCodec::run_steps(std::span<const std::uint8_t> payload, double* values) const noexcept {
  const auto run = [values](const Step& step, std::uint64_t word) {
    const auto top = static_cast<std::int64_t>(word << step.left);
    const auto raw =
        static_cast<std::int64_t>(static_cast<std::uint64_t>(top >> step.right) & step.keep);
    values[step.signal] = scaled(static_cast<double>(raw), step.factor, step.offset,
                                 step.factor_rest, step.offset_rest);
  };
  if (steps_share_a_word_) {
    const std::uint64_t word =
        payload.size() >= kWordBytes ? load_word(payload.data()) : load_up_to_word(payload);
    const std::array<std::uint64_t, 2> words{word, __builtin_bswap64(word)};
    for (const Step& step : steps_) run(step, words[step.is_big_endian]);
    return;
  }
  // Some end behind the eighth byte, and the payload reaches there: it has eight bytes.
  for (const Step& step : steps_) {
    const std::uint64_t word = load_word(payload.data() + step.first_byte);
    run(step, step.is_big_endian != 0 ? __builtin_bswap64(word) : word);
  }
}

std::size_t MessageCodec::decode(std::span<const std::uint8_t> payload, std::span<double> values,
                                 std::span<SignalPresence> presence) const noexcept {
  if (payload.size() < step_bytes_needed_) {
    std::size_t present = 0;
    for (std::size_t n = 0; n < signals_.size(); ++n) {
      presence[n] = decode_signal(signals_[n], payload, values[n]);
      present += presence[n] == SignalPresence::kPresent ? 1u : 0u;
    }
    return present;
  }
  std::fill_n(presence.begin(), signals_.size(), SignalPresence::kPresent);
  run_steps(payload, values.data());
  std::size_t present = steps_.size();
  for (const std::uint32_t n : others_) {
    presence[n] = decode_signal(signals_[n], payload, values[n]);
    present += presence[n] == SignalPresence::kPresent ? 1u : 0u;
  }
  return present;
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
