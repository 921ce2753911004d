#include "drivers/can/udp_frame.h"

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <optional>
#include <string_view>

namespace faultline {
namespace {

using Bytes = std::span<const std::uint8_t>;

// Formats of msgpack (https://github.com/msgpack/msgpack/blob/master/spec.md). The first byte of a
// value says what it is; small values and lengths are part of it.
constexpr std::uint8_t kFixMap = 0x80;     // to 0x8F
constexpr std::uint8_t kFixArray = 0x90;   // to 0x9F
constexpr std::uint8_t kFixString = 0xA0;  // to 0xBF
constexpr std::uint8_t kNil = 0xC0;
constexpr std::uint8_t kUnused = 0xC1;
constexpr std::uint8_t kFalse = 0xC2;
constexpr std::uint8_t kTrue = 0xC3;
constexpr std::uint8_t kBin8 = 0xC4;  // bin16, bin32 follow
constexpr std::uint8_t kExt8 = 0xC7;  // ext16, ext32 follow
constexpr std::uint8_t kFloat32 = 0xCA;
constexpr std::uint8_t kFloat64 = 0xCB;
constexpr std::uint8_t kUint8 = 0xCC;     // uint16, uint32, uint64 follow
constexpr std::uint8_t kInt8 = 0xD0;      // int16, int32, int64 follow
constexpr std::uint8_t kFixExt1 = 0xD4;   // 2, 4, 8, 16 bytes follow
constexpr std::uint8_t kString8 = 0xD9;   // str16, str32 follow
constexpr std::uint8_t kArray16 = 0xDC;   // array32 follows
constexpr std::uint8_t kMap16 = 0xDE;     // map32 follows
constexpr std::uint8_t kNegative = 0xE0;  // to 0xFF: -32 to -1

enum class Kind {
  kNothing,
  kBoolean,
  kUnsigned,
  kNegativeNumber,
  kFloat,
  kString,
  kBinary,
  kArray,
  kMap
};

/// One value; an array or a map is its header only, and extensions count as binary.
struct Value {
  Kind kind = Kind::kNothing;
  std::uint64_t number = 0;  ///< of an unsigned or boolean; entries of an array or a map
  double real = 0.0;         ///< of a float
  Bytes bytes;               ///< of a string or binary
};

/// Reads a datagram from front to back. Each function returns nothing where it is no msgpack.
class MsgpackReader {
 public:
  explicit MsgpackReader(Bytes datagram) noexcept : rest_(datagram) {}

  [[nodiscard]] bool is_at_end() const noexcept { return rest_.empty(); }

  std::optional<Value> next() noexcept {
    if (rest_.empty()) return std::nullopt;
    const std::uint8_t format = rest_.front();
    rest_ = rest_.subspan(1);
    if (format < kFixMap) return Value{.kind = Kind::kUnsigned, .number = format};
    if (format >= kNegative) return Value{.kind = Kind::kNegativeNumber};
    if (format < kFixArray) return Value{.kind = Kind::kMap, .number = format & 0x0Fu};
    if (format < kFixString) return Value{.kind = Kind::kArray, .number = format & 0x0Fu};
    if (format < kNil) return take_bytes(Kind::kString, format & 0x1Fu);
    if (format == kNil) return Value{};
    if (format == kUnused) return std::nullopt;
    if (format <= kTrue) {
      return Value{.kind = Kind::kBoolean, .number = format == kFalse ? 0u : 1u};
    }
    if (format < kExt8) return take_sized(Kind::kBinary, format - kBin8, 0);
    if (format < kFloat32) return take_sized(Kind::kBinary, format - kExt8, 1);
    if (format < kUint8) return take_float(format);
    if (format < kInt8) return take_unsigned(format - kUint8);
    if (format < kFixExt1) return take_signed(format - kInt8);
    if (format < kString8) return take_bytes(Kind::kBinary, 1 + (1u << (format - kFixExt1)));
    if (format < kArray16) return take_sized(Kind::kString, format - kString8, 0);
    const bool is_map = format >= kMap16;
    const auto entries = take_integer(format - (is_map ? kMap16 : kArray16) + 1);
    if (!entries) return std::nullopt;
    return Value{.kind = is_map ? Kind::kMap : Kind::kArray, .number = *entries};
  }

  /// Passes over what `value`, just read, holds: the entries of arrays and maps, however deep.
  /// @return false where it is no msgpack.
  bool skip_entries(const Value& value) noexcept {
    // Each entry takes a byte at least, so that the loop ends with the datagram.
    for (std::uint64_t left = entries_of(value); left > 0; --left) {
      const auto entry = next();
      if (!entry) return false;
      left += entries_of(*entry);
    }
    return true;
  }

 private:
  static std::uint64_t entries_of(const Value& value) noexcept {
    if (value.kind == Kind::kArray) return value.number;
    return value.kind == Kind::kMap ? 2 * value.number : 0;
  }

  /// A big-endian number of 2^exponent bytes.
  std::optional<std::uint64_t> take_integer(int exponent) noexcept {
    const std::size_t size = std::size_t{1} << exponent;
    if (rest_.size() < size) return std::nullopt;
    std::uint64_t number = 0;
    for (const std::uint8_t byte : rest_.first(size)) number = number << 8 | byte;
    rest_ = rest_.subspan(size);
    return number;
  }

  std::optional<Value> take_bytes(Kind kind, std::uint64_t size) noexcept {
    if (rest_.size() < size) return std::nullopt;
    const Value value{.kind = kind, .bytes = rest_.first(size)};
    rest_ = rest_.subspan(size);
    return value;
  }

  std::optional<Value> take_sized(Kind kind, int exponent, std::uint64_t extra) noexcept {
    const auto size = take_integer(exponent);
    if (!size) return std::nullopt;
    return take_bytes(kind, *size + extra);
  }

  std::optional<Value> take_unsigned(int exponent) noexcept {
    const auto number = take_integer(exponent);
    if (!number) return std::nullopt;
    return Value{.kind = Kind::kUnsigned, .number = *number};
  }

  std::optional<Value> take_signed(int exponent) noexcept {
    const auto number = take_integer(exponent);
    if (!number) return std::nullopt;
    const bool is_negative = (*number >> ((8 << exponent) - 1)) != 0;
    return Value{.kind = is_negative ? Kind::kNegativeNumber : Kind::kUnsigned,
                 .number = is_negative ? 0 : *number};
  }

  std::optional<Value> take_float(std::uint8_t format) noexcept {
    const bool is_double = format == kFloat64;
    const auto bits = take_integer(is_double ? 3 : 2);
    if (!bits) return std::nullopt;
    return Value{.kind = Kind::kFloat,
                 .real = is_double
                             ? std::bit_cast<double>(*bits)
                             : double{std::bit_cast<float>(static_cast<std::uint32_t>(*bits))}};
  }

  Bytes rest_;
};

/// What the map says, in can.Message's words and with its defaults.
struct Message {
  Timestamp timestamp{};
  std::uint64_t arbitration_id = 0;
  bool is_extended_id = true;
  bool is_remote_frame = false;
  bool is_error_frame = false;
  std::optional<std::uint64_t> dlc;
  Bytes data;
  bool is_fd = false;
  bool bitrate_switch = false;
  bool error_state_indicator = false;
};

Timestamp to_timestamp(const Value& value) noexcept {
  // Past it, nanoseconds no longer fit a Timestamp.
  constexpr double kLastSecond = 9.2e9;
  const double seconds = value.kind == Kind::kFloat      ? value.real
                         : value.kind == Kind::kUnsigned ? static_cast<double>(value.number)
                                                         : 0.0;
  if (!(seconds >= 0.0 && seconds <= kLastSecond)) return Timestamp{};
  // Whole seconds apart: their product with 1e6 would cost the last digits.
  const double whole = std::floor(seconds);
  return Timestamp(std::chrono::seconds(static_cast<std::int64_t>(whole)) +
                   std::chrono::microseconds(std::llround((seconds - whole) * 1e6)));
}

bool take_flag(const Value& value, bool& flag) noexcept {
  // Python takes numbers for truth values, and so do its users.
  if (value.kind != Kind::kBoolean && value.kind != Kind::kUnsigned) return false;
  flag = value.number != 0;
  return true;
}

bool take_number(const Value& value, std::uint64_t& number) noexcept {
  if (value.kind != Kind::kUnsigned) return false;
  number = value.number;
  return true;
}

/// Takes the value of `key` over. @return false if it is of the wrong kind.
bool take_entry(std::string_view key, const Value& value, Message& message) noexcept {
  if (key == "arbitration_id") return take_number(value, message.arbitration_id);
  if (key == "is_extended_id") return take_flag(value, message.is_extended_id);
  if (key == "is_remote_frame") return take_flag(value, message.is_remote_frame);
  if (key == "is_error_frame") return take_flag(value, message.is_error_frame);
  if (key == "is_fd") return take_flag(value, message.is_fd);
  if (key == "bitrate_switch") return take_flag(value, message.bitrate_switch);
  if (key == "error_state_indicator") return take_flag(value, message.error_state_indicator);
  if (key == "timestamp") {
    message.timestamp = to_timestamp(value);
  } else if (key == "dlc") {
    message.dlc.reset();
    if (value.kind != Kind::kNothing && !take_number(value, message.dlc.emplace())) return false;
  } else if (key == "data") {
    if (value.kind != Kind::kNothing && value.kind != Kind::kBinary) return false;
    message.data = value.bytes;
  }
  return true;
}

std::optional<Message> read_message(Bytes datagram) noexcept {
  MsgpackReader reader(datagram);
  const auto map = reader.next();
  if (!map || map->kind != Kind::kMap) return std::nullopt;
  Message message;
  for (std::uint64_t n = 0; n < map->number; ++n) {
    const auto key = reader.next();
    if (!key || key->kind != Kind::kString) return std::nullopt;
    const auto value = reader.next();
    if (!value) return std::nullopt;
    const std::string_view name(reinterpret_cast<const char*>(key->bytes.data()),
                                key->bytes.size());
    if (!take_entry(name, *value, message)) return std::nullopt;
    if (!reader.skip_entries(*value)) return std::nullopt;
  }
  if (!reader.is_at_end()) return std::nullopt;
  return message;
}

/// Writes into a buffer of kLongestUdpFrame bytes.
class MsgpackWriter {
 public:
  void put(std::uint8_t byte) noexcept { bytes_[size_++] = byte; }
  void put_flag(std::string_view key, bool flag) noexcept {
    put_key(key);
    put(flag ? kTrue : kFalse);
  }
  void put_key(std::string_view key) noexcept {
    put(static_cast<std::uint8_t>(kFixString | key.size()));
    std::memcpy(bytes_.data() + size_, key.data(), key.size());
    size_ += key.size();
  }
  void put_big_endian(std::uint64_t number, std::size_t size) noexcept {
    for (std::size_t n = size; n-- > 0;) put(static_cast<std::uint8_t>(number >> (8 * n)));
  }
  /// In the shortest of its formats, as msgpack for Python does.
  void put_number(std::uint32_t number) noexcept {
    const int exponent = number <= 0xFF ? 0 : number <= 0xFFFF ? 1 : 2;
    if (number >= kFixMap) put(static_cast<std::uint8_t>(kUint8 + exponent));
    put_big_endian(number, std::size_t{1} << exponent);
  }
  void put_data(Bytes data) noexcept {
    put(kBin8);
    put(static_cast<std::uint8_t>(data.size()));
    for (const std::uint8_t byte : data) put(byte);
  }
  [[nodiscard]] Bytes written() const noexcept { return {bytes_.data(), size_}; }

 private:
  std::array<std::uint8_t, kLongestUdpFrame> bytes_;
  std::size_t size_ = 0;
};

}  // namespace

bool decode_udp_frame(std::span<const std::uint8_t> datagram, CanFrame& frame) noexcept {
  const auto message = read_message(datagram);
  if (!message || message->arbitration_id > kMaxExtendedId) return false;
  const std::uint64_t length = message->dlc.value_or(message->data.size());
  if (length > kMaxPayload) return false;
  if (!message->is_remote_frame && message->data.size() != length) return false;
  CanFrame decoded;
  decoded.stamp = message->timestamp;
  decoded.id = static_cast<std::uint32_t>(message->arbitration_id);
  decoded.length = static_cast<std::uint8_t>(length);
  decoded.is_error = message->is_error_frame;
  decoded.is_extended = message->is_extended_id && !message->is_error_frame;
  decoded.is_remote = message->is_remote_frame;
  decoded.is_fd = message->is_fd;
  decoded.is_bit_rate_switched = message->bitrate_switch;
  decoded.is_error_state = message->error_state_indicator;
  if (!is_well_formed(decoded)) return false;
  if (!decoded.is_remote) std::copy_n(message->data.begin(), length, decoded.data.begin());
  frame = decoded;
  return true;
}

std::size_t encode_udp_frame(const CanFrame& frame, std::span<std::uint8_t> out) noexcept {
  if (!is_well_formed(frame)) return 0;
  const auto whole = std::chrono::floor<std::chrono::seconds>(frame.stamp.time_since_epoch());
  const std::chrono::duration<double> fraction = frame.stamp.time_since_epoch() - whole;
  const double timestamp = static_cast<double>(whole.count()) + fraction.count();
  MsgpackWriter writer;
  writer.put(kFixMap | 11);
  writer.put_key("timestamp");
  writer.put(kFloat64);
  writer.put_big_endian(std::bit_cast<std::uint64_t>(timestamp), sizeof(double));
  writer.put_key("arbitration_id");
  writer.put_number(frame.id);
  writer.put_flag("is_extended_id",
                  frame.is_extended || (frame.is_error && frame.id > kMaxStandardId));
  writer.put_flag("is_remote_frame", frame.is_remote);
  writer.put_flag("is_error_frame", frame.is_error);
  writer.put_key("channel");
  writer.put(kNil);
  writer.put_key("dlc");
  writer.put_number(frame.length);
  writer.put_key("data");
  writer.put_data(frame.is_remote ? Bytes{} : frame.payload());
  writer.put_flag("is_fd", frame.is_fd);
  writer.put_flag("bitrate_switch", frame.is_bit_rate_switched);
  writer.put_flag("error_state_indicator", frame.is_error_state);
  const Bytes written = writer.written();
  if (written.size() > out.size()) return 0;
  std::copy(written.begin(), written.end(), out.begin());
  return written.size();
}

}  // namespace faultline
