#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

enum class DbcTokenKind {
  kIdentifier,   ///< letters, digits, `_`; also keywords
  kNumber,       ///< with its sign, if that stands right before it
  kString,       ///< `text` is what stands between the quotes, as written
  kPunctuation,  ///< one byte of anything else
  kEnd,
};

struct DbcToken {
  DbcTokenKind kind = DbcTokenKind::kEnd;
  std::string_view text;
  DbcPosition position;
};

/// Cuts a DBC text into tokens, one ahead. Copy it to look further ahead; a copy is cheap.
/// The text and the source name must outlive it.
class DbcLexer {
 public:
  /// @throws DbcError as `take`.
  DbcLexer(std::string_view text, const std::string& source);

  /// The token that `take` will return.
  [[nodiscard]] const DbcToken& peek() const noexcept { return token_; }
  /// Line on which the last token taken ended; 0 before the first.
  [[nodiscard]] int previous_line() const noexcept { return previous_line_; }
  /// Returns the next token and moves on; at the end of the text again and again kEnd.
  /// @throws DbcError a string has no closing quote.
  DbcToken take();

 private:
  void skip_blanks() noexcept;
  void advance(std::size_t bytes) noexcept;
  [[nodiscard]] DbcToken scan();
  [[nodiscard]] DbcToken scan_string();
  [[nodiscard]] std::size_t number_length() const noexcept;
  [[nodiscard]] char at(std::size_t offset) const noexcept;

  std::string_view rest_;
  const std::string* source_;
  DbcPosition position_;
  DbcToken token_;
  int previous_line_ = 0;
};

/// "number 12", "\";\"", "the end of the file": a token for a message to people.
[[nodiscard]] std::string describe(const DbcToken& token);

/// The text a string token stands for: `\"` and `\\` unescaped, and in UTF-8 (what is no UTF-8 is
/// taken for Latin-1, which old tools write).
[[nodiscard]] std::string string_value(const DbcToken& token);

}  // namespace faultline
