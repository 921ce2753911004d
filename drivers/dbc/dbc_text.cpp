#include <array>
#include <cstdint>

#include <fmt/format.h>

#include "drivers/dbc/dbc_lexer.h"

namespace faultline {
namespace {

/// A message shows this much of a long token.
constexpr std::size_t kShownBytes = 40;

/// Code points of the bytes 0x80 .. 0x9F in Windows-1252; what it leaves open is as in Latin-1.
constexpr std::array<std::uint16_t, 32> kWindows1252 = {
    0x20AC, 0x0081, 0x201A, 0x0192, 0x201E, 0x2026, 0x2020, 0x2021, 0x02C6, 0x2030, 0x0160,
    0x2039, 0x0152, 0x008D, 0x017D, 0x008F, 0x0090, 0x2018, 0x2019, 0x201C, 0x201D, 0x2022,
    0x2013, 0x2014, 0x02DC, 0x2122, 0x0161, 0x203A, 0x0153, 0x009D, 0x017E, 0x0178};

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

std::string windows1252_to_utf8(std::string_view text) {
  std::string utf8;
  utf8.reserve(2 * text.size());
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    const unsigned code = byte >= 0x80 && byte < 0xA0 ? kWindows1252[byte - 0x80u] : byte;
    if (code < 0x80) {
      utf8 += c;
    } else if (code < 0x800) {
      utf8 += static_cast<char>(0xC0 | (code >> 6));
      utf8 += static_cast<char>(0x80 | (code & 0x3F));
    } else {
      utf8 += static_cast<char>(0xE0 | (code >> 12));
      utf8 += static_cast<char>(0x80 | ((code >> 6) & 0x3F));
      utf8 += static_cast<char>(0x80 | (code & 0x3F));
    }
  }
  utf8.shrink_to_fit();
  return utf8;
}

}  // namespace

std::string to_utf8(std::string_view text) {
  return is_utf8(text) ? std::string(text) : windows1252_to_utf8(text);
}

std::string shown(std::string_view text) {
  if (text.size() <= kShownBytes) return to_utf8(text);
  // Do not cut through a UTF-8 sequence: the rest would be read as Windows-1252.
  std::size_t length = kShownBytes;
  while (length > kShownBytes - 3 && (static_cast<unsigned char>(text[length]) & 0xC0) == 0x80) {
    --length;
  }
  return to_utf8(text.substr(0, length)) + "...";
}

std::string describe(const DbcToken& token) {
  switch (token.kind) {
    case DbcTokenKind::kEnd:
      return "the end of the file";
    case DbcTokenKind::kNumber:
      return fmt::format("number {}", shown(token.text));
    case DbcTokenKind::kString: {
      const std::string_view start = token.text.substr(1, 2 * kShownBytes);
      return fmt::format("string \"{}\"", shown(start.substr(0, start.find_first_of("\r\n\""))));
    }
    case DbcTokenKind::kIdentifier:
      return fmt::format("\"{}\"", shown(token.text));
    case DbcTokenKind::kPunctuation:
      break;
  }
  const auto byte = static_cast<unsigned char>(token.text.front());
  if (byte <= 0x20 || byte >= 0x7F) return fmt::format("byte 0x{:02X}", byte);
  return fmt::format("\"{}\"", token.text);
}

std::string string_value(const DbcString& string) {
  if (!string.has_marks) {
    return string.has_high_bytes ? to_utf8(string.text) : std::string(string.text);
  }
  std::string unescaped;
  unescaped.reserve(string.text.size());
  for (std::size_t n = 0; n < string.text.size(); ++n) {
    const char c = string.text[n];
    const char next = n + 1 < string.text.size() ? string.text[n + 1] : '\0';
    if ((c == '\\' && (next == '"' || next == '\\')) || (c == '"' && next == '"')) ++n;
    unescaped += string.text[n];
  }
  return string.has_high_bytes ? to_utf8(unescaped) : unescaped;
}

}  // namespace faultline
