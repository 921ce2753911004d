#include "diagnosis/model/toml_reader.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <iterator>
#include <sstream>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <toml++/toml.h>

namespace faultline {

struct TomlTable::Document {
  std::string source;
  std::string text;
  toml::table root;
};

struct TomlTable::Node {
  const toml::table* table = nullptr;  // owned by the document
  std::string path;                    // "dynamics", empty for the root
  std::vector<std::string> known;      // keys that were asked for
  std::vector<std::shared_ptr<Node>> children;
};

namespace {

SourcePosition position_of(const toml::source_region& region) {
  return {static_cast<int>(region.begin.line), static_cast<int>(region.begin.column)};
}

/// The file that the region names: after TomlTable::adopt not the document's for every value.
std::string file_of(const toml::source_region& region, const std::string& otherwise) {
  return region.path ? *region.path : otherwise;
}

/// A list of tables that stand on their own: [[key]].
toml::array* as_tables(toml::node& value) {
  toml::array* const list = value.as_array();
  return list != nullptr && list->is_array_of_tables() ? list : nullptr;
}

/// See TomlTable::adopt.
void adopt_into(toml::table& own, toml::table& other) {
  for (auto&& [key, value] : other) {
    toml::node* const present = own.get(key.str());
    if (present == nullptr) {
      value.visit([&own, &key = key](auto& moved) { own.insert(key, std::move(moved)); });
    } else if (present->is_table() && value.is_table() && !present->as_table()->is_inline()) {
      adopt_into(*present->as_table(), *value.as_table());
    } else if (toml::array* const list = as_tables(*present); list && as_tables(value) != nullptr) {
      toml::array joined = std::move(*value.as_array());
      for (toml::node& entry : *list) joined.push_back(std::move(*entry.as_table()));
      *list = std::move(joined);
    }
  }
}

std::string describe(const toml::node& value) {
  if (const auto* text = value.as_string()) {
    return fmt::format("string \"{}\"", text->get());
  }
  if (const auto* number = value.as_integer()) {
    return fmt::format("number {}", number->get());
  }
  if (const auto* number = value.as_floating_point()) {
    return fmt::format("number {}", number->get());
  }
  if (const auto* flag = value.as_boolean()) {
    return fmt::format("boolean {}", flag->get());
  }
  if (const auto* list = value.as_array()) {
    return fmt::format("a list of {} values", list->size());
  }
  return value.is_table() ? "a table" : "a date or time";
}

// A key of the table `path` in `document`, or one of its elements: what messages call it.
struct Place {
  const std::string& source;
  std::string field;

  [[nodiscard]] Place row(std::size_t index) const {
    return {source, fmt::format("{}, row {}", field, index + 1)};
  }
  [[nodiscard]] Place entry(std::size_t index) const {
    return {source, fmt::format("{}, entry {}", field, index + 1)};
  }
  [[nodiscard]] InputError mismatch(const toml::node& value, std::string_view found,
                                    std::string_view expected) const {
    return {file_of(value.source(), source), position_of(value.source()),
            fmt::format("{}: found {}, expected {}", field, found, expected)};
  }
  [[nodiscard]] InputError mismatch(const toml::node& value, std::string_view expected) const {
    return mismatch(value, describe(value), expected);
  }
};

double to_number(const toml::node& value, const Place& place) {
  const std::optional<double> number =
      value.is_number() ? value.value<double>() : std::optional<double>();
  if (!number || !std::isfinite(*number)) {
    throw place.mismatch(value, "a finite number");
  }
  return *number;
}

std::string to_string(const toml::node& value, const Place& place) {
  const auto* text = value.as_string();
  if (text == nullptr) {
    throw place.mismatch(value, "a string");
  }
  return text->get();
}

const toml::array& to_list(const toml::node& value, const Place& place, std::string_view of) {
  const toml::array* list = value.as_array();
  if (list == nullptr) {
    throw place.mismatch(value, fmt::format("a list of {}", of));
  }
  return *list;
}

std::vector<double> to_numbers(const toml::node& value, const Place& place, Eigen::Index size) {
  const toml::array& list = to_list(value, place, "numbers");
  if (size >= 0 && std::ssize(list) != size) {
    throw place.mismatch(value, fmt::format("a list of {} numbers", size));
  }
  std::vector<double> numbers;
  numbers.reserve(list.size());
  for (std::size_t i = 0; i < list.size(); ++i) {
    numbers.push_back(to_number(list[i], place.entry(i)));
  }
  return numbers;
}

std::vector<std::string> to_strings(const toml::node& value, const Place& place) {
  const toml::array& list = to_list(value, place, "strings");
  std::vector<std::string> strings;
  strings.reserve(list.size());
  for (std::size_t i = 0; i < list.size(); ++i) {
    strings.push_back(to_string(list[i], place.entry(i)));
  }
  return strings;
}

Eigen::MatrixXd to_matrix(const toml::node& value, const Place& place, Eigen::Index rows,
                          Eigen::Index cols) {
  const toml::array& list = to_list(value, place, "rows");
  if (rows >= 0 && std::ssize(list) != rows) {
    throw place.mismatch(value, fmt::format("{} rows", list.size()), fmt::format("{} rows", rows));
  }
  Eigen::MatrixXd matrix(std::ssize(list), std::max<Eigen::Index>(cols, 0));
  for (std::size_t i = 0; i < list.size(); ++i) {
    const bool is_width_open = cols < 0 && i == 0;
    const std::vector<double> row =
        to_numbers(list[i], place.row(i), is_width_open ? -1 : matrix.cols());
    if (is_width_open) {
      matrix.resize(matrix.rows(), std::ssize(row));
    }
    matrix.row(static_cast<Eigen::Index>(i)) =
        Eigen::Map<const Eigen::RowVectorXd>(row.data(), std::ssize(row));
  }
  return matrix;
}

std::complex<double> to_complex(const toml::node& value, const Place& place) {
  if (value.is_array()) {
    const std::vector<double> parts = to_numbers(value, place, 2);
    return {parts[0], parts[1]};
  }
  if (!value.is_number()) {
    throw place.mismatch(value, "a number or a pair [real, imaginary]");
  }
  return {to_number(value, place), 0.0};
}

std::string read_text(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::string text(std::istreambuf_iterator<char>(stream), {});
  if (!stream.is_open() || stream.bad() || std::filesystem::is_directory(file)) {
    throw std::system_error(errno != 0 ? errno : EIO, std::generic_category(), file.string());
  }
  return text;
}

}  // namespace

// Reading by key: finds the value, marks the key as known, names it in messages.
struct TomlTable::Access {
  const Document& document;
  Node& node;

  [[nodiscard]] Place place(std::string_view key) const {
    const std::string separator = node.path.empty() || key.empty() ? "" : ".";
    return {document.source, node.path + separator + std::string(key)};
  }

  const toml::node* find(std::string_view key) {
    if (std::find(node.known.begin(), node.known.end(), key) == node.known.end()) {
      node.known.emplace_back(key);
    }
    return node.table->get(key);
  }

  const toml::node& require(std::string_view key, std::string_view expected) {
    const toml::node* value = find(key);
    if (value == nullptr) {
      throw InputError(file_of(node.table->source(), document.source),
                       position_of(node.table->source()),
                       fmt::format("{}: found nothing, expected {}", place(key).field, expected));
    }
    return *value;
  }

  std::shared_ptr<Node> open(const toml::node& value, const Place& at) {
    const toml::table* table = value.as_table();
    if (table == nullptr) {
      throw at.mismatch(value, "a table");
    }
    node.children.push_back(std::make_shared<Node>(Node{table, at.field, {}, {}}));
    return node.children.back();
  }

  // Unknown keys here and below, in file order.
  static void refuse_unknown(const Document& document, const Node& node) {
    for (auto&& [key, value] : *node.table) {
      const std::string name(key.str());
      if (std::find(node.known.begin(), node.known.end(), name) != node.known.end()) {
        continue;
      }
      const std::optional<std::string> near = nearest_name(name, node.known);
      const std::string hint = near ? fmt::format("; did you mean \"{}\"?", *near)
                                    : fmt::format("; known here: {}", fmt::join(node.known, ", "));
      const std::string where = node.path.empty() ? "" : node.path + ": ";
      throw InputError(file_of(key.source(), document.source), position_of(key.source()),
                       fmt::format("{}found unknown key \"{}\"{}", where, name, hint));
    }
    for (const std::shared_ptr<Node>& child : node.children) {
      refuse_unknown(document, *child);
    }
  }
};

TomlTable::TomlTable(std::shared_ptr<Document> document, std::shared_ptr<Node> node)
    : document_(std::move(document)), node_(std::move(node)) {}

TomlTable TomlTable::read_file(const std::filesystem::path& file) {
  return parse(read_text(file), file.string());
}

TomlTable TomlTable::parse(std::string_view text, const std::string& source) {
  auto document = std::make_shared<Document>(Document{source, std::string(text), {}});
  try {
    document->root = toml::parse(document->text, source);
  } catch (const toml::parse_error& error) {
    throw InputError(source, position_of(error.source()),
                     fmt::format("not TOML: {}", error.description()));
  }
  auto node = std::make_shared<Node>(Node{&document->root, "", {}, {}});
  return {std::move(document), std::move(node)};
}

bool TomlTable::has(std::string_view key) const { return node_->table->contains(key); }

std::string TomlTable::string(std::string_view key) {
  Access access{*document_, *node_};
  return to_string(access.require(key, "a string"), access.place(key));
}

double TomlTable::number(std::string_view key) {
  Access access{*document_, *node_};
  return to_number(access.require(key, "a finite number"), access.place(key));
}

std::int64_t TomlTable::integer(std::string_view key) {
  Access access{*document_, *node_};
  const toml::node& value = access.require(key, "a whole number");
  if (!value.is_integer()) {
    throw access.place(key).mismatch(value, "a whole number");
  }
  return value.as_integer()->get();
}

bool TomlTable::boolean(std::string_view key) {
  Access access{*document_, *node_};
  const toml::node& value = access.require(key, "true or false");
  if (!value.is_boolean()) {
    throw access.place(key).mismatch(value, "true or false");
  }
  return value.as_boolean()->get();
}

std::vector<std::string> TomlTable::strings(std::string_view key) {
  Access access{*document_, *node_};
  return to_strings(access.require(key, "a list of strings"), access.place(key));
}

std::vector<double> TomlTable::numbers(std::string_view key) {
  Access access{*document_, *node_};
  return to_numbers(access.require(key, "a list of numbers"), access.place(key), -1);
}

std::vector<std::complex<double>> TomlTable::complex_numbers(std::string_view key) {
  Access access{*document_, *node_};
  constexpr std::string_view kOf = "numbers or pairs [real, imaginary]";
  const Place place = access.place(key);
  const toml::array& list =
      to_list(access.require(key, fmt::format("a list of {}", kOf)), place, kOf);
  std::vector<std::complex<double>> values;
  for (std::size_t i = 0; i < list.size(); ++i) {
    values.push_back(to_complex(list[i], place.entry(i)));
  }
  return values;
}

Eigen::MatrixXd TomlTable::matrix(std::string_view key, Eigen::Index rows, Eigen::Index cols) {
  Access access{*document_, *node_};
  return to_matrix(access.require(key, "a matrix, as a list of rows"), access.place(key), rows,
                   cols);
}

Eigen::VectorXd TomlTable::vector(std::string_view key, Eigen::Index size) {
  Access access{*document_, *node_};
  const std::vector<double> values =
      to_numbers(access.require(key, "a list of numbers"), access.place(key), size);
  return Eigen::Map<const Eigen::VectorXd>(values.data(), std::ssize(values));
}

TomlTable TomlTable::table(std::string_view key) {
  Access access{*document_, *node_};
  return {document_, access.open(access.require(key, "a table"), access.place(key))};
}

std::optional<std::string> TomlTable::optional_string(std::string_view key) {
  return Access{*document_, *node_}.find(key) ? std::optional(string(key)) : std::nullopt;
}

std::optional<double> TomlTable::optional_number(std::string_view key) {
  return Access{*document_, *node_}.find(key) ? std::optional(number(key)) : std::nullopt;
}

std::optional<std::int64_t> TomlTable::optional_integer(std::string_view key) {
  return Access{*document_, *node_}.find(key) ? std::optional(integer(key)) : std::nullopt;
}

std::optional<bool> TomlTable::optional_boolean(std::string_view key) {
  return Access{*document_, *node_}.find(key) ? std::optional(boolean(key)) : std::nullopt;
}

std::optional<std::vector<std::string>> TomlTable::optional_strings(std::string_view key) {
  return Access{*document_, *node_}.find(key) ? std::optional(strings(key)) : std::nullopt;
}

std::optional<Eigen::VectorXd> TomlTable::optional_vector(std::string_view key, Eigen::Index size) {
  return Access{*document_, *node_}.find(key) ? std::optional(vector(key, size)) : std::nullopt;
}

std::optional<Eigen::MatrixXd> TomlTable::optional_matrix(std::string_view key, Eigen::Index rows,
                                                          Eigen::Index cols) {
  return Access{*document_, *node_}.find(key) ? std::optional(matrix(key, rows, cols))
                                              : std::nullopt;
}

std::optional<TomlTable> TomlTable::optional_table(std::string_view key) {
  return Access{*document_, *node_}.find(key) ? std::optional(table(key)) : std::nullopt;
}

std::vector<TomlTable> TomlTable::tables(std::string_view key) {
  Access access{*document_, *node_};
  std::vector<TomlTable> tables;
  const toml::node* value = access.find(key);
  if (value == nullptr) {
    return tables;
  }
  const Place place = access.place(key);
  const toml::array& list = to_list(*value, place, fmt::format("tables [[{}]]", place.field));
  for (std::size_t i = 0; i < list.size(); ++i) {
    tables.push_back({document_, access.open(list[i], place.entry(i))});
  }
  return tables;
}

std::string TomlTable::choice(std::string_view key,
                              std::initializer_list<std::string_view> allowed) {
  std::string word = string(key);
  if (std::find(allowed.begin(), allowed.end(), word) == allowed.end()) {
    throw error(key, fmt::format("found \"{}\", expected one of \"{}\"", word,
                                 fmt::join(allowed, "\", \"")));
  }
  return word;
}

bool TomlTable::is_string(std::string_view key) const {
  const toml::node* value = node_->table->get(key);
  return value != nullptr && value->is_string();
}

bool TomlTable::is_table(std::string_view key) const {
  const toml::node* value = node_->table->get(key);
  return value != nullptr && value->is_table();
}

bool TomlTable::is_list(std::string_view key) const {
  const toml::node* value = node_->table->get(key);
  return value != nullptr && value->is_array();
}

std::vector<std::string> TomlTable::value_texts(std::string_view key) {
  Access access{*document_, *node_};
  const toml::array& list =
      to_list(access.require(key, "a list of values"), access.place(key), "values");
  std::vector<std::string> texts;
  for (const toml::node& value : list) {
    if (const auto* number = value.as_floating_point(); number && std::isfinite(number->get())) {
      std::string shortest = fmt::format("{}", number->get());
      if (shortest.find_first_of(".e") == std::string::npos) shortest += ".0";
      texts.push_back(std::move(shortest));
      continue;
    }
    constexpr std::string_view kName = "v = ";
    toml::table alone;
    alone.insert("v", value);
    if (toml::table* const table = alone.get("v")->as_table()) table->is_inline(true);
    std::ostringstream text;
    text << alone;
    texts.push_back(text.str().substr(kName.size()));
  }
  return texts;
}

std::vector<std::vector<std::string>> TomlTable::string_lists(std::string_view key) {
  Access access{*document_, *node_};
  const Place place = access.place(key);
  const toml::array& list =
      to_list(access.require(key, "a list of lists of strings"), place, "lists of strings");
  std::vector<std::vector<std::string>> lists;
  for (std::size_t i = 0; i < list.size(); ++i) {
    lists.push_back(to_strings(list[i], place.entry(i)));
  }
  return lists;
}

void TomlTable::adopt(const TomlTable& other) {
  adopt_into(document_->root, other.document_->root);
}

std::string TomlTable::source_of(std::string_view key) const {
  const toml::node* const value = node_->table->get(key);
  return file_of((value != nullptr ? *value : *node_->table).source(), document_->source);
}

std::vector<std::string> TomlTable::keys() const {
  std::vector<std::pair<std::pair<int, int>, std::string>> positioned;
  for (auto&& [key, value] : *node_->table) {
    const SourcePosition position = position_of(key.source());
    positioned.push_back({{position.line, position.column}, std::string(key.str())});
  }
  std::sort(positioned.begin(), positioned.end());
  std::vector<std::string> keys;
  for (auto& [position, key] : positioned) {
    keys.push_back(std::move(key));
  }
  return keys;
}

void TomlTable::finish() const { Access::refuse_unknown(*document_, *node_); }

InputError TomlTable::error(std::string_view key, const std::string& text) const {
  const toml::node* value = key.empty() ? nullptr : node_->table->get(key);
  const toml::node& at = value != nullptr ? *value : *node_->table;
  const std::string field = Access{*document_, *node_}.place(key).field;
  return {file_of(at.source(), document_->source), position_of(at.source()),
          field.empty() ? text : field + ": " + text};
}

const std::string& TomlTable::source() const { return document_->source; }

const std::string& TomlTable::text() const { return document_->text; }

std::optional<std::string> nearest_name(std::string_view name,
                                        const std::vector<std::string>& candidates) {
  // A slip of the pen changes at most a third of a word's letters, and at least one is allowed.
  std::size_t best = std::max<std::size_t>(1, name.size() / 3) + 1;
  std::optional<std::string> nearest;
  for (const std::string& candidate : candidates) {
    // Levenshtein distance, row by row.
    std::vector<std::size_t> row(candidate.size() + 1);
    for (std::size_t j = 0; j <= candidate.size(); ++j) {
      row[j] = j;
    }
    for (std::size_t i = 0; i < name.size(); ++i) {
      std::size_t diagonal = row[0];
      row[0] = i + 1;
      for (std::size_t j = 0; j < candidate.size(); ++j) {
        const std::size_t replaced = diagonal + (name[i] == candidate[j] ? 0 : 1);
        diagonal = row[j + 1];
        row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, replaced});
      }
    }
    if (row.back() < best) {
      best = row.back();
      nearest = candidate;
    }
  }
  return nearest;
}

}  // namespace faultline
