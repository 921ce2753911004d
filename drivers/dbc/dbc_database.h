#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace faultline {

/// Position in a DBC text, both counted from 1; a column is one byte.
struct DbcPosition {
  int line = 1;
  int column = 1;
};

/// Value of an attribute (BA_): integer and hex kinds as integer, enumerations as their text.
using DbcAttributeValue = std::variant<std::int64_t, double, std::string>;
using DbcAttributes = std::map<std::string, DbcAttributeValue, std::less<>>;

enum class ByteOrder { kLittleEndian, kBigEndian };  ///< DBC `@1` (Intel), `@0` (Motorola)
enum class SignalType { kUnsigned, kSigned, kFloat32, kFloat64 };

/// One signal (SG_). physical = raw·factor + offset.
struct DbcSignal {
  std::string name;
  std::uint16_t start_bit = 0;  ///< as in the DBC: bit of the LSB (Intel) or of the MSB (Motorola)
  std::uint16_t bit_count = 0;
  ByteOrder byte_order = ByteOrder::kLittleEndian;
  SignalType type = SignalType::kUnsigned;
  double factor = 1.0;
  double offset = 0.0;
  double minimum = 0.0;  ///< physical; minimum == maximum: not given
  double maximum = 0.0;
  std::string unit;
  bool is_multiplexer = false;                     ///< `M`
  std::optional<std::uint32_t> multiplexer_value;  ///< `m<value>`
  std::vector<std::string> receivers;
  std::string comment;
  std::map<std::int64_t, std::string> value_names;  ///< VAL_
  DbcAttributes attributes;
  DbcPosition position;
};

/// Payload bytes that reach to the end of `signal`. @pre bit_count >= 1.
[[nodiscard]] std::size_t payload_bytes_needed(const DbcSignal& signal) noexcept;

/// One message (BO_).
struct DbcMessage {
  std::string name;
  std::uint32_t id = 0;  ///< 11 or 29 bits, no flag bits
  bool is_extended = false;
  std::uint16_t length = 0;  ///< payload bytes
  std::string transmitter;
  std::vector<DbcSignal> signals;
  std::string comment;
  DbcAttributes attributes;
  DbcPosition position;

  /// Signal by name, or nullptr.
  [[nodiscard]] const DbcSignal* find_signal(std::string_view signal_name) const noexcept;
};

/// Something in a file that was understood in spite of being wrong or unusual.
struct DbcWarning {
  DbcPosition position;
  std::string text;
};

/// What a DBC file says. Plain data: fill it, copy it, read it.
struct DbcDatabase {
  std::string source;  ///< file name for messages to people
  std::string version;
  std::vector<std::string> nodes;
  std::vector<DbcMessage> messages;
  std::string comment;                                                ///< of the network
  std::map<std::string, std::string, std::less<>> node_comments;      ///< by node
  DbcAttributes attributes;                                           ///< of the network
  std::map<std::string, DbcAttributes, std::less<>> node_attributes;  ///< by node
  DbcAttributes default_attributes;                                   ///< BA_DEF_DEF_
  std::vector<DbcWarning> warnings;

  /// Message by name, or nullptr.
  [[nodiscard]] const DbcMessage* find_message(std::string_view message_name) const noexcept;

  /// Value of attribute `name` of a message or signal of this database: its own, else the default
  /// (BA_DEF_DEF_), else nullptr. Valid as long as neither is changed.
  [[nodiscard]] const DbcAttributeValue* attribute_of(const DbcMessage& message,
                                                      std::string_view name) const noexcept;
  [[nodiscard]] const DbcAttributeValue* attribute_of(const DbcSignal& signal,
                                                      std::string_view name) const noexcept;
};

}  // namespace faultline
