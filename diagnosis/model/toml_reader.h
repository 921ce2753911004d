#pragma once

#include <complex>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "diagnosis/model/input_error.h"

namespace faultline {

/// Strict reading of one TOML table: every key must be asked for, every value must have the type,
/// shape and range asked for, numbers must be finite. Every refusal is an InputError with file,
/// line, column, what was found and what was expected.
///
///   TomlTable root = TomlTable::read_file("plant.toml");
///   auto name = root.string("name");
///   ...
///   root.finish();   // refuses keys nobody asked for (with the nearest known key)
///
/// Copies share the document. Reading a key marks it as known.
class TomlTable {
 public:
  /// @throws InputError syntax; @throws std::system_error the file cannot be read.
  [[nodiscard]] static TomlTable read_file(const std::filesystem::path& file);
  /// @throws InputError syntax.
  [[nodiscard]] static TomlTable parse(std::string_view text, const std::string& source);

  [[nodiscard]] bool has(std::string_view key) const;

  // Required values: throw InputError when absent or of another type.
  [[nodiscard]] std::string string(std::string_view key);
  [[nodiscard]] double number(std::string_view key);
  [[nodiscard]] std::int64_t integer(std::string_view key);
  [[nodiscard]] bool boolean(std::string_view key);
  [[nodiscard]] std::vector<std::string> strings(std::string_view key);
  [[nodiscard]] std::vector<double> numbers(std::string_view key);
  /// List of numbers and [real, imaginary] pairs.
  [[nodiscard]] std::vector<std::complex<double>> complex_numbers(std::string_view key);
  /// Row-major list of rows, `rows`×`cols`; -1: any.
  [[nodiscard]] Eigen::MatrixXd matrix(std::string_view key, Eigen::Index rows, Eigen::Index cols);
  /// List of `size` numbers; -1: any.
  [[nodiscard]] Eigen::VectorXd vector(std::string_view key, Eigen::Index size);
  [[nodiscard]] TomlTable table(std::string_view key);

  // Optional values: nullopt / empty when absent, InputError when present and wrong.
  [[nodiscard]] std::optional<std::string> optional_string(std::string_view key);
  [[nodiscard]] std::optional<double> optional_number(std::string_view key);
  [[nodiscard]] std::optional<std::int64_t> optional_integer(std::string_view key);
  [[nodiscard]] std::optional<bool> optional_boolean(std::string_view key);
  [[nodiscard]] std::optional<std::vector<std::string>> optional_strings(std::string_view key);
  [[nodiscard]] std::optional<Eigen::VectorXd> optional_vector(std::string_view key,
                                                               Eigen::Index size);
  [[nodiscard]] std::optional<Eigen::MatrixXd> optional_matrix(std::string_view key,
                                                               Eigen::Index rows,
                                                               Eigen::Index cols);
  [[nodiscard]] std::optional<TomlTable> optional_table(std::string_view key);
  /// [[key]]: its tables, empty when absent.
  [[nodiscard]] std::vector<TomlTable> tables(std::string_view key);

  /// String that must be one of `allowed`.
  [[nodiscard]] std::string choice(std::string_view key,
                                   std::initializer_list<std::string_view> allowed);

  /// True if the value under `key` is a string (for keys that take a word or a list).
  [[nodiscard]] bool is_string(std::string_view key) const;
  /// True if the value under `key` is a table (for keys that take a word or a table).
  [[nodiscard]] bool is_table(std::string_view key) const;
  /// True if the value under `key` is a list (for keys that take a number or a list).
  [[nodiscard]] bool is_list(std::string_view key) const;
  /// List of values of any kind, each as TOML writes it: `0.5`, `"u1"`, `{ target = "u1" }`.
  [[nodiscard]] std::vector<std::string> value_texts(std::string_view key);
  /// List of lists of strings, e.g. a structure given as fault sets.
  [[nodiscard]] std::vector<std::vector<std::string>> string_lists(std::string_view key);

  /// Takes over from the root table of another file what this one, a root table too, does not say:
  /// keys, and those of its tables; an inline table is one value. Lists of tables are joined, those
  /// of `other` first. What is taken over keeps its place, so that errors point to the other file.
  /// @pre neither has handed out a table
  void adopt(const TomlTable& other);
  /// Source of the file in which `key` stands; that of the table where it is absent.
  [[nodiscard]] std::string source_of(std::string_view key) const;

  /// All keys in file order, for tables whose keys are names.
  [[nodiscard]] std::vector<std::string> keys() const;

  /// Refuses unknown keys, here and in every table that was handed out from here.
  void finish() const;

  /// An InputError at `key` (or at the table itself when `key` is empty).
  [[nodiscard]] InputError error(std::string_view key, const std::string& text) const;

  [[nodiscard]] const std::string& source() const;
  /// The text that was parsed, whole.
  [[nodiscard]] const std::string& text() const;

 private:
  struct Document;
  struct Node;
  struct Access;
  TomlTable(std::shared_ptr<Document> document, std::shared_ptr<Node> node);
  std::shared_ptr<Document> document_;
  std::shared_ptr<Node> node_;
};

/// The candidate nearest to `name` in edit distance, if it is near enough to be a slip of the pen;
/// for "did you mean" in messages.
[[nodiscard]] std::optional<std::string> nearest_name(std::string_view name,
                                                      const std::vector<std::string>& candidates);

}  // namespace faultline
