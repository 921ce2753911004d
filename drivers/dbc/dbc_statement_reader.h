#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "drivers/dbc/dbc_database.h"
#include "drivers/dbc/dbc_lexer.h"

namespace faultline {

/// Collects warnings, at most DbcDatabase::kMaxWarnings of each severity; the rest is only counted,
/// and not even formatted.
class DbcWarnings {
 public:
  template <class... Args>
  void add(DbcSeverity severity, DbcPosition position, fmt::format_string<Args...> format,
           Args&&... args) {
    std::size_t& count = counts_[static_cast<std::size_t>(severity)];
    if (count++ >= DbcDatabase::kMaxWarnings) return;
    kept_.push_back({position, fmt::format(format, std::forward<Args>(args)...), severity});
  }
  template <class... Args>
  void warn(DbcPosition position, fmt::format_string<Args...> format, Args&&... args) {
    add(DbcSeverity::kWarning, position, format, std::forward<Args>(args)...);
  }
  /// True if `add` would still keep one of this severity: to save what its text costs.
  [[nodiscard]] bool is_kept(DbcSeverity severity) const noexcept {
    return counts_[static_cast<std::size_t>(severity)] < DbcDatabase::kMaxWarnings;
  }
  [[nodiscard]] std::size_t count(DbcSeverity severity) const noexcept {
    return counts_[static_cast<std::size_t>(severity)];
  }
  /// Hands all over, in the order of the file.
  void move_to(DbcDatabase& database);

 private:
  std::array<std::size_t, 3> counts_{};
  std::vector<DbcWarning> kept_;
};

/// Reads the parts of statements. What is not as expected is recorded as an error, and the function
/// returns false; the caller gives its statement up and calls `skip_statement`. Of one statement
/// only the first error is recorded.
class DbcStatementReader {
 public:
  DbcStatementReader(std::string_view text, DbcWarnings& warnings)
      : lexer_(text), warnings_(&warnings) {}

  [[nodiscard]] const DbcToken& peek() const noexcept { return lexer_.peek(); }
  DbcToken take() noexcept { return lexer_.take(); }
  /// What a fault costs, for the text of its error: "the signal is skipped".
  void begin_statement(std::string_view loss) noexcept {
    loss_ = loss;
    has_failed_ = false;
  }

  [[nodiscard]] bool is_at_end() const noexcept { return peek().kind == DbcTokenKind::kEnd; }
  [[nodiscard]] bool is_at(char punctuation) const noexcept {
    return peek().kind == DbcTokenKind::kPunctuation && peek().text.front() == punctuation;
  }
  /// The next token begins its line and a statement, or the text is at its end.
  [[nodiscard]] bool is_at_statement() const noexcept {
    return peek().starts_line && begins_statement();
  }
  /// A name that belongs to the present statement comes next.
  [[nodiscard]] bool is_at_name() const noexcept;

  bool accept(char punctuation) noexcept {
    const bool is_there = is_at(punctuation);
    if (is_there) lexer_.advance();
    return is_there;
  }
  bool accept_word(std::string_view word) noexcept {
    const bool is_there =
        peek().kind == DbcTokenKind::kIdentifier && is_same_word(peek().text, word);
    if (is_there) lexer_.advance();
    return is_there;
  }

  bool expect(char punctuation) {
    return accept(punctuation) || fail(peek(), "\"{}\"", punctuation);
  }
  /// A name; `text` is valid as long as the file's text.
  bool expect_name(std::string_view& text, std::string_view expected);
  bool expect_string(std::string& text, std::string_view expected,
                     DbcQuoting quoting = DbcQuoting::kPlain);
  /// Any number. One beyond a double's range, or NaN, is understood, with a warning.
  bool expect_number(double& number, std::string_view expected);
  /// A whole number in T, also when written "8.0" or "1e+09".
  template <class T>
  bool expect_integer(T& integer, std::string_view expected) {
    static_assert(std::is_integral_v<T>);
    std::uint64_t magnitude = 0;
    bool is_negative = false;
    const auto most = static_cast<std::uint64_t>(std::numeric_limits<T>::max());
    const bool is_whole = read_whole(peek(), magnitude, is_negative);
    if (!is_whole || magnitude > most + (is_negative ? 1 : 0) ||
        (is_negative && magnitude != 0 && std::is_unsigned_v<T>)) {
      return fail(peek(), "{}, a whole number up to {}", expected, most);
    }
    lexer_.advance();
    integer = static_cast<T>(is_negative ? std::uint64_t{0} - magnitude : magnitude);
    return true;
  }
  /// A value of a VAL_ or VAL_TABLE_: any 64 bits, signed or not.
  bool expect_raw_value(std::int64_t& value, std::string_view expected);
  /// "3-5" or "3".
  bool expect_range(DbcMultiplexRange& range);
  /// The semicolon. Its absence before a new statement is only warned of.
  bool expect_end();

  /// Records that `found` is not what was expected. @return false
  template <class... Args>
  bool fail(const DbcToken& found, fmt::format_string<Args...> expected, Args&&... args) {
    if (std::exchange(has_failed_, true)) return false;
    if (!warnings_->is_kept(DbcSeverity::kError)) {
      warnings_->add(DbcSeverity::kError, found.position, "");
      return false;
    }
    warnings_->add(DbcSeverity::kError, found.position, "found {}, expected {}; {}",
                   describe(found), fmt::format(expected, std::forward<Args>(args)...), loss_);
    return false;
  }

  /// Moves behind the next semicolon, or before the next statement.
  void skip_statement() noexcept;
  /// Like skip_statement; also stops before a keyword SG_ or BO_ within the line.
  void skip_signal() noexcept;

  /// Another reader of the same text, to look ahead.
  [[nodiscard]] const DbcLexer& lexer() const noexcept { return lexer_; }
  [[nodiscard]] DbcWarnings& warnings() noexcept { return *warnings_; }

 private:
  [[nodiscard]] bool begins_statement() const noexcept;
  bool expect_odd_number(double& number, std::string_view expected);
  static bool read_whole(const DbcToken& token, std::uint64_t& magnitude,
                         bool& is_negative) noexcept;

  DbcLexer lexer_;
  DbcWarnings* warnings_;
  std::string_view loss_;
  bool has_failed_ = false;
  bool has_cut_string_ = false;  ///< of this statement: its semicolon may be in the string
};

/// The number of a token as the format writes it; NaN and infinities for what no double holds.
/// @return false: it is no number.
[[nodiscard]] bool to_double(std::string_view text, double& number) noexcept;

}  // namespace faultline
