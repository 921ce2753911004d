// Attributes: BA_DEF_ (kinds), BA_DEF_DEF_ (defaults) and BA_ (values).
#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "drivers/dbc/dbc_parse.h"

namespace faultline {
namespace {

constexpr std::string_view kExpectedName = "the attribute's name, a string";
/// An enumeration longer than this is searched by bisection.
constexpr std::size_t kShortEnumeration = 16;

/// The kind of object whose keyword comes next, which is taken.
DbcObject accept_object(DbcStatementReader& reader) noexcept {
  if (reader.accept_word("BU_")) return DbcObject::kNode;
  if (reader.accept_word("BO_")) return DbcObject::kMessage;
  if (reader.accept_word("SG_")) return DbcObject::kSignal;
  if (reader.accept_word("EV_")) return DbcObject::kEnvironmentVariable;
  return DbcObject::kNetwork;
}

bool parse_kind(DbcStatementReader& reader, DbcAttributeDefinition& definition) {
  const auto accept = [&](std::string_view word, DbcAttributeKind kind) {
    if (!reader.accept_word(word)) return false;
    definition.kind = kind;
    return true;
  };
  if (accept("STRING", DbcAttributeKind::kString)) return true;
  if (accept("ENUM", DbcAttributeKind::kEnumeration)) {
    DbcChunks<std::string> values;
    while (reader.peek().kind == DbcTokenKind::kString) {
      std::string value;
      if (!reader.expect_string(value, "a value of the enumeration, a string")) return false;
      values.push_back(std::move(value));
      reader.accept(',');
    }
    values.move_to(definition.values);
    return true;
  }
  if (!accept("INT", DbcAttributeKind::kInteger) && !accept("HEX", DbcAttributeKind::kInteger) &&
      !accept("FLOAT", DbcAttributeKind::kFloat)) {
    return reader.fail(reader.peek(), "INT, HEX, FLOAT, STRING or ENUM");
  }
  // The bounds of numbers are optional, and not enforced.
  while (!reader.is_at(';') && !reader.is_at_statement()) {
    double bound = 0.0;
    if (!reader.expect_number(bound, "a bound of the attribute, or \";\"")) return false;
    reader.accept(',');
  }
  return true;
}

/// An attribute's value in the file.
struct WrittenValue {
  DbcPosition position;
  bool is_text = false;
  std::string text;  ///< as written, if a number
};

bool expect_value(DbcStatementReader& reader, WrittenValue& value) {
  const DbcToken token = reader.peek();
  value.position = token.position;
  value.is_text = token.kind == DbcTokenKind::kString;
  if (value.is_text) return reader.expect_string(value.text, "the attribute's value");
  double number = 0.0;
  if (token.kind == DbcTokenKind::kNumber && to_double(token.text, number)) {
    value.text = reader.take().text;
    return true;
  }
  return reader.fail(token, "the attribute's value, a string or a number");
}

/// A whole number if it is one that 64 bits hold, else a double.
DbcAttributeValue numeric_value(std::string_view text) noexcept {
  if (text.starts_with('+')) text.remove_prefix(1);
  std::int64_t integer = 0;
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, integer);
  if (error == std::errc{} && at == end) return integer;
  double number = 0.0;
  static_cast<void>(to_double(text, number));
  if (number == std::trunc(number) && std::abs(number) < 0x1p63) {
    return static_cast<std::int64_t>(number);
  }
  return number;
}

std::optional<std::size_t> find_text(const DbcAttributeDefinition& definition,
                                     std::string_view text) noexcept {
  const std::vector<std::string>& values = definition.values;
  if (definition.by_text.empty()) {
    const auto found = std::find(values.begin(), values.end(), text);
    if (found == values.end()) return std::nullopt;
    return static_cast<std::size_t>(found - values.begin());
  }
  const auto found = std::lower_bound(
      definition.by_text.begin(), definition.by_text.end(), text,
      [&](std::uint32_t n, std::string_view wanted) { return values[n] < wanted; });
  if (found == definition.by_text.end() || values[*found] != text) return std::nullopt;
  return *found;
}

/// The texts of an enumeration for a message to people.
std::string listed(const std::vector<std::string>& values) {
  constexpr std::size_t kShown = 8;
  std::string list;
  for (std::size_t n = 0; n < values.size() && n < kShown; ++n) {
    list += fmt::format("{}\"{}\"", n == 0 ? "" : ", ", shown(values[n]));
  }
  return values.size() > kShown ? list + ", ..." : list;
}

DbcAttributeValue enumeration_value(DbcParse& parse, std::string_view name,
                                    const DbcAttributeDefinition& definition,
                                    WrittenValue&& written) {
  const auto warn_of_value = [&] {
    if (!parse.warnings.is_kept(DbcSeverity::kWarning)) {
      parse.warnings.warn(written.position, "");
      return;
    }
    parse.warnings.warn(
        written.position, "found {}{}{} for attribute {}, expected an index below {} or one of {}",
        written.is_text ? "\"" : "", shown(written.text), written.is_text ? "\"" : "", shown(name),
        definition.values.size(), listed(definition.values));
  };
  if (written.is_text) {
    if (!find_text(definition, written.text)) warn_of_value();
    return std::move(written.text);
  }
  DbcAttributeValue value = numeric_value(written.text);
  const auto* const index = std::get_if<std::int64_t>(&value);
  if (index == nullptr || *index < 0 ||
      static_cast<std::uint64_t>(*index) >= definition.values.size()) {
    warn_of_value();
    return value;
  }
  const std::string& text = definition.values[static_cast<std::size_t>(*index)];
  if (text.size() > parse.copies_left) {
    parse.warnings.warn(written.position, "attribute {} is used too often; it keeps its index",
                        shown(name));
    return value;
  }
  parse.copies_left -= text.size();
  return text;
}

DbcAttributeValue to_value(DbcParse& parse, std::string_view name,
                           const DbcAttributeDefinition* definition, WrittenValue&& written) {
  if (definition == nullptr) {
    parse.warnings.warn(written.position, "attribute {} is not defined before it is used",
                        shown(name));
    if (written.is_text) return std::move(written.text);
    return numeric_value(written.text);
  }
  if (definition->kind == DbcAttributeKind::kEnumeration) {
    return enumeration_value(parse, name, *definition, std::move(written));
  }
  const bool wants_text = definition->kind == DbcAttributeKind::kString;
  if (written.is_text != wants_text) {
    parse.warnings.warn(written.position, "attribute {} is a {}, but has a {}", shown(name),
                        wants_text ? "text" : "number", wants_text ? "number" : "text");
  }
  // Numbers in quotes: some tools write all values so.
  double number = 0.0;
  const bool is_text = written.is_text && (wants_text || !to_double(written.text, number));
  if (is_text || wants_text) return std::move(written.text);
  DbcAttributeValue value = numeric_value(written.text);
  if (definition->kind == DbcAttributeKind::kFloat) {
    static_cast<void>(to_double(written.text, number));
    return number;
  }
  if (std::holds_alternative<double>(value)) {
    parse.warnings.warn(written.position, "found {} for attribute {}, expected a whole number",
                        shown(written.text), shown(name));
  }
  return value;
}

const DbcAttributeDefinition* find_definition(const DbcParse& parse, std::string_view name,
                                              DbcObject object) {
  const auto found = parse.definitions.find(DbcAttributeKeyView{name, object});
  return found == parse.definitions.end() ? nullptr : &found->second;
}

}  // namespace

bool parse_dbc_attribute_definition(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  const DbcObject object = accept_object(reader);
  const DbcPosition position = reader.peek().position;
  DbcAttributeKey key{{}, object};
  DbcAttributeDefinition definition;
  if (!reader.expect_string(key.name, kExpectedName) || !parse_kind(reader, definition)) {
    return false;
  }
  if (definition.values.size() > kShortEnumeration) {
    definition.by_text.resize(definition.values.size());
    std::iota(definition.by_text.begin(), definition.by_text.end(), 0u);
    std::sort(definition.by_text.begin(), definition.by_text.end(),
              [&](std::uint32_t a, std::uint32_t b) {
                const int order = definition.values[a].compare(definition.values[b]);
                return order != 0 ? order < 0 : a < b;
              });
  }
  const auto [entry, is_new] = parse.definitions.try_emplace(std::move(key));
  if (!is_new) {
    parse.warnings.warn(position, "attribute {} is defined twice; this one counts from here on",
                        shown(entry->first.name));
  }
  entry->second = std::move(definition);
  return reader.expect_end();
}

bool parse_dbc_attribute_default(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  std::string name;
  WrittenValue written;
  if (!reader.expect_string(name, kExpectedName) || !expect_value(reader, written)) return false;
  const DbcAttributeDefinition* definition = nullptr;
  for (const DbcObject object : {DbcObject::kNetwork, DbcObject::kNode, DbcObject::kMessage,
                                 DbcObject::kSignal, DbcObject::kEnvironmentVariable}) {
    if (definition == nullptr) definition = find_definition(parse, name, object);
  }
  DbcAttributeValue value = to_value(parse, name, definition, std::move(written));
  parse.database.default_attributes.append(std::move(name), std::move(value));
  return reader.expect_end();
}

bool parse_dbc_attribute(DbcParse& parse) {
  DbcStatementReader& reader = parse.reader;
  std::string name;
  if (!reader.expect_string(name, kExpectedName)) return false;
  const DbcObject object = accept_object(reader);
  DbcAttributes* attributes = nullptr;
  if (object == DbcObject::kNode) {
    std::string_view node;
    bool is_known = false;
    if (!expect_node(parse, node, is_known)) return false;
    if (is_known) attributes = &parse.database.node_attributes[to_utf8(node)];
  } else if (object == DbcObject::kMessage) {
    std::uint32_t message = kNoDbcItem;
    if (!expect_message(parse, message)) return false;
    if (message != kNoDbcItem) attributes = &parse.messages[message].attributes;
  } else if (object == DbcObject::kSignal) {
    std::uint32_t message = kNoDbcItem;
    std::uint32_t signal = kNoDbcItem;
    if (!expect_signal(parse, message, signal)) return false;
    if (signal != kNoDbcItem) attributes = &parse.messages[message].signals[signal].attributes;
  } else if (object == DbcObject::kEnvironmentVariable) {
    std::uint32_t variable = kNoDbcItem;
    if (!expect_environment_variable(parse, variable)) return false;
    if (variable != kNoDbcItem) attributes = &parse.environment_variables[variable].attributes;
  } else {
    attributes = &parse.database.attributes;
  }
  WrittenValue written;
  if (!expect_value(reader, written)) return false;
  if (attributes != nullptr) {
    const DbcAttributeDefinition* const definition = find_definition(parse, name, object);
    DbcAttributeValue value = to_value(parse, name, definition, std::move(written));
    attributes->append(std::move(name), std::move(value));
  }
  return reader.expect_end();
}

}  // namespace faultline
