#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "drivers/dbc/dbc_database.h"

namespace faultline {

enum class DbcTokenKind : std::uint8_t {
  kIdentifier,   ///< letters, digits, `_`, also beginning with a digit; also keywords
  kNumber,       ///< with its sign, if that stands right before it; also `-1.#IND`
  kString,       ///< only its opening quote is known: take_string finds the end
  kPunctuation,  ///< one byte of anything else
  kEnd,
};

struct DbcToken {
  DbcTokenKind kind = DbcTokenKind::kEnd;
  bool starts_line = false;  ///< nothing but blanks before it on its line
  std::string_view text;     ///< of a string: from its opening quote to the end of the file
  DbcPosition position;
};

/// How the end of a string is told from a quote within it.
enum class DbcQuoting : std::uint8_t {
  kPlain,    ///< the first quote that is neither escaped (`\"`) nor doubled (`""`)
  kComment,  ///< the first unescaped quote before a semicolon or a new statement
};

/// A string as it stands in the file.
struct DbcString {
  std::string_view text;        ///< between the quotes
  bool has_marks = false;       ///< `\` or `""` within, so that text() differs
  bool has_high_bytes = false;  ///< bytes from 0x80 on
  bool is_terminated = true;
  DbcPosition position;  ///< of the opening quote
};

/// What a keyword of the format introduces.
enum class DbcSection : std::uint8_t {
  kSignal,
  kMessage,
  kValueNames,
  kComment,
  kAttribute,
  kAttributeDefinition,
  kAttributeDefault,
  kSignalType,
  kMultiplexing,
  kValueTable,
  kSignalGroup,
  kTransmitters,
  kEnvironmentVariable,
  kNodes,
  kVersion,
  kNewSymbols,
  kBusTiming,
  kUnread,  ///< known, but nothing we keep
  kNone,
};

/// text == word, without the price of a call where they differ at once. @pre word.size() >= 2
[[nodiscard]] inline bool is_same_word(std::string_view text, std::string_view word) noexcept {
  return text.size() == word.size() && text[0] == word[0] && text[1] == word[1] && text == word;
}

[[nodiscard]] DbcSection find_section(std::string_view keyword) noexcept;

/// Cuts a DBC text into tokens, one ahead. Copy it to look further ahead; a copy is cheap. Lines
/// end with LF, CR LF or CR; `//` comments count as blanks. The text must outlive it.
class DbcLexer {
 public:
  explicit DbcLexer(std::string_view text) noexcept;

  /// The text from the token on that `take` will return.
  [[nodiscard]] std::string_view rest() const noexcept {
    return {token_.text.data(), static_cast<std::size_t>(end_ - token_.text.data())};
  }
  /// The token that `take` will return.
  [[nodiscard]] const DbcToken& peek() const noexcept { return token_; }
  /// Returns the next token and moves on (over a string as kPlain); at the end of the text again
  /// and again kEnd.
  DbcToken take() noexcept {
    const DbcToken taken = token_;
    advance();
    return taken;
  }
  /// Moves on like take().
  void advance() noexcept {
    if (token_.kind == DbcTokenKind::kString) {
      static_cast<void>(take_string(DbcQuoting::kPlain));
    } else {
      scan();
    }
  }
  /// The next token as a name, which may also hold bytes that no identifier has: `1st-Gear/%`.
  /// Moves on. @pre peek() is neither kEnd nor kString
  DbcToken take_name() noexcept;
  /// A string without a closing quote ends with its line, or before the line at which a new
  /// statement begins. @pre peek().kind == kString
  DbcString take_string(DbcQuoting quoting) noexcept;

 private:
  void scan() noexcept;
  void skip_blanks() noexcept;
  [[nodiscard]] const char* end_of_number(const char* from) const noexcept;
  [[nodiscard]] bool is_comment_end(const char* quote) const noexcept;
  [[nodiscard]] bool begins_statement(const char* line) const noexcept;
  void move_to(const char* to, bool has_lines) noexcept;

  const char* cursor_ = nullptr;  ///< behind the token (a string: behind its opening quote)
  const char* end_ = nullptr;
  const char* line_begin_ = nullptr;
  int line_ = 1;
  DbcToken token_;
  /// Bytes that scans for a closing quote may still read in vain. Past them every string ends with
  /// its line, so that reading stays linear.
  std::size_t vain_bytes_left_ = 0;
};

/// "number 12", "\";\"", "the end of the file": a token for a message to people.
[[nodiscard]] std::string describe(const DbcToken& token);

/// `text` for a message to people: in UTF-8 and not too long.
[[nodiscard]] std::string shown(std::string_view text);

/// What a string stands for: `\"`, `\\` and `""` unescaped, and in UTF-8 (what is no UTF-8 is taken
/// for Windows-1252, which old tools write).
[[nodiscard]] std::string string_value(const DbcString& string);

/// `text` in UTF-8.
[[nodiscard]] std::string to_utf8(std::string_view text);

}  // namespace faultline
