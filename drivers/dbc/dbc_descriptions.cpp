// Statements that describe what other statements define: names of values, comments, groups,
// transmitters, types and multiplexing of signals; and environment variables.
#include <algorithm>
#include <cmath>
#include <utility>

#include "drivers/dbc/dbc_parse.h"

namespace faultline {
namespace {

/// `0 "off" 1 "on" ;`
bool parse_pairs(DbcParse& parse, std::vector<DbcValueName>& to) {
  DbcStatementReader& reader = parse.reader;
  DbcChunks<DbcValueName> names;
  bool is_understood = true;
  while (is_understood && !reader.is_at(';') && !reader.is_at_statement()) {
    DbcValueName name;
    is_understood = reader.expect_raw_value(name.value, "a value, a whole number, or \";\"") &&
                    reader.expect_string(name.name, "the value's name, a string");
    if (is_understood) names.push_back(std::move(name));
    reader.accept(',');
  }
  names.move_to(to);
  return is_understood && reader.expect_end();
}

/// The name of a value table instead of pairs.
bool parse_table_name(DbcParse& parse, std::vector<DbcValueName>& to) {
  const DbcPosition position = parse.reader.peek().position;
  std::string_view name;
  if (!parse.reader.expect_name(name, "a value table")) return false;
  const std::uint32_t table = parse.table_names.find(
      std::hash<std::string_view>{}(name),
      [&](std::uint32_t n) { return parse.database.value_tables[n].name == name; });
  if (table == kNoDbcItem) {
    parse.warnings.warn(position, "there is no value table {}", shown(name));
    return parse.reader.expect_end();
  }
  std::size_t cost = 0;
  for (const DbcValueName& value : parse.database.value_tables[table].values) {
    cost += sizeof(value) + value.name.size();
  }
  if (cost > parse.copies_left) {
    parse.warnings.warn(position, "value table {} is used too often; it is not copied here",
                        shown(name));
    return parse.reader.expect_end();
  }
  parse.copies_left -= cost;
  const std::vector<DbcValueName>& values = parse.database.value_tables[table].values;
  to.insert(to.end(), values.begin(), values.end());
  return parse.reader.expect_end();
}

bool parse_value_names_of(DbcParse& parse, std::vector<DbcValueName>& to) {
  const bool is_table = parse.reader.peek().kind == DbcTokenKind::kIdentifier &&
                        !parse.reader.is_at_statement() &&
                        !parse.reader.peek().text.starts_with("0x");
  return is_table ? parse_table_name(parse, to) : parse_pairs(parse, to);
}

/// Skips what is about nothing.
bool skip_rest(DbcParse& parse) {
  parse.reader.skip_statement();
  return true;
}

}  // namespace

bool parse_dbc_value_names(DbcParse& parse) {
  if (parse.reader.peek().kind == DbcTokenKind::kNumber) {
    std::uint32_t message = kNoDbcItem;
    std::uint32_t signal = kNoDbcItem;
    if (!expect_signal(parse, message, signal)) return false;
    if (signal == kNoDbcItem) return skip_rest(parse);
    return parse_value_names_of(parse, parse.messages[message].signals[signal].value_names);
  }
  std::uint32_t variable = kNoDbcItem;
  if (!expect_environment_variable(parse, variable)) return false;
  if (variable == kNoDbcItem) return skip_rest(parse);
  return parse_value_names_of(parse, parse.environment_variables[variable].value_names);
}

bool parse_dbc_value_table(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  const DbcPosition position = reader.peek().position;
  std::string_view name;
  if (!reader.expect_name(name, "a value table's name")) return false;
  const std::size_t hash = std::hash<std::string_view>{}(name);
  const auto number = static_cast<std::uint32_t>(parse.database.value_tables.size());
  const std::uint32_t before = parse.table_names.find(
      hash, [&](std::uint32_t n) { return parse.database.value_tables[n].name == name; });
  if (before == kNoDbcItem) {
    parse.table_names.insert(hash, number);
  } else {
    parse.warnings.warn(position, "there are two value tables {}", shown(name));
  }
  parse.database.value_tables.push_back({to_utf8(name), {}});
  return parse_pairs(parse, parse.database.value_tables.back().values);
}

bool parse_dbc_comment(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  std::string text;
  const auto expect_text = [&] {
    return reader.expect_string(text, "the comment, a string", DbcQuoting::kComment);
  };
  if (reader.accept_word("BU_")) {
    std::string_view node;
    bool is_known = false;
    if (!expect_node(parse, node, is_known) || !expect_text()) return false;
    if (is_known) parse.database.node_comments[to_utf8(node)] = std::move(text);
  } else if (reader.accept_word("BO_")) {
    std::uint32_t message = kNoDbcItem;
    if (!expect_message(parse, message) || !expect_text()) return false;
    if (message != kNoDbcItem) parse.messages[message].comment = std::move(text);
  } else if (reader.accept_word("SG_")) {
    std::uint32_t message = kNoDbcItem;
    std::uint32_t signal = kNoDbcItem;
    if (!expect_signal(parse, message, signal) || !expect_text()) return false;
    if (signal != kNoDbcItem) parse.messages[message].signals[signal].comment = std::move(text);
  } else if (reader.accept_word("EV_")) {
    std::uint32_t variable = kNoDbcItem;
    if (!expect_environment_variable(parse, variable) || !expect_text()) return false;
    if (variable != kNoDbcItem) parse.environment_variables[variable].comment = std::move(text);
  } else if (reader.peek().kind == DbcTokenKind::kString) {
    if (!expect_text()) return false;
    parse.database.comment = std::move(text);
  } else {
    return reader.fail(reader.peek(), "BU_, BO_, SG_, EV_ or the comment, a string");
  }
  return reader.expect_end();
}

bool parse_dbc_signal_type(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  std::uint32_t message = kNoDbcItem;
  std::uint32_t number = kNoDbcItem;
  const DbcPosition position = reader.peek().position;
  if (!expect_signal(parse, message, number)) return false;
  reader.accept(':');
  const DbcToken type_token = reader.peek();
  std::uint32_t type = 0;
  if (!reader.expect_integer(type, "the signal's type")) return false;
  if (type > 2) return reader.fail(type_token, "0 (integer), 1 (float) or 2 (double)");
  if (number != kNoDbcItem && type != 0) {
    DbcSignal& signal = parse.messages[message].signals[number];
    signal.type = type == 1 ? SignalType::kFloat32 : SignalType::kFloat64;
    const int bits = type == 1 ? 32 : 64;
    if (signal.bit_count != bits) {
      parse.warnings.warn(position, "signal {} is a float of {} bits, expected {}; it has no value",
                          shown(signal.name), signal.bit_count, bits);
    }
  }
  return reader.expect_end();
}

bool parse_dbc_signal_group(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  DbcSignalGroup group;
  std::uint32_t message = kNoDbcItem;
  std::string_view name;
  if (!expect_message(parse, message) || !reader.expect_name(name, "the group's name") ||
      !reader.expect_integer(group.repetitions, "the group's repetitions")) {
    return false;
  }
  reader.accept(':');
  while (reader.is_at_name()) {
    const DbcPosition position = reader.peek().position;
    std::string_view signal;
    if (!reader.expect_name(signal, "a signal")) return false;
    reader.accept(',');
    if (message != kNoDbcItem && find_dbc_signal(parse, message, signal) == kNoDbcItem) {
      parse.warnings.warn(position, "message {} has no signal {}",
                          shown(parse.messages[message].name), shown(signal));
    }
    group.signals.push_back(to_utf8(signal));
  }
  if (message != kNoDbcItem) {
    group.name = to_utf8(name);
    group.message = message;
    parse.database.signal_groups.push_back(std::move(group));
  }
  return reader.expect_end();
}

bool parse_dbc_transmitters(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  std::uint32_t message = kNoDbcItem;
  if (!expect_message(parse, message) || !reader.expect(':')) return false;
  while (reader.is_at_name()) {
    std::string_view node;
    if (!reader.expect_name(node, "a node")) return false;
    reader.accept(',');
    if (message == kNoDbcItem) continue;
    parse.messages[message].other_transmitters.push_back(to_utf8(node));
  }
  return reader.expect_end();
}

/// `EV_ name: type [minimum|maximum] "unit" initial number access nodes;`
bool parse_dbc_environment_variable(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  DbcEnvironmentVariable variable;
  variable.position = reader.peek().position;
  std::string_view name;
  std::uint32_t type = 0;
  std::uint32_t number = 0;
  std::string_view access;
  if (!reader.expect_name(name, "an environment variable's name") || !reader.expect(':') ||
      !reader.expect_integer(type, "the variable's type") || !reader.expect('[') ||
      !reader.expect_number(variable.minimum, "the minimum") || !reader.expect('|') ||
      !reader.expect_number(variable.maximum, "the maximum") || !reader.expect(']') ||
      !reader.expect_string(variable.unit, "the unit, a string") ||
      !reader.expect_number(variable.initial, "the initial value") ||
      !reader.expect_integer(number, "the variable's number") ||
      !reader.expect_name(access, "the access type")) {
    return false;
  }
  while (reader.is_at_name()) {
    std::string_view node;
    if (!reader.expect_name(node, "a node")) return false;
    reader.accept(',');
    variable.nodes.push_back(to_utf8(node));
  }
  variable.name = to_utf8(name);
  const std::size_t hash = std::hash<std::string_view>{}(variable.name);
  const std::uint32_t before = parse.environment_names.find(
      hash, [&](std::uint32_t n) { return parse.environment_variables[n].name == variable.name; });
  if (before == kNoDbcItem) {
    parse.environment_names.insert(hash,
                                   static_cast<std::uint32_t>(parse.environment_variables.size()));
  } else {
    parse.warnings.warn(variable.position, "there are two environment variables {}",
                        shown(variable.name));
  }
  parse.environment_variables.push_back(std::move(variable));
  return reader.expect_end();
}

/// `SG_MUL_VAL_ message signal multiplexer 0-3, 7-7;`
bool parse_dbc_multiplexing(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  std::uint32_t message = kNoDbcItem;
  std::uint32_t number = kNoDbcItem;
  if (!expect_signal(parse, message, number)) return false;
  const DbcPosition position = reader.peek().position;
  std::string_view name;
  if (!reader.expect_name(name, "the multiplexer's name")) return false;
  if (number == kNoDbcItem) return skip_rest(parse);
  const std::uint32_t found = find_dbc_signal(parse, message, name);
  if (found == kNoDbcItem || found == number) {
    parse.warnings.warn(position, "found \"{}\", expected another signal of message {}",
                        shown(name), shown(parse.messages[message].name));
    return skip_rest(parse);
  }
  DbcSignal& signal = parse.messages[message].signals[number];
  const auto multiplexer = static_cast<std::int32_t>(found);
  if (signal.multiplexer >= 0 && signal.multiplexer != multiplexer) {
    parse.warnings.warn(position, "signal {} has a multiplexer already; this one does not count",
                        shown(signal.name));
    return skip_rest(parse);
  }
  std::vector<DbcMultiplexRange> ranges;
  do {
    const DbcPosition range_position = reader.peek().position;
    DbcMultiplexRange range;
    if (!reader.expect_range(range)) return false;
    if (range.first > range.last) {
      parse.warnings.warn(range_position, "found the range {}-{}, expected the lesser value first",
                          range.first, range.last);
      std::swap(range.first, range.last);
    }
    ranges.push_back(range);
  } while (reader.accept(',') || reader.peek().kind == DbcTokenKind::kNumber);
  // The ranges come instead of the one value in the line SG_, or in addition to earlier ranges.
  if (signal.multiplexer < 0) signal.multiplexer_ranges.clear();
  signal.multiplexer_ranges.insert(signal.multiplexer_ranges.end(), ranges.begin(), ranges.end());
  signal.multiplexer = multiplexer;
  parse.messages[message].signals[found].is_multiplexer = true;
  return reader.expect_end();
}

}  // namespace faultline
