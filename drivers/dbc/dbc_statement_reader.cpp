#include "drivers/dbc/dbc_statement_reader.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>

namespace faultline {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

bool is_digit(char c) noexcept { return c >= '0' && c <= '9'; }

/// A section keyword is in capitals and ends with an underscore.
bool looks_like_section(std::string_view word) noexcept {
  return word.size() > 2 && word.back() == '_' && std::all_of(word.begin(), word.end(), [](char c) {
           return (c >= 'A' && c <= 'Z') || is_digit(c) || c == '_';
         });
}

/// Compares with a word in small letters.
bool is_word_in_any_case(std::string_view text, std::string_view word) noexcept {
  return std::equal(text.begin(), text.end(), word.begin(), word.end(),
                    [](char a, char b) { return (a >= 'A' && a <= 'Z' ? a - 'A' + 'a' : a) == b; });
}

/// What from_chars leaves open: is a number it calls out of range too large, or too small?
bool is_too_large(std::string_view digits) noexcept {
  const std::size_t exponent = digits.find_first_of("eE");
  if (exponent != std::string_view::npos) {
    return exponent + 1 >= digits.size() || digits[exponent + 1] != '-';
  }
  const std::string_view whole = digits.substr(0, digits.find('.'));
  return whole.find_first_not_of('0') != std::string_view::npos;
}

}  // namespace

void DbcWarnings::move_to(DbcDatabase& database) {
  std::stable_sort(kept_.begin(), kept_.end(), [](const DbcWarning& a, const DbcWarning& b) {
    return a.position.line != b.position.line ? a.position.line < b.position.line
                                              : a.position.column < b.position.column;
  });
  database.further_warning_count = counts_[0] + counts_[1] + counts_[2] - kept_.size();
  database.warnings = std::move(kept_);
}

bool to_double(std::string_view text, double& number) noexcept {
  bool is_negative = false;
  if (!text.empty() && (text.front() == '+' || text.front() == '-')) {
    is_negative = text.front() == '-';
    text.remove_prefix(1);
  }
  constexpr std::size_t kExactDigits = 15;
  if (text.size() <= kExactDigits && std::all_of(text.begin(), text.end(), is_digit)) {
    std::uint64_t whole = 0;
    for (const char c : text) whole = 10 * whole + static_cast<std::uint64_t>(c - '0');
    number = static_cast<double>(whole);
    if (text.empty()) return false;
  } else {
    const std::size_t mark = text.find('#');
    if (mark != std::string_view::npos) {
      const bool is_infinite = is_word_in_any_case(text.substr(mark + 1).substr(0, 3), "inf");
      number = is_infinite ? kInfinity : std::numeric_limits<double>::quiet_NaN();
    } else {
      const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
      if (end != text.data() + text.size()) return false;
      if (error == std::errc::result_out_of_range) number = is_too_large(text) ? kInfinity : 0.0;
    }
  }
  if (is_negative) number = -number;
  return true;
}

bool DbcStatementReader::begins_statement() const noexcept {
  const DbcToken& token = peek();
  if (token.kind == DbcTokenKind::kEnd) return true;
  if (token.kind != DbcTokenKind::kIdentifier) return false;
  return find_section(token.text) != DbcSection::kNone ||
         (token.position.column == 1 && looks_like_section(token.text));
}

bool DbcStatementReader::is_at_name() const noexcept {
  switch (peek().kind) {
    case DbcTokenKind::kIdentifier:
      return !is_at_statement();
    case DbcTokenKind::kNumber:
      return true;
    case DbcTokenKind::kPunctuation: {
      // Names in the wild may begin with anything but what has a meaning of its own.
      constexpr std::string_view kReserved = ":;,|@()[]";
      const char c = peek().text.front();
      return (static_cast<unsigned char>(c) > ' ') && c != '\x7F' &&
             kReserved.find(c) == std::string_view::npos;
    }
    case DbcTokenKind::kString:
    case DbcTokenKind::kEnd:
      break;
  }
  return false;
}

bool DbcStatementReader::expect_name(std::string_view& text, std::string_view expected) {
  if (!is_at_name()) return fail(peek(), "{}", expected);
  text = lexer_.take_name().text;
  return true;
}

bool DbcStatementReader::expect_string(std::string& text, std::string_view expected,
                                       DbcQuoting quoting) {
  if (peek().kind != DbcTokenKind::kString) return fail(peek(), "{}", expected);
  const DbcString string = lexer_.take_string(quoting);
  if (!string.is_terminated) {
    has_cut_string_ = true;
    warnings_->add(DbcSeverity::kError, string.position,
                   "found a string without end, expected a closing \"; it ends with {}",
                   quoting == DbcQuoting::kComment ? "its statement" : "its line");
  }
  text = string_value(string);
  return true;
}

bool DbcStatementReader::expect_number(double& number, std::string_view expected) {
  if (peek().kind == DbcTokenKind::kNumber && to_double(peek().text, number) &&
      std::isfinite(number)) {
    lexer_.advance();
    return true;
  }
  return expect_odd_number(number, expected);
}

/// NaN, infinities, and what is no number.
bool DbcStatementReader::expect_odd_number(double& number, std::string_view expected) {
  const DbcToken token = peek();
  bool is_number = token.kind == DbcTokenKind::kNumber && to_double(token.text, number);
  bool is_negative = false;
  if (!is_number) {
    // "nan", "-inf", "Infinity"
    DbcLexer ahead = lexer_;
    if (is_at('-') || is_at('+')) is_negative = ahead.take().text.front() == '-';
    const DbcToken word = ahead.peek();
    if (word.kind == DbcTokenKind::kIdentifier) {
      is_number = true;
      if (is_word_in_any_case(word.text, "nan")) {
        number = std::numeric_limits<double>::quiet_NaN();
      } else if (is_word_in_any_case(word.text, "inf") ||
                 is_word_in_any_case(word.text, "infinity")) {
        number = is_negative ? -kInfinity : kInfinity;
      } else {
        is_number = false;
      }
    }
    if (is_number) lexer_ = ahead;
  }
  if (!is_number) return fail(token, "{}, a number", expected);
  lexer_.advance();
  if (warnings_->is_kept(DbcSeverity::kWarning)) {
    warnings_->warn(token.position, "found {}, expected {} that a double can hold", describe(token),
                    expected);
  } else {
    warnings_->warn(token.position, "");
  }
  return true;
}

bool DbcStatementReader::read_whole(const DbcToken& token, std::uint64_t& magnitude,
                                    bool& is_negative) noexcept {
  std::string_view text = token.text;
  if (token.kind == DbcTokenKind::kIdentifier &&
      (text.starts_with("0x") || text.starts_with("0X"))) {
    text.remove_prefix(2);
    const auto [end, error] =
        std::from_chars(text.data(), text.data() + text.size(), magnitude, 16);
    return error == std::errc{} && end == text.data() + text.size();
  }
  if (token.kind != DbcTokenKind::kNumber) return false;
  if (text.size() == 1 && is_digit(text.front())) {
    magnitude = static_cast<std::uint64_t>(text.front() - '0');
    return true;
  }
  if (text.front() == '+' || text.front() == '-') {
    is_negative = text.front() == '-';
    text.remove_prefix(1);
  }
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), magnitude);
  if (error == std::errc{} && end == text.data() + text.size()) return true;
  double number = 0.0;
  if (!to_double(text, number) || !(number < 0x1p64) || number != std::trunc(number)) return false;
  magnitude = static_cast<std::uint64_t>(number);
  return true;
}

bool DbcStatementReader::expect_raw_value(std::int64_t& value, std::string_view expected) {
  const DbcToken token = peek();
  std::uint64_t magnitude = 0;
  bool is_negative = false;
  if (!read_whole(token, magnitude, is_negative) ||
      (is_negative && magnitude > std::uint64_t{1} << 63)) {
    return fail(token, "{}", expected);
  }
  take();
  value = static_cast<std::int64_t>(is_negative ? std::uint64_t{0} - magnitude : magnitude);
  return true;
}

bool DbcStatementReader::expect_range(DbcMultiplexRange& range) {
  if (!expect_integer(range.first, "a range of the multiplexer's values")) return false;
  range.last = range.first;
  constexpr std::string_view kExpected = "the range's last value";
  if (accept('-')) return expect_integer(range.last, kExpected);
  // "3-5": the lexer takes the dash for the sign of the second number.
  if (peek().kind != DbcTokenKind::kNumber || peek().text.front() != '-') return true;
  bool is_negative = false;
  if (!read_whole(peek(), range.last, is_negative)) return fail(peek(), "{}", kExpected);
  take();
  return true;
}

bool DbcStatementReader::expect_end() {
  const bool may_lack = std::exchange(has_cut_string_, false);
  if (accept(';')) return true;
  if (!is_at_statement()) return fail(peek(), "\";\"");
  if (!may_lack) {
    warnings_->warn(peek().position, "found {}, expected \";\" before it", describe(peek()));
  }
  return true;
}

void DbcStatementReader::skip_statement() noexcept {
  has_cut_string_ = false;
  while (!is_at_statement()) {
    if (is_at(';')) {
      lexer_.advance();
      return;
    }
    lexer_.advance();
  }
}

void DbcStatementReader::skip_signal() noexcept {
  has_cut_string_ = false;
  while (!is_at_statement()) {
    if (peek().kind == DbcTokenKind::kIdentifier &&
        (peek().text == "SG_" || peek().text == "BO_")) {
      return;
    }
    if (is_at(';')) {
      lexer_.advance();
      return;
    }
    lexer_.advance();
  }
}

}  // namespace faultline
