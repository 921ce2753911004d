#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "drivers/dbc/dbc_chunks.h"
#include "drivers/dbc/dbc_database.h"
#include "drivers/dbc/dbc_statement_reader.h"

// What the functions that read the statements of a DBC text share. Part of the parser, for nobody
// else.
namespace faultline {

inline constexpr std::uint32_t kNoDbcItem = 0xFFFF'FFFF;
/// Identifier of the pseudo message in which tools keep signals that belong to no message.
inline constexpr std::uint32_t kIndependentSignalsId = 0xC000'0000;
inline constexpr std::uint32_t kExtendedIdFlag = 0x8000'0000;
inline constexpr std::uint32_t kMaxStandardDbcId = 0x7FF;
inline constexpr std::uint32_t kMaxExtendedDbcId = 0x1FFF'FFFF;
/// `multiplexer` of a signal marked `m3` whose multiplexer is not found yet.
inline constexpr std::int32_t kUnlinkedMultiplexer = -2;

/// Numbers of things, found by the hash of their name: eight bytes a slot, no names of its own.
class DbcHashIndex {
 public:
  /// The first number with this hash for which `is_same(number)` holds, or kNoDbcItem.
  template <class IsSame>
  [[nodiscard]] std::uint32_t find(std::size_t hash, IsSame&& is_same) const {
    if (slots_.empty()) return kNoDbcItem;
    const std::size_t mask = slots_.size() - 1;
    const std::uint32_t folded = fold(hash);
    for (std::size_t n = folded & mask; slots_[n].number != kNoDbcItem; n = (n + 1) & mask) {
      if (slots_[n].hash == folded && is_same(slots_[n].number)) return slots_[n].number;
    }
    return kNoDbcItem;
  }
  void insert(std::size_t hash, std::uint32_t number);

 private:
  struct Slot {
    std::uint32_t hash = 0;
    std::uint32_t number = kNoDbcItem;
  };

  static std::uint32_t fold(std::size_t hash) noexcept {
    return static_cast<std::uint32_t>((std::uint64_t{hash} * 0x9E37'79B9'7F4A'7C15u) >> 32);
  }
  void place(Slot slot) noexcept;

  std::vector<Slot> slots_;  ///< a power of two, or none
  std::size_t count_ = 0;
};

/// What an attribute may belong to.
enum class DbcObject : std::uint8_t {
  kNetwork,
  kNode,
  kMessage,
  kSignal,
  kEnvironmentVariable,
};

enum class DbcAttributeKind : std::uint8_t { kInteger, kFloat, kString, kEnumeration };

struct DbcAttributeDefinition {
  DbcAttributeKind kind = DbcAttributeKind::kString;
  std::vector<std::string> values;     ///< of an enumeration
  std::vector<std::uint32_t> by_text;  ///< of a long enumeration: indices, ascending by text
};

/// An attribute's name and what it belongs to: different objects may use one name differently.
struct DbcAttributeKey {
  std::string name;
  DbcObject object = DbcObject::kNetwork;
};
struct DbcAttributeKeyView {
  std::string_view name;
  DbcObject object;
};
struct DbcAttributeKeyHash {
  using is_transparent = void;
  std::size_t operator()(const DbcAttributeKeyView& key) const noexcept {
    return std::hash<std::string_view>{}(key.name) + static_cast<std::size_t>(key.object);
  }
  std::size_t operator()(const DbcAttributeKey& key) const noexcept {
    return (*this)(DbcAttributeKeyView{key.name, key.object});
  }
};
struct DbcAttributeKeyEqual {
  using is_transparent = void;
  template <class A, class B>
  bool operator()(const A& a, const B& b) const noexcept {
    return a.object == b.object && std::string_view(a.name) == std::string_view(b.name);
  }
};
using DbcAttributeDefinitions = std::unordered_map<DbcAttributeKey, DbcAttributeDefinition,
                                                   DbcAttributeKeyHash, DbcAttributeKeyEqual>;

/// State of reading one text.
struct DbcParse {
  explicit DbcParse(std::string_view text);
  DbcParse(const DbcParse&) = delete;
  DbcParse& operator=(const DbcParse&) = delete;

  DbcWarnings warnings;
  DbcStatementReader reader;
  DbcDatabase database;
  std::vector<DbcMessage>& messages = database.messages;
  std::vector<DbcEnvironmentVariable>& environment_variables = database.environment_variables;
  const char* signals_counted_to = nullptr;  ///< lines before this one were counted
  DbcAttributeDefinitions definitions;
  DbcHashIndex message_ids, message_names, signal_names, node_names, environment_names, table_names;
  std::vector<std::uint32_t> first_signals;       ///< by message: numbers of signals before it
  std::uint32_t signal_count = 0;                 ///< in all messages so far
  std::uint32_t last_message = kNoDbcItem;        ///< the last one found by identifier
  bool last_message_failed = false;               ///< the last BO_ was not understood
  std::size_t understood_count = 0;               ///< statements
  std::vector<std::string_view> unread_keywords;  ///< that have their note
  /// Bytes that statements may still copy from others (texts of enumerations, value tables), so
  /// that a short file cannot ask for endless memory.
  std::size_t copies_left = 0;
};

/// How many lines from the start of `text` on start with `keyword`, without others in between: to
/// make room for as many items, because a vector that doubles holds up to three times its items.
/// @param end set to the end of the last one
[[nodiscard]] std::size_t count_leading_lines_of(std::string_view text, std::string_view keyword,
                                                 const char*& end);

/// An identifier as the file writes it; DBC files mark 29 bits with bit 31.
struct DbcId {
  std::uint32_t id = 0;
  bool is_extended = false;
};
/// What a number in the file stands for; that of a classic identifier above 11 bits is extended.
[[nodiscard]] DbcId to_dbc_id(std::uint32_t file_id) noexcept;

/// What a statement is about; kNoDbcItem, with a warning, if the file does not have it. False: a
/// syntax error.
bool expect_message(DbcParse& parse, std::uint32_t& message);
bool expect_signal(DbcParse& parse, std::uint32_t& message, std::uint32_t& signal);
bool expect_node(DbcParse& parse, std::string_view& name, bool& is_known);
bool expect_environment_variable(DbcParse& parse, std::uint32_t& variable);

/// Number among the message's signals, or kNoDbcItem. @pre the message is complete
[[nodiscard]] std::uint32_t find_dbc_signal(const DbcParse& parse, std::uint32_t message,
                                            std::string_view name);

/// Statements, entered behind their keyword. False: a syntax error; the caller skips the rest.
bool parse_dbc_comment(DbcParse& parse);
bool parse_dbc_value_names(DbcParse& parse);
bool parse_dbc_value_table(DbcParse& parse);
bool parse_dbc_signal_type(DbcParse& parse);
bool parse_dbc_signal_group(DbcParse& parse);
bool parse_dbc_transmitters(DbcParse& parse);
bool parse_dbc_environment_variable(DbcParse& parse);
bool parse_dbc_multiplexing(DbcParse& parse);
bool parse_dbc_attribute_definition(DbcParse& parse);
bool parse_dbc_attribute_default(DbcParse& parse);
bool parse_dbc_attribute(DbcParse& parse);

/// What only the whole text tells: multiplexers, overlaps, and the order of attributes and values.
void finish_dbc(DbcParse& parse);

/// Finds the multiplexer of each multiplexed signal of `message`; breaks cycles.
void link_multiplexers(DbcMessage& message, DbcWarnings& warnings);

}  // namespace faultline
