#include "drivers/dbc/dbc_parser.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "drivers/dbc/dbc_parse.h"

namespace faultline {
namespace {

constexpr std::uint16_t kMaxFramePayload = 64;
constexpr std::uint16_t kMaxSignalBits = 64;
/// A NUL among so many bytes at the beginning: no text.
constexpr std::size_t kLookForNul = 4096;

std::string name_for_people(const std::string& name) { return shown(name); }

/// True for a name as the format wants it: letters, digits and `_`, not beginning with a digit.
bool is_c_identifier(std::string_view name) noexcept {
  const auto is_letter = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
  };
  return !name.empty() && is_letter(name.front()) &&
         std::all_of(name.begin(), name.end(),
                     [&](char c) { return is_letter(c) || (c >= '0' && c <= '9'); });
}

bool expect_new_name(DbcParse& parse, std::string& name, std::string_view expected) {
  const DbcToken token = parse.reader.peek();
  std::string_view text;
  if (!parse.reader.expect_name(text, expected)) return false;
  const bool is_identifier_token = token.kind == DbcTokenKind::kIdentifier &&
                                   text.size() == token.text.size() && text.front() > '9';
  if (is_identifier_token || is_c_identifier(text)) {
    name = text;
    return true;
  }
  const DbcPosition position = token.position;
  name = to_utf8(text);
  parse.warnings.warn(position,
                      "the name \"{}\" is no C identifier, and so not what the format allows",
                      shown(text));
  return true;
}

bool parse_version(DbcParse& parse) {
  if (!parse.reader.expect_string(parse.database.version, "the version, a string")) return false;
  parse.reader.accept(';');
  return true;
}

/// True if the line on which the next token stands holds nothing but words in capitals.
bool is_line_of_symbols(const DbcStatementReader& reader) {
  DbcLexer ahead = reader.lexer();
  do {
    const DbcToken& token = ahead.peek();
    const bool is_symbol = token.kind == DbcTokenKind::kIdentifier &&
                           std::none_of(token.text.begin(), token.text.end(),
                                        [](char c) { return c >= 'a' && c <= 'z'; });
    if (!is_symbol) return false;
    ahead.take();
  } while (!ahead.peek().starts_line);
  return true;
}

bool skip_new_symbols(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  reader.accept(':');
  while (!reader.is_at_end() && !reader.peek().starts_line) reader.take();
  while (!reader.is_at_end() && is_line_of_symbols(reader)) {
    do {
      reader.take();
    } while (!reader.peek().starts_line);
  }
  return true;
}

bool skip_bus_timing(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  while (reader.peek().kind == DbcTokenKind::kNumber ||
         reader.peek().kind == DbcTokenKind::kPunctuation) {
    reader.take();
  }
  return true;
}

bool parse_nodes(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  if (!reader.expect(':')) return false;
  DbcChunks<std::string> nodes;
  const std::size_t first_new = parse.database.nodes.size();
  while (reader.is_at_name()) {
    const DbcToken token = reader.peek();
    std::string node;
    if (!expect_new_name(parse, node, "a node")) return false;
    reader.accept(',');
    const std::size_t hash = std::hash<std::string_view>{}(node);
    const auto number = static_cast<std::uint32_t>(first_new + nodes.size());
    const std::uint32_t before = parse.node_names.find(hash, [&](std::uint32_t n) {
      return (n < first_new ? parse.database.nodes[n] : nodes[n - first_new]) == node;
    });
    if (before != kNoDbcItem) {
      parse.warnings.warn(token.position, "node {} is listed twice", shown(node));
      continue;
    }
    parse.node_names.insert(hash, number);
    nodes.push_back(std::move(node));
  }
  nodes.move_to(parse.database.nodes);
  reader.accept(';');
  return true;
}

bool parse_multiplexing_mark(DbcParse& parse, DbcSignal& signal) {
  DbcStatementReader& reader = parse.reader;
  if (reader.peek().kind != DbcTokenKind::kIdentifier) return true;
  const DbcToken token = reader.take();
  std::string_view mark = token.text;
  if (mark.ends_with('M')) {
    signal.is_multiplexer = true;
    mark.remove_suffix(1);
    if (mark.empty()) return true;
  }
  std::uint64_t value = 0;
  const bool has_value = mark.size() > 1 && mark.front() == 'm';
  const char* const end = mark.data() + mark.size();
  if (!has_value || std::from_chars(mark.data() + 1, end, value).ptr != end) {
    return reader.fail(token, "\"M\", \"m<number>\" or \":\"");
  }
  signal.multiplexer = kUnlinkedMultiplexer;
  signal.multiplexer_ranges.push_back({value, value});
  return true;
}

bool parse_bit_layout(DbcParse& parse, DbcSignal& signal) {
  DbcStatementReader& reader = parse.reader;
  if (!reader.expect_integer(signal.start_bit, "the start bit") || !reader.expect('|'))
    return false;
  if (!reader.expect_integer(signal.bit_count, "the number of bits") || !reader.expect('@')) {
    return false;
  }
  const DbcToken& order = reader.peek();
  const char digit = order.text.size() == 1 ? order.text.front() : ' ';
  if (digit != '0' && digit != '1') {
    return reader.fail(order, "the byte order, 1 (Intel) or 0 (Motorola)");
  }
  signal.byte_order = digit == '1' ? ByteOrder::kLittleEndian : ByteOrder::kBigEndian;
  reader.take();
  if (reader.accept('-')) {
    signal.type = SignalType::kSigned;
  } else if (!reader.accept('+')) {
    return reader.fail(reader.peek(), "\"+\" (unsigned) or \"-\" (signed)");
  }
  return true;
}

bool parse_scaling(DbcParse& parse, DbcSignal& signal) {
  DbcStatementReader& reader = parse.reader;
  if (!reader.expect('(')) return false;
  const DbcPosition position = reader.peek().position;
  if (!reader.expect_number(signal.factor, "the factor") || !reader.expect(',') ||
      !reader.expect_number(signal.offset, "the offset") || !reader.expect(')')) {
    return false;
  }
  if (signal.factor == 0.0) {
    parse.warnings.warn(position, "signal {} has the factor zero, and so no value",
                        name_for_people(signal.name));
  }
  return true;
}

/// "[0|100]"; what is left out, or no number, counts as not given.
bool parse_range(DbcParse& parse, double& minimum, double& maximum) {
  DbcStatementReader& reader = parse.reader;
  if (!reader.expect('[')) return false;
  if (reader.accept(']')) return true;
  if (!reader.is_at('|') && !reader.expect_number(minimum, "the minimum")) return false;
  if (!reader.expect('|')) return false;
  if (!reader.is_at(']') && !reader.expect_number(maximum, "the maximum")) return false;
  if (std::isnan(minimum) || std::isnan(maximum)) minimum = maximum = 0.0;
  return reader.expect(']');
}

void parse_receivers(DbcParse& parse, DbcSignal& signal) {
  DbcStatementReader& reader = parse.reader;
  bool is_behind_comma = reader.accept(',');
  // A name on a line of its own belongs to the list only if it is indented or a comma says so.
  while (reader.is_at_name() && reader.peek().kind == DbcTokenKind::kIdentifier &&
         !is_same_word(reader.peek().text, "SG_") && !is_same_word(reader.peek().text, "BO_") &&
         (is_behind_comma || !reader.peek().starts_line || reader.peek().position.column > 1)) {
    std::string_view name;
    static_cast<void>(reader.expect_name(name, "a receiver"));
    signal.receivers.push_back(is_c_identifier(name) ? name : std::string_view(to_utf8(name)));
    is_behind_comma = reader.accept(',');
  }
  reader.accept(';');
}

void check_extent(DbcParse& parse, const DbcMessage& message, const DbcSignal& signal) {
  if (signal.bit_count == 0 || signal.bit_count > kMaxSignalBits) {
    parse.warnings.warn(signal.position, "signal {} has {} bits, expected 1 to {}",
                        name_for_people(signal.name), signal.bit_count, kMaxSignalBits);
  }
  const std::size_t needed = signal.bit_count == 0 ? 0 : payload_bytes_needed(signal);
  if (needed <= message.length) return;
  parse.warnings.warn(signal.position, "signal {} needs {} bytes, message {} has {}",
                      name_for_people(signal.name), needed, name_for_people(message.name),
                      message.length);
}

bool parse_signal(DbcParse& parse, DbcSignal& signal) {
  DbcStatementReader& reader = parse.reader;
  reader.begin_statement("the signal is skipped");
  signal.position = reader.peek().position;
  if (!expect_new_name(parse, signal.name, "the signal's name") ||
      !parse_multiplexing_mark(parse, signal) || !reader.expect(':') ||
      !parse_bit_layout(parse, signal) || !parse_scaling(parse, signal) ||
      !parse_range(parse, signal.minimum, signal.maximum) ||
      !reader.expect_string(signal.unit, "the unit, a string")) {
    return false;
  }
  parse_receivers(parse, signal);
  return true;
}

/// Enters the name of the signal that has this number among the message's.
void index_signal(DbcParse& parse, std::uint32_t message_number, const DbcMessage& message,
                  const DbcSignal& signal, std::uint32_t number) {
  const std::uint32_t first = parse.first_signals[message_number];
  const std::size_t hash = std::hash<std::string_view>{}(signal.name) ^ message_number;
  const std::uint32_t before = parse.signal_names.find(hash, [&](std::uint32_t n) {
    return n >= first && message.signals[n - first].name == signal.name;
  });
  if (before == kNoDbcItem) {
    parse.signal_names.insert(hash, first + number);
    return;
  }
  parse.warnings.warn(signal.position, "message {} has two signals {}",
                      name_for_people(message.name), name_for_people(signal.name));
}

/// The lines SG_ that follow. @param keep whether they are signals of `message`
void parse_signals(DbcParse& parse, std::uint32_t number, DbcMessage& message, bool keep) {
  DbcStatementReader& reader = parse.reader;
  const std::string_view rest = reader.lexer().rest();
  // No line is counted twice, however many messages stand on one.
  if (keep && !rest.empty() && !std::less<>{}(rest.data(), parse.signals_counted_to)) {
    message.signals.reserve(count_leading_lines_of(rest, "SG_ ", parse.signals_counted_to));
  }
  while (reader.accept_word("SG_")) {
    if (!keep) {
      reader.skip_signal();
      continue;
    }
    const auto count = static_cast<std::uint32_t>(message.signals.size());
    DbcSignal& signal = message.signals.emplace_back();
    if (!parse_signal(parse, signal)) {
      message.signals.pop_back();
      reader.skip_signal();
      continue;
    }
    ++parse.understood_count;
    check_extent(parse, message, signal);
    index_signal(parse, number, message, signal, count);
  }
}

void check_message(DbcParse& parse, std::uint32_t file_id, const DbcMessage& message) {
  // Bits 29 and 30 mean nothing, but real files have them.
  if (message.is_extended && file_id != (message.id | kExtendedIdFlag)) {
    parse.warnings.warn(
        message.position,
        "message {} has the identifier {}, expected up to {}, or up to {} with bit 31 "
        "set; it is taken for the extended identifier {}",
        name_for_people(message.name), file_id, kMaxStandardDbcId, kMaxExtendedDbcId, message.id);
  }
  if (message.length > kMaxFramePayload) {
    parse.warnings.warn(message.position, "message {} has {} bytes, more than a frame carries ({})",
                        name_for_people(message.name), message.length, kMaxFramePayload);
  }
  const std::uint32_t same_id = parse.message_ids.find(message.id, [&](std::uint32_t n) {
    return parse.messages[n].id == message.id &&
           parse.messages[n].is_extended == message.is_extended;
  });
  if (same_id != kNoDbcItem) {
    parse.warnings.warn(message.position, "message identifier {} of {} is used before, by {}",
                        file_id, name_for_people(message.name),
                        name_for_people(parse.messages[same_id].name));
  }
  const std::uint32_t same_name = parse.message_names.find(
      std::hash<std::string_view>{}(message.name),
      [&](std::uint32_t n) { return parse.messages[n].name == message.name; });
  if (same_name != kNoDbcItem) {
    parse.warnings.warn(message.position, "there are two messages {}",
                        name_for_people(message.name));
  }
  const auto number = static_cast<std::uint32_t>(parse.messages.size());
  if (same_id == kNoDbcItem) parse.message_ids.insert(message.id, number);
  if (same_name == kNoDbcItem) {
    parse.message_names.insert(std::hash<std::string_view>{}(message.name), number);
  }
}

bool parse_message_head(DbcParse& parse, DbcMessage& message, std::uint32_t& file_id) {
  DbcStatementReader& reader = parse.reader;
  const DbcToken id_token = reader.peek();
  message.position = id_token.position;
  if (!reader.expect_integer(file_id, "a message identifier")) return false;
  const DbcId id = to_dbc_id(file_id);
  message.id = id.id;
  message.is_extended = id.is_extended;
  if (!expect_new_name(parse, message.name, "the message's name") || !reader.expect(':') ||
      !reader.expect_integer(message.length, "the message's length in bytes")) {
    return false;
  }
  // On a line of its own only if indented, as a wrapped line is.
  if (reader.is_at_name() && reader.peek().text != "SG_" &&
      (!reader.peek().starts_line || reader.peek().position.column > 1)) {
    std::string_view transmitter;
    static_cast<void>(reader.expect_name(transmitter, "the transmitter"));
    message.transmitter = to_utf8(transmitter);
  }
  reader.accept(';');
  return true;
}

bool parse_message(DbcParse& parse) {
  DbcMessage message;
  std::uint32_t file_id = 0;
  parse.reader.begin_statement("the message and its signals are skipped");
  if (!parse_message_head(parse, message, file_id)) {
    parse.last_message_failed = true;
    return false;
  }
  ++parse.understood_count;
  const bool is_pseudo = file_id == kIndependentSignalsId;
  const auto number = static_cast<std::uint32_t>(parse.messages.size());
  if (!is_pseudo) {
    check_message(parse, file_id, message);
    parse.first_signals.push_back(parse.signal_count);
  }
  parse_signals(parse, number, message, !is_pseudo);
  parse.last_message_failed = is_pseudo;
  if (is_pseudo) return true;
  parse.signal_count += static_cast<std::uint32_t>(message.signals.size());
  parse.messages.push_back(std::move(message));
  return true;
}

/// A line SG_ that does not stand right behind its message.
bool parse_late_signal(DbcParse& parse, DbcPosition position) {
  if (parse.last_message_failed) return false;  // its BO_ has been reported
  DbcStatementReader& reader = parse.reader;
  if (parse.messages.empty()) {
    reader.begin_statement("the signal is skipped");
    return reader.fail({DbcTokenKind::kIdentifier, false, "SG_", position},
                       "a message (BO_) before its signals");
  }
  DbcSignal signal;
  if (!parse_signal(parse, signal)) return false;
  const auto number = static_cast<std::uint32_t>(parse.messages.size() - 1);
  DbcMessage& message = parse.messages[number];
  parse.warnings.warn(position, "signal {} does not stand right behind its message {}",
                      name_for_people(signal.name), name_for_people(message.name));
  check_extent(parse, message, signal);
  index_signal(parse, number, message, signal, static_cast<std::uint32_t>(message.signals.size()));
  message.signals.push_back(std::move(signal));
  ++parse.signal_count;
  return true;
}

bool skip_unread(DbcParse& parse, const DbcToken& keyword) {
  std::vector<std::string_view>& noted = parse.unread_keywords;
  if (std::find(noted.begin(), noted.end(), keyword.text) == noted.end()) {
    noted.push_back(keyword.text);
    parse.warnings.add(DbcSeverity::kNote, keyword.position, "section {} is not read",
                       keyword.text);
  }
  parse.reader.skip_statement();
  return true;
}

bool parse_section(DbcParse& parse, DbcSection section, const DbcToken& keyword) {
  parse.reader.begin_statement("the statement is skipped");
  switch (section) {
    case DbcSection::kSignal:
      return parse_late_signal(parse, keyword.position);
    case DbcSection::kMessage:
      return parse_message(parse);
    case DbcSection::kValueNames:
      return parse_dbc_value_names(parse);
    case DbcSection::kComment:
      return parse_dbc_comment(parse);
    case DbcSection::kAttribute:
      return parse_dbc_attribute(parse);
    case DbcSection::kAttributeDefinition:
      return parse_dbc_attribute_definition(parse);
    case DbcSection::kAttributeDefault:
      return parse_dbc_attribute_default(parse);
    case DbcSection::kSignalType:
      return parse_dbc_signal_type(parse);
    case DbcSection::kMultiplexing:
      return parse_dbc_multiplexing(parse);
    case DbcSection::kValueTable:
      return parse_dbc_value_table(parse);
    case DbcSection::kSignalGroup:
      return parse_dbc_signal_group(parse);
    case DbcSection::kTransmitters:
      return parse_dbc_transmitters(parse);
    case DbcSection::kEnvironmentVariable:
      return parse_dbc_environment_variable(parse);
    case DbcSection::kNodes:
      return parse_nodes(parse);
    case DbcSection::kVersion:
      return parse_version(parse);
    case DbcSection::kNewSymbols:
      return skip_new_symbols(parse);
    case DbcSection::kBusTiming:
      return skip_bus_timing(parse);
    case DbcSection::kUnread:
      return skip_unread(parse, keyword);
    case DbcSection::kNone:
      break;
  }
  return false;
}

void parse_statement(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  if (reader.accept(';')) return;
  const bool is_section_like = reader.is_at_statement();
  const DbcToken keyword = reader.take();
  const DbcSection section =
      keyword.kind == DbcTokenKind::kIdentifier ? find_section(keyword.text) : DbcSection::kNone;
  if (section == DbcSection::kNone) {
    if (is_section_like) {
      parse.warnings.warn(keyword.position, "section {} is not known, and not read",
                          shown(keyword.text));
    } else if (keyword.starts_line || parse.understood_count == 0) {
      reader.begin_statement("what follows is skipped");
      static_cast<void>(reader.fail(keyword, "a section such as BO_"));
    } else {
      // The statement before it was whole: a stray quote, a comment, a semicolon too many.
      parse.warnings.warn(keyword.position,
                          "found {} behind the end of a statement; what follows is skipped",
                          describe(keyword));
    }
    reader.skip_statement();
    return;
  }
  if (!parse_section(parse, section, keyword)) {
    reader.skip_statement();
  } else if (section != DbcSection::kMessage) {
    ++parse.understood_count;
  }
}

/// @throws DbcError the text is binary or UTF-16
void require_text(std::string_view text, const std::string& source) {
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF")) {
    throw DbcError(source, {}, "found the mark of UTF-16 text, expected UTF-8 or Latin-1");
  }
  const std::size_t nul = text.substr(0, kLookForNul).find('\0');
  if (nul == std::string_view::npos) return;
  const auto before = text.substr(0, nul);
  const auto line = static_cast<int>(std::count(before.begin(), before.end(), '\n')) + 1;
  const std::size_t line_begin = before.rfind('\n') + 1;  // npos + 1 is 0
  throw DbcError(source, {line, static_cast<int>(nul - line_begin) + 1},
                 "found byte 0x00, expected text; this is no DBC file");
}

std::string read_text(const std::filesystem::path& file) {
  const auto fail = [&](int error) {
    throw std::system_error(error, std::generic_category(), "cannot read " + file.string());
  };
  if (std::filesystem::is_directory(file)) fail(EISDIR);
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> stream(std::fopen(file.c_str(), "rb"),
                                                               &std::fclose);
  if (!stream) fail(errno);
  std::string text;
  // A pipe has no size; a file may grow while it is read.
  std::error_code no_size;
  const std::uintmax_t size = std::filesystem::file_size(file, no_size);
  std::size_t length = 0;
  std::size_t next = no_size ? 1 << 16 : static_cast<std::size_t>(size) + 1;
  for (;;) {
    text.resize(length + next);
    length += std::fread(text.data() + length, 1, next, stream.get());
    if (std::ferror(stream.get()) != 0) fail(errno);
    if (length < text.size()) break;
    next = text.size();
  }
  text.resize(length);
  return text;
}

}  // namespace

DbcError::DbcError(const std::string& source, DbcPosition position, const std::string& text)
    : std::runtime_error(fmt::format("{}:{}:{}: {}", source, position.line, position.column, text)),
      position_(position) {}

DbcDatabase parse_dbc(std::string_view text, const std::string& source) {
  require_text(text, source);
  DbcParse parse(text);
  parse.database.source = source;
  while (!parse.reader.is_at_end()) parse_statement(parse);
  if (parse.understood_count == 0) {
    DbcDatabase empty;
    parse.warnings.move_to(empty);
    for (const DbcWarning& warning : empty.warnings) {
      if (warning.severity == DbcSeverity::kError) {
        throw DbcError(source, warning.position, warning.text);
      }
    }
    throw DbcError(source, parse.reader.peek().position,
                   "found the end of the file, expected a section such as BO_");
  }
  finish_dbc(parse);
  parse.warnings.move_to(parse.database);
  return std::move(parse.database);
}

DbcDatabase read_dbc(const std::filesystem::path& file) {
  return parse_dbc(read_text(file), file.string());
}

}  // namespace faultline
