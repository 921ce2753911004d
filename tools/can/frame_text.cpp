#include "tools/can/frame_text.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <optional>

#include <nlohmann/json.hpp>

#include "drivers/dbc/signal_codec.h"

namespace faultline {
namespace {

/// Up to here every whole number is a double.
constexpr double kLargestExact = 0x1p53;
constexpr std::uint16_t kExactBits = 53;

__extension__ using Int128 = __int128;

void append(fmt::memory_buffer& out, std::string_view text) {
  out.append(text.data(), text.data() + text.size());
}

bool is_whole(double number) noexcept {
  return number == std::trunc(number) && std::abs(number) <= kLargestExact;
}

bool is_float(const DbcSignal& signal) noexcept {
  return signal.type == SignalType::kFloat32 || signal.type == SignalType::kFloat64;
}

/// raw·factor + offset with all its digits, where all three are whole and a double might be too
/// narrow.
std::optional<Int128> wide_value(const DbcSignal& signal, std::span<const std::uint8_t> payload) {
  if (is_float(signal) || signal.bit_count <= kExactBits || !is_whole(signal.factor) ||
      !is_whole(signal.offset)) {
    return std::nullopt;
  }
  std::int64_t raw = 0;
  if (SignalCodec(signal).decode_raw(payload, raw) != CodecStatus::kOk) return std::nullopt;
  const Int128 whole =
      signal.type == SignalType::kSigned ? Int128{raw} : Int128{static_cast<std::uint64_t>(raw)};
  return whole * static_cast<std::int64_t>(signal.factor) +
         static_cast<std::int64_t>(signal.offset);
}

/// A signal with a scale has a value of few decimals, which its double misses by an ulp or two.
std::optional<double> nearest_short_decimal(double value) {
  constexpr int kDecimals = 15;  // that every double of so many digits tells apart
  fmt::basic_memory_buffer<char, 32> text;
  fmt::format_to(std::back_inserter(text), "{:.{}g}", value, kDecimals);
  double shorter = 0.0;
  std::from_chars(text.data(), text.data() + text.size(), shorter);
  const double ulp = std::nextafter(std::abs(value), HUGE_VAL) - std::abs(value);
  if (!(std::abs(shorter - value) <= 2.0 * ulp)) return std::nullopt;
  return shorter;
}

const DbcValueName* name_of_value(const DbcSignal& signal, double value) {
  const double raw = (value - signal.offset) / signal.factor;
  if (signal.value_names.empty() || !(std::abs(raw) < 0x1p62)) return nullptr;
  const std::int64_t wanted = std::llrint(raw);
  const auto found =
      std::lower_bound(signal.value_names.begin(), signal.value_names.end(), wanted,
                       [](const DbcValueName& name, std::int64_t v) { return name.value < v; });
  return found != signal.value_names.end() && found->value == wanted ? &*found : nullptr;
}

void append_names(fmt::memory_buffer& out, std::string_view key, const DecodedFrame& decoded,
                  SignalPresence presence) {
  bool is_first = true;
  for (std::size_t i = 0; i < decoded.presence.size(); ++i) {
    if (decoded.presence[i] != presence) continue;
    append(out, is_first ? std::string_view(",\"") : std::string_view(","));
    if (is_first) fmt::format_to(std::back_inserter(out), "{}\":[", key);
    append(out, json_string(decoded.message->signals[i].name));
    is_first = false;
  }
  if (!is_first) append(out, "]");
}

}  // namespace

std::string json_string(std::string_view text) {
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

void append_value(fmt::memory_buffer& out, const CanFrame& frame, const DecodedFrame& decoded,
                  std::size_t index) {
  const DbcSignal& signal = decoded.message->signals[index];
  if (const auto wide = wide_value(signal, frame.payload())) {
    fmt::format_to(std::back_inserter(out), "{}", *wide);
    return;
  }
  const bool is_scaled = !is_float(signal) && !(is_whole(signal.factor) && is_whole(signal.offset));
  const double value = decoded.values[index];
  fmt::format_to(std::back_inserter(out), "{}",
                 is_scaled ? nearest_short_decimal(value).value_or(value) : value);
}

void append_time(fmt::memory_buffer& out, Timestamp stamp) {
  constexpr std::int64_t kMicrosecondsPerSecond = 1'000'000;
  const std::int64_t us =
      std::chrono::floor<std::chrono::microseconds>(stamp.time_since_epoch()).count();
  if (us < 0) append(out, "-");
  const std::uint64_t magnitude =
      us < 0 ? 0 - static_cast<std::uint64_t>(us) : static_cast<std::uint64_t>(us);
  fmt::format_to(std::back_inserter(out), "{}.{:06}", magnitude / kMicrosecondsPerSecond,
                 magnitude % kMicrosecondsPerSecond);
}

void append_json(fmt::memory_buffer& out, const CanFrame& frame, std::string_view bus,
                 const DecodedFrame& decoded) {
  append(out, "{\"time\":");
  append_time(out, frame.stamp);
  append(out, ",\"bus\":");
  append(out, json_string(bus));
  fmt::format_to(std::back_inserter(out), ",\"id\":{},\"extended\":{}", frame.id,
                 frame.is_extended);
  if (frame.is_fd) append(out, ",\"fd\":true");
  if (frame.is_remote) append(out, ",\"remote\":true");
  if (frame.is_error) append(out, ",\"error\":true");
  append(out, ",\"message\":");
  append(out, decoded.message == nullptr ? "null" : json_string(decoded.message->name));
  append(out, ",\"signals\":{");
  bool is_first = true;
  for (std::size_t i = 0; i < decoded.presence.size(); ++i) {
    if (decoded.presence[i] != SignalPresence::kPresent) continue;
    if (!is_first) append(out, ",");
    is_first = false;
    append(out, json_string(decoded.message->signals[i].name));
    append(out, ":");
    append_value(out, frame, decoded, i);
  }
  append(out, "}");
  if (!frame.is_remote)
    append_names(out, "beyond_payload", decoded, SignalPresence::kBeyondPayload);
  append_names(out, "not_a_number", decoded, SignalPresence::kNotANumber);
  append(out, "}\n");
}

void append_signals(fmt::memory_buffer& out, const CanFrame& frame, const DecodedFrame& decoded) {
  if (decoded.message == nullptr) return;
  append(out, decoded.message->name);
  bool is_short = false;
  for (std::size_t i = 0; i < decoded.presence.size(); ++i) {
    const DbcSignal& signal = decoded.message->signals[i];
    is_short = is_short || decoded.presence[i] == SignalPresence::kBeyondPayload;
    if (decoded.presence[i] == SignalPresence::kNotANumber) {
      fmt::format_to(std::back_inserter(out), "  {}=NaN", signal.name);
    }
    if (decoded.presence[i] != SignalPresence::kPresent) continue;
    fmt::format_to(std::back_inserter(out), "  {}=", signal.name);
    append_value(out, frame, decoded, i);
    if (!signal.unit.empty()) fmt::format_to(std::back_inserter(out), " {}", signal.unit);
    if (const DbcValueName* const name = name_of_value(signal, decoded.values[i])) {
      fmt::format_to(std::back_inserter(out), " ({})", name->name);
    }
  }
  if (is_short && !frame.is_remote) append(out, "  (payload too short for the rest)");
}

void append_frame(fmt::memory_buffer& out, const CanFrame& frame, std::string_view bus) {
  const int digits = frame.is_extended || frame.is_error ? 8 : 3;
  const std::uint32_t shown = frame.id | (frame.is_error ? 0x2000'0000u : 0u);
  fmt::format_to(std::back_inserter(out), "{}  {:0{}X}{}  [{}{}]", bus, shown, digits,
                 digits == 3 ? "     " : "", frame.is_fd && frame.length < 10 ? "0" : "",
                 frame.length);
  if (frame.is_remote) {
    append(out, "  remote request");
    return;
  }
  append(out, " ");
  for (const std::uint8_t byte : frame.payload()) {
    fmt::format_to(std::back_inserter(out), " {:02X}", byte);
  }
}

}  // namespace faultline
