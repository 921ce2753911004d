#include "drivers/dbc/dbc_parser.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <unordered_map>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "drivers/dbc/dbc_lexer.h"

namespace faultline {
namespace {

constexpr std::uint32_t kExtendedIdFlag = 0x8000'0000;
constexpr std::uint32_t kMaxStandardDbcId = 0x7FF;
constexpr std::uint32_t kMaxExtendedDbcId = 0x1FFF'FFFF;
/// Identifier of the pseudo message in which tools keep signals that belong to no message.
constexpr std::uint32_t kIndependentSignalsId = 0xC000'0000;
constexpr std::uint16_t kMaxFramePayload = 64;
constexpr std::uint16_t kMaxSignalBits = 64;

bool is_word(const DbcToken& token, std::string_view word) noexcept {
  return token.kind == DbcTokenKind::kIdentifier && token.text == word;
}

bool is_punctuation(const DbcToken& token, char character) noexcept {
  return token.kind == DbcTokenKind::kPunctuation && token.text.front() == character;
}

/// from_chars knows no plus sign.
std::string_view without_plus(std::string_view number) noexcept {
  if (number.starts_with('+')) number.remove_prefix(1);
  return number;
}

/// The token's number, if a T holds it.
template <class T>
std::optional<T> to_number(const DbcToken& token) noexcept {
  if (token.kind != DbcTokenKind::kNumber) return std::nullopt;
  const std::string_view text = without_plus(token.text);
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// The token's number if it is whole, also when written "1.0" or "1e3".
std::optional<std::int64_t> to_whole_number(const DbcToken& token) noexcept {
  if (const auto integer = to_number<std::int64_t>(token)) return integer;
  const auto number = to_number<double>(token);
  if (!number || std::abs(*number) >= 0x1p63 || *number != std::trunc(*number)) return std::nullopt;
  return static_cast<std::int64_t>(*number);
}

/// A section keyword is in capitals and ends with an underscore.
bool looks_like_section(std::string_view word) noexcept {
  return word.size() > 1 && word.back() == '_' && std::all_of(word.begin(), word.end(), [](char c) {
           return (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
         });
}

enum class AttributeKind { kInteger, kFloat, kString, kEnumeration };

struct AttributeDefinition {
  AttributeKind kind = AttributeKind::kString;
  std::vector<std::string> values;  ///< of an enumeration
};

/// Reads one text; use once.
class DbcParser {
 public:
  DbcParser(std::string_view text, const std::string& source) : lexer_(text, source) {
    database_.source = source;
  }

  DbcDatabase parse() {
    while (lexer_.peek().kind != DbcTokenKind::kEnd) parse_section();
    return std::move(database_);
  }

 private:
  using Section = void (DbcParser::*)();
  using SignalIndex = std::unordered_map<std::string, std::size_t>;  ///< by name

  // Sections. Each is entered with its keyword taken.
  static Section find_section(std::string_view keyword) noexcept;
  void parse_section();
  void parse_version();
  void skip_new_symbols();
  void skip_bus_timing();
  void parse_nodes();
  void parse_message();
  void parse_signal(DbcMessage& message, SignalIndex& index);
  void parse_signal_type();
  void parse_value_names();
  void parse_comment();
  void parse_attribute_definition();
  void parse_attribute_default();
  void parse_attribute();
  void skip_statement(const DbcToken& keyword);

  // Parts of a signal.
  void parse_multiplexing(DbcSignal& signal);
  void parse_bit_layout(DbcSignal& signal);
  void parse_scaling(DbcSignal& signal);
  void parse_range(DbcSignal& signal);
  void parse_receivers(DbcSignal& signal);
  void check_extent(const DbcMessage& message, const DbcSignal& signal);

  // Attributes.
  AttributeDefinition parse_attribute_kind();
  DbcAttributeValue parse_attribute_value(const std::string& name);
  DbcAttributeValue enumeration_value(const AttributeDefinition& definition, const DbcToken& token);
  DbcAttributeValue numeric_value(const AttributeDefinition& definition, const DbcToken& token);

  // What a statement is about. nullptr, with a warning, if the file does not have it.
  DbcMessage* parse_message_reference();
  DbcSignal* parse_signal_reference();

  // Tokens.
  [[nodiscard]] bool is_on_same_line() const noexcept {
    return lexer_.peek().position.line == lexer_.previous_line();
  }
  bool accept(char punctuation);
  bool accept_word(std::string_view word);
  DbcToken expect(DbcTokenKind kind, std::string_view expected);
  void expect(char punctuation);
  std::string expect_identifier(std::string_view expected);
  std::string expect_string(std::string_view expected);
  double expect_number(std::string_view expected);
  template <class T>
  T expect_integer(std::string_view expected);

  [[noreturn]] void fail(const DbcToken& found, std::string_view expected) const;
  void warn(DbcPosition position, std::string text);

  DbcLexer lexer_;
  DbcDatabase database_;
  std::unordered_map<std::uint32_t, std::size_t> message_index_;  ///< by identifier as in the file
  std::vector<SignalIndex> signal_index_;                         ///< by message
  std::set<std::string, std::less<>> node_names_;
  std::map<std::string, AttributeDefinition, std::less<>> definitions_;
};

DbcParser::Section DbcParser::find_section(std::string_view keyword) noexcept {
  static constexpr std::array<std::pair<std::string_view, Section>, 11> kSections{{
      {"VERSION", &DbcParser::parse_version},
      {"NS_", &DbcParser::skip_new_symbols},
      {"BS_", &DbcParser::skip_bus_timing},
      {"BU_", &DbcParser::parse_nodes},
      {"BO_", &DbcParser::parse_message},
      {"SIG_VALTYPE_", &DbcParser::parse_signal_type},
      {"VAL_", &DbcParser::parse_value_names},
      {"CM_", &DbcParser::parse_comment},
      {"BA_DEF_", &DbcParser::parse_attribute_definition},
      {"BA_DEF_DEF_", &DbcParser::parse_attribute_default},
      {"BA_", &DbcParser::parse_attribute},
  }};
  const auto found = std::find_if(kSections.begin(), kSections.end(),
                                  [&](const auto& section) { return section.first == keyword; });
  return found == kSections.end() ? nullptr : found->second;
}

void DbcParser::parse_section() {
  if (accept(';')) return;
  const DbcToken keyword = lexer_.peek();
  if (keyword.kind != DbcTokenKind::kIdentifier) fail(keyword, "a section such as BO_");
  if (const Section section = find_section(keyword.text)) {
    lexer_.take();
    (this->*section)();
    return;
  }
  if (keyword.text == "SG_" || !looks_like_section(keyword.text)) {
    fail(keyword, "a section such as BO_");
  }
  warn(keyword.position, fmt::format("section {} is not read", keyword.text));
  lexer_.take();
  skip_statement(keyword);
}

void DbcParser::skip_statement(const DbcToken& keyword) {
  for (;;) {
    const DbcToken token = lexer_.peek();
    if (token.kind == DbcTokenKind::kEnd) {
      fail(token, fmt::format("\";\" after {} of line {}", keyword.text, keyword.position.line));
    }
    // The start of another section ends a statement that lacks its semicolon.
    const bool is_next_section = token.kind == DbcTokenKind::kIdentifier &&
                                 token.position.column == 1 && find_section(token.text) != nullptr;
    if (is_next_section) return;
    lexer_.take();
    if (is_punctuation(token, ';')) return;
  }
}

void DbcParser::parse_version() { database_.version = expect_string("the version, a string"); }

void DbcParser::skip_new_symbols() {
  accept(':');
  const auto begins_section = [this] {
    const DbcToken& token = lexer_.peek();
    if (is_word(token, "BS_") || is_word(token, "BU_") || is_word(token, "BO_")) return true;
    DbcLexer ahead = lexer_;
    ahead.take();
    return ahead.peek().kind != DbcTokenKind::kIdentifier &&
           ahead.peek().kind != DbcTokenKind::kEnd;
  };
  while (lexer_.peek().kind == DbcTokenKind::kIdentifier && !begins_section()) lexer_.take();
}

void DbcParser::skip_bus_timing() {
  while (is_on_same_line() && lexer_.peek().kind != DbcTokenKind::kEnd) lexer_.take();
}

void DbcParser::parse_nodes() {
  expect(':');
  while (lexer_.peek().kind == DbcTokenKind::kIdentifier &&
         (is_on_same_line() || lexer_.peek().position.column > 1)) {
    const DbcToken token = lexer_.take();
    std::string node(token.text);
    if (!node_names_.insert(node).second) {
      warn(token.position, fmt::format("node {} is listed twice", node));
      continue;
    }
    database_.nodes.push_back(std::move(node));
  }
}

void DbcParser::parse_message() {
  DbcMessage message;
  const DbcToken id_token = lexer_.peek();
  const auto file_id = expect_integer<std::uint32_t>("a message identifier");
  message.position = id_token.position;
  message.is_extended = (file_id & kExtendedIdFlag) != 0;
  message.id = file_id & ~kExtendedIdFlag;
  const bool is_pseudo = file_id == kIndependentSignalsId;
  if (!is_pseudo && message.id > (message.is_extended ? kMaxExtendedDbcId : kMaxStandardDbcId)) {
    fail(id_token, fmt::format("an identifier up to {}, or up to {} with bit 31 set",
                               kMaxStandardDbcId, kMaxExtendedDbcId));
  }
  message.name = expect_identifier("the message's name");
  expect(':');
  const DbcToken length_token = lexer_.peek();
  message.length = expect_integer<std::uint16_t>("the message's length in bytes");
  if (message.length > kMaxFramePayload) {
    warn(length_token.position,
         fmt::format("message {} has {} bytes, more than a frame carries ({})", message.name,
                     message.length, kMaxFramePayload));
  }
  if (is_on_same_line() && lexer_.peek().kind == DbcTokenKind::kIdentifier) {
    message.transmitter = lexer_.take().text;
  }
  SignalIndex index;
  while (accept_word("SG_")) parse_signal(message, index);
  if (is_pseudo) return;
  if (!message_index_.emplace(file_id, database_.messages.size()).second) {
    warn(message.position,
         fmt::format("message identifier {} of {} is used before, by {}", file_id, message.name,
                     database_.messages[message_index_[file_id]].name));
  }
  database_.messages.push_back(std::move(message));
  signal_index_.push_back(std::move(index));
}

void DbcParser::parse_signal(DbcMessage& message, SignalIndex& index) {
  DbcSignal signal;
  signal.position = lexer_.peek().position;
  signal.name = expect_identifier("the signal's name");
  parse_multiplexing(signal);
  expect(':');
  parse_bit_layout(signal);
  parse_scaling(signal);
  parse_range(signal);
  signal.unit = expect_string("the unit, a string");
  parse_receivers(signal);
  check_extent(message, signal);
  if (!index.emplace(signal.name, message.signals.size()).second) {
    warn(signal.position, fmt::format("message {} has two signals {}", message.name, signal.name));
  }
  message.signals.push_back(std::move(signal));
}

void DbcParser::parse_multiplexing(DbcSignal& signal) {
  if (lexer_.peek().kind != DbcTokenKind::kIdentifier) return;
  const DbcToken token = lexer_.take();
  std::string_view mark = token.text;
  constexpr std::string_view kExpected = "\"M\", \"m<number>\" or \":\"";
  if (mark.ends_with('M')) {
    signal.is_multiplexer = true;
    mark.remove_suffix(1);
  }
  if (mark.empty()) return;
  if (!mark.starts_with('m')) fail(token, kExpected);
  mark.remove_prefix(1);
  std::uint32_t value = 0;
  const auto [end, error] = std::from_chars(mark.data(), mark.data() + mark.size(), value);
  if (error != std::errc{} || end != mark.data() + mark.size()) fail(token, kExpected);
  signal.multiplexer = 0;
  signal.multiplexer_ranges.push_back({value, value});
}

void DbcParser::parse_bit_layout(DbcSignal& signal) {
  const DbcToken start_token = lexer_.peek();
  signal.start_bit = expect_integer<std::uint16_t>("the start bit");
  if (signal.start_bit >= 8 * kMaxFramePayload) {
    fail(start_token, fmt::format("a start bit up to {}", 8 * kMaxFramePayload - 1));
  }
  expect('|');
  const DbcToken count_token = lexer_.peek();
  signal.bit_count = expect_integer<std::uint16_t>("the number of bits");
  if (signal.bit_count < 1 || signal.bit_count > kMaxSignalBits) {
    fail(count_token, fmt::format("1 to {} bits", kMaxSignalBits));
  }
  expect('@');
  const DbcToken order_token = lexer_.take();
  // "@1+" and "@1-": the sign never sticks to the number, as it stands behind it.
  if (order_token.text == "1") {
    signal.byte_order = ByteOrder::kLittleEndian;
  } else if (order_token.text == "0") {
    signal.byte_order = ByteOrder::kBigEndian;
  } else {
    fail(order_token, "the byte order, 1 (Intel) or 0 (Motorola)");
  }
  if (accept('-')) {
    signal.type = SignalType::kSigned;
  } else if (!accept('+')) {
    fail(lexer_.peek(), "\"+\" (unsigned) or \"-\" (signed)");
  }
  if (payload_bytes_needed(signal) > kMaxFramePayload) {
    fail(count_token, fmt::format("a signal that ends within {} bytes", kMaxFramePayload));
  }
}

void DbcParser::parse_scaling(DbcSignal& signal) {
  expect('(');
  const DbcToken factor_token = lexer_.peek();
  signal.factor = expect_number("the factor");
  if (signal.factor == 0.0) fail(factor_token, "a factor other than zero");
  expect(',');
  signal.offset = expect_number("the offset");
  expect(')');
}

void DbcParser::parse_range(DbcSignal& signal) {
  expect('[');
  signal.minimum = expect_number("the minimum");
  expect('|');
  signal.maximum = expect_number("the maximum");
  expect(']');
}

void DbcParser::parse_receivers(DbcSignal& signal) {
  while (is_on_same_line() && lexer_.peek().kind == DbcTokenKind::kIdentifier) {
    signal.receivers.emplace_back(lexer_.take().text);
    accept(',');
  }
}

void DbcParser::check_extent(const DbcMessage& message, const DbcSignal& signal) {
  const std::size_t needed = payload_bytes_needed(signal);
  const bool has_payload = message.id != (kIndependentSignalsId & ~kExtendedIdFlag);
  if (!has_payload || needed <= message.length) return;
  warn(signal.position, fmt::format("signal {} needs {} bytes, message {} has {}", signal.name,
                                    needed, message.name, message.length));
}

void DbcParser::parse_signal_type() {
  const DbcPosition position = lexer_.peek().position;
  DbcSignal* const signal = parse_signal_reference();
  accept(':');
  const DbcToken type_token = lexer_.peek();
  const auto type = expect_integer<std::uint32_t>("the signal's type");
  expect(';');
  if (type > 2) fail(type_token, "0 (integer), 1 (float) or 2 (double)");
  if (signal == nullptr || type == 0) return;
  const int bits = type == 1 ? 32 : 64;
  if (signal->bit_count != bits) {
    throw DbcError(database_.source, position,
                   fmt::format("found a float of {} bits in signal {}, expected {}",
                               signal->bit_count, signal->name, bits));
  }
  signal->type = type == 1 ? SignalType::kFloat32 : SignalType::kFloat64;
}

void DbcParser::parse_value_names() {
  const DbcToken keyword = lexer_.peek();
  if (keyword.kind == DbcTokenKind::kIdentifier) {
    warn(keyword.position,
         fmt::format("value names of environment variable {} are not read", keyword.text));
    skip_statement(keyword);
    return;
  }
  DbcSignal* const signal = parse_signal_reference();
  while (!accept(';')) {
    const DbcToken value_token = expect(DbcTokenKind::kNumber, "a value or \";\"");
    const auto value = to_whole_number(value_token);
    if (!value) fail(value_token, "a whole number");
    std::string value_name = expect_string("the value's name, a string");
    if (signal == nullptr) continue;
    signal->value_names.push_back({*value, std::move(value_name)});
  }
}

void DbcParser::parse_comment() {
  std::string* comment = nullptr;
  if (lexer_.peek().kind == DbcTokenKind::kString) {
    comment = &database_.comment;
  } else if (accept_word("BU_")) {
    comment = &database_.node_comments[expect_identifier("a node")];
  } else if (accept_word("BO_")) {
    if (DbcMessage* const message = parse_message_reference()) comment = &message->comment;
  } else if (accept_word("SG_")) {
    if (DbcSignal* const signal = parse_signal_reference()) comment = &signal->comment;
  } else if (accept_word("EV_")) {
    expect_identifier("an environment variable");
  } else {
    fail(lexer_.peek(), "BU_, BO_, SG_, EV_ or the comment, a string");
  }
  std::string text = expect_string("the comment, a string");
  expect(';');
  if (comment != nullptr) *comment = std::move(text);
}

void DbcParser::parse_attribute_definition() {
  for (const std::string_view object : {"BU_", "BO_", "SG_", "EV_"}) {
    if (accept_word(object)) break;
  }
  std::string name = expect_string("the attribute's name, a string");
  definitions_[std::move(name)] = parse_attribute_kind();
  expect(';');
}

AttributeDefinition DbcParser::parse_attribute_kind() {
  AttributeDefinition definition;
  const DbcToken kind = lexer_.take();
  if (is_word(kind, "INT") || is_word(kind, "HEX")) {
    definition.kind = AttributeKind::kInteger;
  } else if (is_word(kind, "FLOAT")) {
    definition.kind = AttributeKind::kFloat;
  } else if (is_word(kind, "ENUM")) {
    definition.kind = AttributeKind::kEnumeration;
    do {
      definition.values.push_back(expect_string("a value of the enumeration, a string"));
    } while (accept(','));
  } else if (!is_word(kind, "STRING")) {
    fail(kind, "INT, HEX, FLOAT, STRING or ENUM");
  }
  // The bounds of numbers are optional, and not enforced.
  while (lexer_.peek().kind == DbcTokenKind::kNumber) lexer_.take();
  return definition;
}

void DbcParser::parse_attribute_default() {
  const std::string name = expect_string("the attribute's name, a string");
  database_.default_attributes[name] = parse_attribute_value(name);
  expect(';');
}

void DbcParser::parse_attribute() {
  const std::string name = expect_string("the attribute's name, a string");
  DbcAttributes* attributes = nullptr;
  if (accept_word("BU_")) {
    attributes = &database_.node_attributes[expect_identifier("a node")];
  } else if (accept_word("BO_")) {
    if (DbcMessage* const message = parse_message_reference()) attributes = &message->attributes;
  } else if (accept_word("SG_")) {
    if (DbcSignal* const signal = parse_signal_reference()) attributes = &signal->attributes;
  } else if (accept_word("EV_")) {
    expect_identifier("an environment variable");
  } else {
    attributes = &database_.attributes;
  }
  DbcAttributeValue value = parse_attribute_value(name);
  expect(';');
  if (attributes != nullptr) (*attributes)[name] = std::move(value);
}

DbcAttributeValue DbcParser::parse_attribute_value(const std::string& name) {
  const DbcToken token = lexer_.take();
  if (token.kind != DbcTokenKind::kString && token.kind != DbcTokenKind::kNumber) {
    fail(token, "the attribute's value, a string or a number");
  }
  const auto found = definitions_.find(name);
  if (found == definitions_.end()) {
    warn(token.position, fmt::format("attribute {} is not defined before it is used", name));
    if (token.kind == DbcTokenKind::kString) return string_value(token);
    return numeric_value({AttributeKind::kInteger, {}}, token);
  }
  const AttributeDefinition& definition = found->second;
  if (definition.kind == AttributeKind::kEnumeration) return enumeration_value(definition, token);
  if (token.kind == DbcTokenKind::kString) {
    if (definition.kind != AttributeKind::kString) {
      warn(token.position, fmt::format("attribute {} is a number, but has a text", name));
    }
    return string_value(token);
  }
  return numeric_value(definition, token);
}

DbcAttributeValue DbcParser::enumeration_value(const AttributeDefinition& definition,
                                               const DbcToken& token) {
  const std::vector<std::string>& values = definition.values;
  if (token.kind == DbcTokenKind::kNumber) {
    const auto index = to_number<std::size_t>(token);
    if (!index || *index >= values.size()) {
      fail(token, fmt::format("an index below {} or one of \"{}\"", values.size(),
                              fmt::join(values, "\", \"")));
    }
    return values[*index];
  }
  std::string text = string_value(token);
  if (std::find(values.begin(), values.end(), text) == values.end()) {
    warn(token.position, fmt::format("\"{}\" is none of the enumeration's values \"{}\"", text,
                                     fmt::join(values, "\", \"")));
  }
  return text;
}

DbcAttributeValue DbcParser::numeric_value(const AttributeDefinition& definition,
                                           const DbcToken& token) {
  if (definition.kind == AttributeKind::kString) {
    warn(token.position, "the attribute is a text, but has a number");
    return std::string(token.text);
  }
  if (definition.kind == AttributeKind::kInteger) {
    if (const auto integer = to_whole_number(token)) return *integer;
  }
  const auto number = to_number<double>(token);
  if (!number) fail(token, "a number that a double can hold");
  return *number;
}

DbcMessage* DbcParser::parse_message_reference() {
  const DbcToken token = lexer_.peek();
  const auto file_id = expect_integer<std::uint32_t>("a message identifier");
  const auto found = message_index_.find(file_id);
  if (found != message_index_.end()) return &database_.messages[found->second];
  if (file_id != kIndependentSignalsId) {
    warn(token.position, fmt::format("there is no message with identifier {}", file_id));
  }
  return nullptr;
}

DbcSignal* DbcParser::parse_signal_reference() {
  DbcMessage* const message = parse_message_reference();
  const DbcToken token = lexer_.peek();
  const std::string name = expect_identifier("a signal");
  if (message == nullptr) return nullptr;
  const auto message_number = static_cast<std::size_t>(message - database_.messages.data());
  const SignalIndex& index = signal_index_[message_number];
  const auto found = index.find(name);
  if (found != index.end()) return &message->signals[found->second];
  warn(token.position, fmt::format("message {} has no signal {}", message->name, name));
  return nullptr;
}

bool DbcParser::accept(char punctuation) {
  if (!is_punctuation(lexer_.peek(), punctuation)) return false;
  lexer_.take();
  return true;
}

bool DbcParser::accept_word(std::string_view word) {
  if (!is_word(lexer_.peek(), word)) return false;
  lexer_.take();
  return true;
}

DbcToken DbcParser::expect(DbcTokenKind kind, std::string_view expected) {
  if (lexer_.peek().kind != kind) fail(lexer_.peek(), expected);
  return lexer_.take();
}

void DbcParser::expect(char punctuation) {
  if (!accept(punctuation)) fail(lexer_.peek(), fmt::format("\"{}\"", punctuation));
}

std::string DbcParser::expect_identifier(std::string_view expected) {
  return std::string(expect(DbcTokenKind::kIdentifier, expected).text);
}

std::string DbcParser::expect_string(std::string_view expected) {
  return string_value(expect(DbcTokenKind::kString, expected));
}

double DbcParser::expect_number(std::string_view expected) {
  const DbcToken token = expect(DbcTokenKind::kNumber, expected);
  const auto number = to_number<double>(token);
  if (!number) fail(token, fmt::format("{}, a number that a double can hold", expected));
  return *number;
}

template <class T>
T DbcParser::expect_integer(std::string_view expected) {
  const DbcToken token = expect(DbcTokenKind::kNumber, expected);
  const auto integer = to_number<T>(token);
  if (!integer) {
    fail(token,
         fmt::format("{}, a whole number up to {}", expected, std::numeric_limits<T>::max()));
  }
  return *integer;
}

void DbcParser::fail(const DbcToken& found, std::string_view expected) const {
  throw DbcError(database_.source, found.position,
                 fmt::format("found {}, expected {}", describe(found), expected));
}

void DbcParser::warn(DbcPosition position, std::string text) {
  database_.warnings.push_back({position, std::move(text)});
}

std::string read_text(const std::filesystem::path& file) {
  if (std::filesystem::is_directory(file)) {
    throw std::system_error(EISDIR, std::generic_category(), "cannot read " + file.string());
  }
  std::ifstream stream(file, std::ios::binary);
  if (!stream) {
    throw std::system_error(errno, std::generic_category(), "cannot read " + file.string());
  }
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

}  // namespace

DbcError::DbcError(const std::string& source, DbcPosition position, const std::string& text)
    : std::runtime_error(fmt::format("{}:{}:{}: {}", source, position.line, position.column, text)),
      position_(position) {}

DbcDatabase parse_dbc(std::string_view text, const std::string& source) {
  return DbcParser(text, source).parse();
}

DbcDatabase read_dbc(const std::filesystem::path& file) {
  return parse_dbc(read_text(file), file.string());
}

}  // namespace faultline
