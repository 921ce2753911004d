#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace faultline {

/// A JSON value that remembers where in the text it began. Private to diagnosis/bank.
struct JsonValue {
  enum class Kind { kNull, kBoolean, kInteger, kNumber, kString, kArray, kObject };
  Kind kind = Kind::kNull;
  std::size_t offset = 0;         ///< of its first byte in the text
  double number = 0.0;            ///< kInteger, kNumber
  std::string text;               ///< kString; for messages also kBoolean and numbers
  std::vector<std::string> keys;  ///< kObject: one per child, no key twice
  std::vector<std::size_t> key_offsets;
  std::vector<JsonValue> children;  ///< kArray, kObject
};

/// Parses `text` whole. @throws BankFileError not JSON, a key twice, or nested too deep; `source`
/// names the text in messages.
[[nodiscard]] JsonValue parse_json(std::string_view text, const std::string& source);

/// Line and column, from 1, of a byte of `text`.
struct TextPosition {
  int line = 1;
  int column = 1;
};
[[nodiscard]] TextPosition text_position(std::string_view text, std::size_t offset);

/// `text` as a JSON string, with quotes.
[[nodiscard]] std::string json_string(const std::string& text);
/// The shortest decimal that reads back as `number` to the bit. Precondition: finite.
[[nodiscard]] std::string json_number(double number);

}  // namespace faultline
