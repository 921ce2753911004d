#pragma once

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/bank/json_tree.h"

namespace faultline {

/// The text a JSON tree came from, for messages. Views: must outlive the cursors.
struct JsonSource {
  std::string_view text;
  const std::string& name;
};

/// One value of a JSON text with its path ("filters[2].F"), read strictly: what is not as expected
/// is a BankFileError with line and column. Private to diagnosis/bank.
class JsonCursor {
 public:
  JsonCursor(const JsonSource& source, const JsonValue& value, std::string path);

  [[nodiscard]] BankFileError error(const std::string& message) const;
  /// "found ..., expected `what`".
  [[nodiscard]] BankFileError expected(const std::string& what) const;

  /// The object's values in the order of `keys`; all must be there, and nothing else but
  /// `optional_keys`, whose values member() gives.
  [[nodiscard]] std::vector<JsonCursor> members(
      std::initializer_list<std::string_view> keys,
      std::initializer_list<std::string_view> optional_keys = {}) const;
  /// The object's value `key`, if it is there.
  [[nodiscard]] std::optional<JsonCursor> member(std::string_view key) const;
  [[nodiscard]] std::vector<JsonCursor> elements() const;
  [[nodiscard]] std::vector<JsonCursor> elements(std::size_t count) const;

  [[nodiscard]] const std::string& string() const;
  [[nodiscard]] bool boolean() const;
  [[nodiscard]] double number() const;
  [[nodiscard]] double positive() const;
  [[nodiscard]] double not_negative() const;
  [[nodiscard]] std::uint32_t count(std::uint32_t smallest) const;
  /// Strings, none empty, none twice.
  [[nodiscard]] std::vector<std::string> names() const;
  /// Index of the string in `choices`
  [[nodiscard]] std::size_t choice(std::initializer_list<std::string_view> choices) const;
  /// Indices of a list of strings in `names`, each at most once.
  [[nodiscard]] std::vector<std::size_t> indices(const std::vector<std::string>& names) const;
  /// Index of the string in `names`.
  [[nodiscard]] std::size_t index(const std::vector<std::string>& names) const;
  [[nodiscard]] std::vector<double> numbers() const;
  [[nodiscard]] std::vector<double> not_negatives(std::size_t size) const;
  [[nodiscard]] Eigen::VectorXd vector(std::size_t size) const;
  [[nodiscard]] Eigen::MatrixXd matrix(std::size_t rows, std::size_t cols) const;

 private:
  [[nodiscard]] JsonCursor child(std::size_t index, std::string path) const;
  [[nodiscard]] BankFileError error_at(std::size_t offset, const std::string& path,
                                       const std::string& message) const;

  const JsonSource* source_;
  const JsonValue* value_;
  std::string path_;
};

}  // namespace faultline
