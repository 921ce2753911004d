#include "drivers/dbc/dbc_lexer.h"

#include <algorithm>

#include <fmt/format.h>

#include "drivers/dbc/dbc_parser.h"

namespace faultline {
namespace {

/// A message shows this much of a long token.
constexpr std::size_t kShownBytes = 40;

// Not <cctype>: that depends on the locale.
bool is_digit(char c) noexcept { return c >= '0' && c <= '9'; }
bool is_letter(char c) noexcept { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }
bool is_identifier_start(char c) noexcept { return is_letter(c) || c == '_'; }
bool is_identifier_part(char c) noexcept { return is_identifier_start(c) || is_digit(c); }
bool is_blank(char c) noexcept {
  return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\f' || c == '\v';
}
bool is_sign(char c) noexcept { return c == '+' || c == '-'; }

/// Length of the UTF-8 sequence that `first` starts; 0 if it can start none.
std::size_t utf8_length(unsigned char first) noexcept {
  if (first < 0x80) return 1;
  if (first >= 0xC2 && first <= 0xDF) return 2;
  if (first >= 0xE0 && first <= 0xEF) return 3;
  if (first >= 0xF0 && first <= 0xF4) return 4;
  return 0;
}

/// True if the bytes form UTF-8: no stray byte, no overlong form, no surrogate (RFC 3629).
bool is_utf8(std::string_view text) noexcept {
  for (std::size_t n = 0; n < text.size();) {
    const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(text[n + k]); };
    const std::size_t length = utf8_length(byte(0));
    if (length == 0 || n + length > text.size()) return false;
    for (std::size_t k = 1; k < length; ++k) {
      if ((byte(k) & 0xC0) != 0x80) return false;
    }
    const bool is_overlong =
        (byte(0) == 0xE0 && byte(1) < 0xA0) || (byte(0) == 0xF0 && byte(1) < 0x90);
    const bool is_outside =
        (byte(0) == 0xED && byte(1) >= 0xA0) || (byte(0) == 0xF4 && byte(1) >= 0x90);
    if (is_overlong || is_outside) return false;
    n += length;
  }
  return true;
}

std::string latin1_to_utf8(std::string_view text) {
  std::string utf8;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x80) {
      utf8 += c;
    } else {
      utf8 += static_cast<char>(0xC0 | (byte >> 6));
      utf8 += static_cast<char>(0x80 | (byte & 0x3F));
    }
  }
  return utf8;
}

std::string to_utf8(std::string_view text) {
  return is_utf8(text) ? std::string(text) : latin1_to_utf8(text);
}

std::string shortened(std::string_view text) {
  if (text.size() <= kShownBytes) return to_utf8(text);
  return to_utf8(text.substr(0, kShownBytes)) + "...";
}

}  // namespace

DbcLexer::DbcLexer(std::string_view text, const std::string& source)
    : rest_(text), source_(&source) {
  constexpr std::string_view kUtf8Mark = "\xEF\xBB\xBF";
  if (rest_.starts_with(kUtf8Mark)) rest_.remove_prefix(kUtf8Mark.size());
  token_ = scan();
}

DbcToken DbcLexer::take() {
  const DbcToken taken = token_;
  previous_line_ = position_.line;
  token_ = scan();
  return taken;
}

char DbcLexer::at(std::size_t offset) const noexcept {
  return offset < rest_.size() ? rest_[offset] : '\0';
}

void DbcLexer::advance(std::size_t bytes) noexcept {
  for (std::size_t n = 0; n < bytes; ++n) {
    if (rest_[n] == '\n') {
      ++position_.line;
      position_.column = 1;
    } else {
      ++position_.column;
    }
  }
  rest_.remove_prefix(bytes);
}

void DbcLexer::skip_blanks() noexcept {
  std::size_t blanks = 0;
  while (blanks < rest_.size() && is_blank(rest_[blanks])) ++blanks;
  advance(blanks);
}

std::size_t DbcLexer::number_length() const noexcept {
  std::size_t length = is_sign(at(0)) ? 1 : 0;
  const std::size_t digits_from = length;
  while (is_digit(at(length)) || at(length) == '.') ++length;
  if (length == digits_from ||
      !std::any_of(rest_.begin() + static_cast<std::ptrdiff_t>(digits_from),
                   rest_.begin() + static_cast<std::ptrdiff_t>(length), is_digit)) {
    return 0;
  }
  if (at(length) == 'e' || at(length) == 'E') {
    const std::size_t exponent_from = length + (is_sign(at(length + 1)) ? 2 : 1);
    std::size_t exponent_to = exponent_from;
    while (is_digit(at(exponent_to))) ++exponent_to;
    if (exponent_to > exponent_from) length = exponent_to;
  }
  return length;
}

DbcToken DbcLexer::scan() {
  skip_blanks();
  if (rest_.empty()) return {DbcTokenKind::kEnd, {}, position_};
  if (rest_.front() == '"') return scan_string();
  DbcToken token{DbcTokenKind::kPunctuation, {}, position_};
  std::size_t length = number_length();
  if (length > 0) {
    token.kind = DbcTokenKind::kNumber;
  } else if (is_identifier_start(rest_.front())) {
    token.kind = DbcTokenKind::kIdentifier;
    while (is_identifier_part(at(length))) ++length;
  } else {
    length = 1;
  }
  token.text = rest_.substr(0, length);
  advance(length);
  return token;
}

DbcToken DbcLexer::scan_string() {
  DbcToken token{DbcTokenKind::kString, {}, position_};
  std::size_t end = 1;
  while (end < rest_.size() && rest_[end] != '"') {
    const bool is_escape = rest_[end] == '\\' && (at(end + 1) == '"' || at(end + 1) == '\\');
    end += is_escape ? 2 : 1;
  }
  if (end >= rest_.size()) {
    throw DbcError(*source_, position_, "found a string without end, expected a closing \"");
  }
  token.text = rest_.substr(1, end - 1);
  advance(end + 1);
  return token;
}

std::string describe(const DbcToken& token) {
  switch (token.kind) {
    case DbcTokenKind::kEnd:
      return "the end of the file";
    case DbcTokenKind::kNumber:
      return fmt::format("number {}", shortened(token.text));
    case DbcTokenKind::kString:
      return fmt::format("string \"{}\"", shortened(token.text));
    case DbcTokenKind::kIdentifier:
      return fmt::format("\"{}\"", shortened(token.text));
    case DbcTokenKind::kPunctuation:
      break;
  }
  const auto byte = static_cast<unsigned char>(token.text.front());
  if (byte <= 0x20 || byte >= 0x7F) return fmt::format("byte 0x{:02X}", byte);
  return fmt::format("\"{}\"", token.text);
}

std::string string_value(const DbcToken& token) {
  std::string unescaped;
  unescaped.reserve(token.text.size());
  for (std::size_t n = 0; n < token.text.size(); ++n) {
    const bool is_escape = token.text[n] == '\\' && n + 1 < token.text.size() &&
                           (token.text[n + 1] == '"' || token.text[n + 1] == '\\');
    if (is_escape) ++n;
    unescaped += token.text[n];
  }
  return to_utf8(unescaped);
}

}  // namespace faultline
