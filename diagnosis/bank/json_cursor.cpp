#include "diagnosis/bank/json_cursor.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_set>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

std::string describe(const JsonValue& value) {
  using Kind = JsonValue::Kind;
  switch (value.kind) {
    case Kind::kString:
      return fmt::format("string \"{}\"", value.text);
    case Kind::kArray:
      return fmt::format("a list of {} values", value.children.size());
    case Kind::kObject:
      return "an object";
    case Kind::kInteger:
    case Kind::kNumber:
      return "number " + value.text;
    case Kind::kNull:
    case Kind::kBoolean:
      break;
  }
  return value.text;
}

}  // namespace

JsonCursor::JsonCursor(const JsonSource& source, const JsonValue& value, std::string path)
    : source_(&source), value_(&value), path_(std::move(path)) {}

BankFileError JsonCursor::error(const std::string& message) const {
  return error_at(value_->offset, path_, message);
}

BankFileError JsonCursor::expected(const std::string& what) const {
  return error(fmt::format("found {}, expected {}", describe(*value_), what));
}

std::vector<JsonCursor> JsonCursor::members(
    std::initializer_list<std::string_view> keys,
    std::initializer_list<std::string_view> optional_keys) const {
  if (value_->kind != JsonValue::Kind::kObject) {
    throw expected("an object");
  }
  std::vector<std::string_view> known(keys);
  known.insert(known.end(), optional_keys.begin(), optional_keys.end());
  for (std::size_t i = 0; i < value_->keys.size(); ++i) {
    if (std::find(known.begin(), known.end(), value_->keys[i]) == known.end()) {
      throw error_at(value_->key_offsets[i], path_,
                     fmt::format("found unknown key \"{}\", expected one of {}", value_->keys[i],
                                 fmt::join(known, ", ")));
    }
  }
  std::vector<JsonCursor> found;
  for (const std::string_view key : keys) {
    const std::optional<JsonCursor> value = member(key);
    if (!value) {
      throw error(fmt::format("found no \"{}\", expected it", key));
    }
    found.push_back(*value);
  }
  return found;
}

std::optional<JsonCursor> JsonCursor::member(std::string_view key) const {
  if (value_->kind != JsonValue::Kind::kObject) {
    throw expected("an object");
  }
  const auto at = std::find(value_->keys.begin(), value_->keys.end(), key);
  if (at == value_->keys.end()) {
    return std::nullopt;
  }
  const auto index = static_cast<std::size_t>(at - value_->keys.begin());
  return child(index, path_.empty() ? *at : path_ + "." + *at);
}

std::vector<JsonCursor> JsonCursor::elements() const {
  if (value_->kind != JsonValue::Kind::kArray) {
    throw expected("a list");
  }
  std::vector<JsonCursor> found;
  for (std::size_t i = 0; i < value_->children.size(); ++i) {
    found.push_back(child(i, fmt::format("{}[{}]", path_, i)));
  }
  return found;
}

std::vector<JsonCursor> JsonCursor::elements(std::size_t count) const {
  if (value_->kind == JsonValue::Kind::kArray && value_->children.size() != count) {
    throw expected(fmt::format("a list of {} values", count));
  }
  return elements();
}

const std::string& JsonCursor::string() const {
  if (value_->kind != JsonValue::Kind::kString) {
    throw expected("a string");
  }
  return value_->text;
}

bool JsonCursor::boolean() const {
  if (value_->kind != JsonValue::Kind::kBoolean) {
    throw expected("true or false");
  }
  return value_->text == "true";
}

double JsonCursor::number() const {
  const bool is_number =
      value_->kind == JsonValue::Kind::kNumber || value_->kind == JsonValue::Kind::kInteger;
  if (!is_number || !std::isfinite(value_->number)) {
    throw expected("a finite number");
  }
  return value_->number;
}

double JsonCursor::positive() const {
  if (const double value = number(); value > 0.0) {
    return value;
  }
  throw expected("a positive number");
}

double JsonCursor::not_negative() const {
  if (const double value = number(); value >= 0.0) {
    return value;
  }
  throw expected("a number that is not negative");
}

std::uint32_t JsonCursor::count(std::uint32_t smallest) const {
  constexpr double kLargest = std::numeric_limits<std::uint32_t>::max();
  if (value_->kind != JsonValue::Kind::kInteger || value_->number < smallest ||
      value_->number > kLargest) {
    throw expected(fmt::format("a whole number from {} to {}", smallest, kLargest));
  }
  return static_cast<std::uint32_t>(value_->number);
}

std::vector<std::string> JsonCursor::names() const {
  std::vector<std::string> names;
  std::unordered_set<std::string> seen;
  for (const JsonCursor& element : elements()) {
    const std::string& name = element.string();
    if (name.empty() || !seen.insert(name).second) {
      throw element.expected("a name that was not there before");
    }
    names.push_back(name);
  }
  return names;
}

std::size_t JsonCursor::choice(std::initializer_list<std::string_view> choices) const {
  const auto* const found = std::find(choices.begin(), choices.end(), string());
  if (found == choices.end()) {
    std::vector<std::string> quoted;
    for (const std::string_view word : choices) {
      quoted.push_back(fmt::format("\"{}\"", word));
    }
    const std::string last = quoted.back();
    quoted.pop_back();
    throw expected(fmt::format("{} or {}", fmt::join(quoted, ", "), last));
  }
  return static_cast<std::size_t>(found - choices.begin());
}

std::vector<std::size_t> JsonCursor::indices(const std::vector<std::string>& names) const {
  std::vector<std::size_t> indices;
  for (const JsonCursor& element : elements()) {
    const auto found = std::find(names.begin(), names.end(), element.string());
    const auto i = static_cast<std::size_t>(found - names.begin());
    if (found == names.end() || std::find(indices.begin(), indices.end(), i) != indices.end()) {
      throw element.expected("the name of a fault, each once");
    }
    indices.push_back(i);
  }
  return indices;
}

std::size_t JsonCursor::index(const std::vector<std::string>& names) const {
  const auto found = std::find(names.begin(), names.end(), string());
  if (found == names.end()) {
    throw expected("the name of a fault");
  }
  return static_cast<std::size_t>(found - names.begin());
}

std::vector<double> JsonCursor::numbers() const {
  std::vector<double> values;
  for (const JsonCursor& element : elements()) {
    values.push_back(element.number());
  }
  return values;
}

std::vector<double> JsonCursor::not_negatives(std::size_t size) const {
  std::vector<double> values;
  for (const JsonCursor& element : elements(size)) {
    values.push_back(element.not_negative());
  }
  return values;
}

Eigen::VectorXd JsonCursor::vector(std::size_t size) const {
  Eigen::VectorXd vector(static_cast<Index>(size));
  Index i = 0;
  for (const JsonCursor& element : elements(size)) {
    vector[i++] = element.number();
  }
  return vector;
}

MatrixXd JsonCursor::matrix(std::size_t rows, std::size_t cols) const {
  MatrixXd matrix(static_cast<Index>(rows), static_cast<Index>(cols));
  Index i = 0;
  for (const JsonCursor& row : elements(rows)) {
    matrix.row(i++) = row.vector(cols);
  }
  return matrix;
}

JsonCursor JsonCursor::child(std::size_t index, std::string path) const {
  return {*source_, value_->children[index], std::move(path)};
}

BankFileError JsonCursor::error_at(std::size_t offset, const std::string& path,
                                   const std::string& message) const {
  const TextPosition at = text_position(source_->text, offset);
  return {source_->name, at.line, at.column, path.empty() ? message : path + ": " + message};
}

}  // namespace faultline
