#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/dbc/dbc_attributes.h"
#include "drivers/dbc/dbc_names.h"

namespace faultline {

/// Position in a DBC text, both counted from 1; a column is one byte.
struct DbcPosition {
  int line = 1;
  int column = 1;
};

enum class ByteOrder : std::uint8_t { kLittleEndian, kBigEndian };  ///< `@1` Intel, `@0` Motorola
enum class SignalType : std::uint8_t { kUnsigned, kSigned, kFloat32, kFloat64 };

/// A raw value's name (VAL_, VAL_TABLE_).
struct DbcValueName {
  std::int64_t value = 0;
  std::string name;
};

/// Raw values first .. last of a multiplexer, both included.
struct DbcMultiplexRange {
  std::uint64_t first = 0;
  std::uint64_t last = 0;
};

/// One signal (SG_). physical = raw·factor + offset.
struct DbcSignal {
  static constexpr std::int32_t kAlwaysPresent = -1;

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
  bool is_multiplexer = false;  ///< `M`: its raw value selects which other signals are present
  /// Index, among the message's signals, of the multiplexer that selects this one; kAlwaysPresent
  /// if none does. Simple (`m3`) and extended (SG_MUL_VAL_) multiplexing look alike here.
  std::int32_t multiplexer = kAlwaysPresent;
  /// Raw values of the multiplexer with which this signal is present, ascending.
  std::vector<DbcMultiplexRange> multiplexer_ranges;
  DbcNames receivers;
  std::string comment;
  std::vector<DbcValueName> value_names;  ///< VAL_, ascending by value
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
  DbcNames other_transmitters;  ///< BO_TX_BU_
  std::vector<DbcSignal> signals;
  std::string comment;
  DbcAttributes attributes;
  DbcPosition position;

  /// Signal by name, or nullptr.
  [[nodiscard]] const DbcSignal* find_signal(std::string_view signal_name) const noexcept;
};

enum class DbcSeverity : std::uint8_t {
  kNote,     ///< nothing is lost: a section that is not read
  kWarning,  ///< understood, but wrong or unusual: signals that overlap, an unknown message
  kError,    ///< a statement, or part of it, could not be understood and was skipped
};

/// Something in a file that a person should know.
struct DbcWarning {
  DbcPosition position;
  std::string text;
  DbcSeverity severity = DbcSeverity::kWarning;
};

/// Named value table (VAL_TABLE_).
struct DbcValueTable {
  std::string name;
  std::vector<DbcValueName> values;
};

/// Two signals of a message that share bits though one frame can carry both. Of a signal that
/// overlaps several only the first is told.
struct DbcOverlap {
  std::size_t message = 0;  ///< index among the database's messages
  std::size_t earlier = 0;  ///< index among the message's signals
  std::size_t later = 0;
};

/// A group of signals of one message (SIG_GROUP_).
struct DbcSignalGroup {
  std::string name;
  std::size_t message = 0;  ///< index among the database's messages
  std::uint32_t repetitions = 1;
  DbcNames signals;
};

/// An environment variable (EV_).
struct DbcEnvironmentVariable {
  std::string name;
  double minimum = 0.0;
  double maximum = 0.0;
  double initial = 0.0;
  std::string unit;
  DbcNames nodes;
  std::vector<DbcValueName> value_names;
  std::string comment;
  DbcAttributes attributes;
  DbcPosition position;
};

/// What a DBC file says. Plain data: fill it, copy it, read it.
struct DbcDatabase {
  std::string source;  ///< file name for messages to people
  std::string version;
  std::vector<std::string> nodes;
  std::vector<DbcMessage> messages;
  std::vector<DbcValueTable> value_tables;
  std::vector<DbcSignalGroup> signal_groups;
  std::vector<DbcOverlap> overlaps;
  std::vector<DbcEnvironmentVariable> environment_variables;
  std::string comment;                                                ///< of the network
  std::map<std::string, std::string, std::less<>> node_comments;      ///< by node
  DbcAttributes attributes;                                           ///< of the network
  std::map<std::string, DbcAttributes, std::less<>> node_attributes;  ///< by node
  DbcAttributes default_attributes;                                   ///< BA_DEF_DEF_
  /// The first kMaxWarnings of each severity, in the order of the file.
  std::vector<DbcWarning> warnings;
  std::size_t further_warning_count = 0;  ///< not kept

  static constexpr std::size_t kMaxWarnings = 1000;

  /// Message by name, or nullptr.
  [[nodiscard]] const DbcMessage* find_message(std::string_view message_name) const noexcept;
  /// First message with this identifier, or nullptr. Takes time proportional to the messages: build
  /// an index of your own for a stream of frames.
  [[nodiscard]] const DbcMessage* find_message(std::uint32_t id, bool is_extended) const noexcept;

  /// Value of attribute `name` of a message or signal of this database: its own, else the default
  /// (BA_DEF_DEF_), else nullptr. Valid as long as neither is changed.
  [[nodiscard]] const DbcAttributeValue* attribute_of(const DbcMessage& message,
                                                      std::string_view name) const noexcept;
  [[nodiscard]] const DbcAttributeValue* attribute_of(const DbcSignal& signal,
                                                      std::string_view name) const noexcept;
};

}  // namespace faultline
