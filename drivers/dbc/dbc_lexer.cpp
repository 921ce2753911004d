#include "drivers/dbc/dbc_lexer.h"

#include <algorithm>
#include <array>
#include <cstring>

namespace faultline {
namespace {

// Not <cctype>: that depends on the locale.
enum CharacterClass : std::uint8_t {
  kBlank = 1,
  kLineEnd = 2,
  kDigit = 4,
  kLetter = 8,       ///< and `_`
  kNoName = 16,      ///< ends a name
  kStringMark = 32,  ///< needs a look inside a string
};

constexpr std::array<std::uint8_t, 256> make_classes() {
  std::array<std::uint8_t, 256> classes{};
  for (int c = 0; c <= ' '; ++c) classes[static_cast<std::size_t>(c)] = kNoName;
  // 0x1A: the end of the file in old DOS tools.
  for (const char c : std::string_view(" \t\f\v\x1A")) {
    classes[static_cast<std::size_t>(c)] |= kBlank;
  }
  for (const char c : std::string_view("\n\r")) {
    classes[static_cast<std::size_t>(c)] |= kLineEnd | kStringMark;
  }
  for (int c = '0'; c <= '9'; ++c) classes[static_cast<std::size_t>(c)] = kDigit;
  for (int c = 'a'; c <= 'z'; ++c) classes[static_cast<std::size_t>(c)] = kLetter;
  for (int c = 'A'; c <= 'Z'; ++c) classes[static_cast<std::size_t>(c)] = kLetter;
  classes['_'] = kLetter;
  for (const char c : std::string_view(":;,\"|@()[]\x7F")) {
    classes[static_cast<std::size_t>(c)] |= kNoName;
  }
  for (const char c : std::string_view("\"\\")) classes[static_cast<std::size_t>(c)] |= kStringMark;
  for (std::size_t c = 0x80; c < 256; ++c) classes[c] |= kStringMark;
  return classes;
}

constexpr std::array<std::uint8_t, 256> kClasses = make_classes();

bool is(char c, int classes) noexcept {
  return (kClasses[static_cast<unsigned char>(c)] & classes) != 0;
}
bool is_sign(char c) noexcept { return c == '+' || c == '-'; }

struct Keyword {
  std::string_view text;
  DbcSection section;
};

// The most frequent first.
constexpr Keyword kKeywords[] = {
    {"SG_", DbcSection::kSignal},
    {"BA_", DbcSection::kAttribute},
    {"CM_", DbcSection::kComment},
    {"VAL_", DbcSection::kValueNames},
    {"BO_", DbcSection::kMessage},
    {"SIG_VALTYPE_", DbcSection::kSignalType},
    {"SG_MUL_VAL_", DbcSection::kMultiplexing},
    {"BA_DEF_", DbcSection::kAttributeDefinition},
    {"BA_DEF_DEF_", DbcSection::kAttributeDefault},
    {"VAL_TABLE_", DbcSection::kValueTable},
    {"SIG_GROUP_", DbcSection::kSignalGroup},
    {"BO_TX_BU_", DbcSection::kTransmitters},
    {"EV_", DbcSection::kEnvironmentVariable},
    {"BU_", DbcSection::kNodes},
    {"BS_", DbcSection::kBusTiming},
    {"NS_", DbcSection::kNewSymbols},
    {"VERSION", DbcSection::kVersion},
    {"BA_DEF_REL_", DbcSection::kUnread},
    {"BA_REL_", DbcSection::kUnread},
    {"BA_DEF_DEF_REL_", DbcSection::kUnread},
    {"BU_SG_REL_", DbcSection::kUnread},
    {"BU_EV_REL_", DbcSection::kUnread},
    {"BU_BO_REL_", DbcSection::kUnread},
    {"ENVVAR_DATA_", DbcSection::kUnread},
    {"EV_DATA_", DbcSection::kUnread},
    {"SGTYPE_", DbcSection::kUnread},
    {"SGTYPE_VAL_", DbcSection::kUnread},
    {"SIG_TYPE_REF_", DbcSection::kUnread},
    {"SIGTYPE_VALTYPE_", DbcSection::kUnread},
    {"BA_DEF_SGTYPE_", DbcSection::kUnread},
    {"BA_SGTYPE_", DbcSection::kUnread},
    {"CAT_DEF_", DbcSection::kUnread},
    {"CAT_", DbcSection::kUnread},
    {"NS_DESC_", DbcSection::kUnread},
    {"FILTER", DbcSection::kUnread},
};

}  // namespace

DbcSection find_section(std::string_view keyword) noexcept {
  if (keyword.size() < 3) return DbcSection::kNone;
  for (const Keyword& known : kKeywords) {
    if (is_same_word(keyword, known.text)) return known.section;
  }
  return DbcSection::kNone;
}

DbcLexer::DbcLexer(std::string_view text) noexcept
    : cursor_(text.data()),
      end_(text.data() + text.size()),
      line_begin_(text.data()),
      vain_bytes_left_(text.size()) {
  constexpr std::string_view kUtf8Mark = "\xEF\xBB\xBF";
  if (text.starts_with(kUtf8Mark)) cursor_ = line_begin_ = cursor_ + kUtf8Mark.size();
  scan();
  token_.starts_line = true;
}

DbcToken DbcLexer::take_name() noexcept {
  DbcToken name = token_;
  const char* const from = name.text.data();
  // What identifiers and numbers are made of may stand in names.
  const bool is_word = name.kind != DbcTokenKind::kPunctuation;
  const char* to = is_word ? from + name.text.size() : from;
  while (to != end_ && !is(*to, kNoName)) {
    if (to[0] == '/' && to + 1 != end_ && to[1] == '/') break;
    ++to;
  }
  if (to == from) to = from + name.text.size();
  name.text = {from, static_cast<std::size_t>(to - from)};
  cursor_ = to;
  scan();
  return name;
}

[[gnu::always_inline]] inline void DbcLexer::skip_blanks() noexcept {
  const char* at = cursor_;
  for (; at != end_; ++at) {
    const char c = *at;
    if (is(c, kBlank)) continue;
    if (is(c, kLineEnd)) {
      if (c == '\r' && at + 1 != end_ && at[1] == '\n') ++at;
      ++line_;
      line_begin_ = at + 1;
      token_.starts_line = true;
    } else if (c == '/' && at + 1 != end_ && at[1] == '/') {
      while (at + 1 != end_ && !is(at[1], kLineEnd)) ++at;
    } else {
      break;
    }
  }
  cursor_ = at;
}

/// End of the number that begins at `from`; `from` if none does.
const char* DbcLexer::end_of_number(const char* from) const noexcept {
  const auto skip_digits = [this](const char* at) {
    while (at != end_ && is(*at, kDigit)) ++at;
    return at;
  };
  const char* at = from;
  if (is_sign(*at)) ++at;
  const char* const digits = at;
  at = skip_digits(at);
  std::ptrdiff_t digit_count = at - digits;
  if (at != end_ && *at == '.') {
    const char* const fraction = at + 1;
    at = skip_digits(fraction);
    digit_count += at - fraction;
  }
  if (digit_count == 0) return from;
  if (at != end_ && *at == '#') {  // "1.#IND", "1.#INF": how Microsoft's library wrote them
    ++at;
    while (at != end_ && is(*at, kLetter | kDigit)) ++at;
    return at;
  }
  if (at != end_ && (*at == 'e' || *at == 'E')) {
    const char* exponent = at + 1;
    if (exponent != end_ && is_sign(*exponent)) ++exponent;
    const char* const exponent_end = skip_digits(exponent);
    if (exponent_end != exponent) at = exponent_end;
  }
  return at;
}

void DbcLexer::scan() noexcept {
  token_.starts_line = false;
  skip_blanks();
  token_.position.line = line_;
  token_.position.column = static_cast<int>(cursor_ - line_begin_) + 1;
  const char* const from = cursor_;
  if (from == end_) {
    token_.kind = DbcTokenKind::kEnd;
    token_.text = {end_, 0};
    token_.starts_line = true;
    return;
  }
  const char first = *from;
  const char* to = from + 1;
  if (is(first, kLetter)) {
    token_.kind = DbcTokenKind::kIdentifier;
    while (to != end_ && is(*to, kLetter | kDigit)) ++to;
  } else if (is(first, kDigit) || is_sign(first) || first == '.') {
    const char* const number_end = end_of_number(from);
    if (number_end == from) {
      token_.kind = DbcTokenKind::kPunctuation;
    } else if (is(first, kDigit) && number_end != end_ && is(*number_end, kLetter)) {
      token_.kind = DbcTokenKind::kIdentifier;  // "1st_Gear"
      while (to != end_ && is(*to, kLetter | kDigit)) ++to;
    } else {
      token_.kind = DbcTokenKind::kNumber;
      to = number_end;
    }
  } else if (first == '"') {
    token_.kind = DbcTokenKind::kString;
    token_.text = {from, static_cast<std::size_t>(end_ - from)};
    cursor_ = to;
    return;
  } else {
    token_.kind = DbcTokenKind::kPunctuation;
  }
  token_.text = {from, static_cast<std::size_t>(to - from)};
  cursor_ = to;
}

/// True if the line that begins at `line` looks like the start of a statement.
bool DbcLexer::begins_statement(const char* line) const noexcept {
  while (line != end_ && is(*line, kBlank)) ++line;
  const char* to = line;
  while (to != end_ && is(*to, kLetter)) ++to;
  if (to == line || to == end_ || !(is(*to, kBlank) || *to == ':' || *to == '"')) return false;
  return find_section({line, static_cast<std::size_t>(to - line)}) != DbcSection::kNone;
}

/// True if a comment may end at `quote`: a semicolon, a new statement or nothing follows.
bool DbcLexer::is_comment_end(const char* quote) const noexcept {
  for (const char* at = quote + 1; at != end_; ++at) {
    if (*at == ';') return true;
    if (is(*at, kLineEnd)) {
      if (begins_statement(at + 1)) return true;
    } else if (!is(*at, kBlank)) {
      return false;
    }
  }
  return true;
}

/// Moves to `to` within a string, counting its lines, and scans the token behind.
void DbcLexer::move_to(const char* to, bool has_lines) noexcept {
  if (!has_lines) cursor_ = to;
  for (; cursor_ != to; ++cursor_) {
    const char c = *cursor_;
    if (!is(c, kLineEnd)) continue;
    if (c == '\r' && cursor_ + 1 != end_ && cursor_[1] == '\n') continue;
    ++line_;
    line_begin_ = cursor_ + 1;
  }
  scan();
}

DbcString DbcLexer::take_string(DbcQuoting quoting) noexcept {
  DbcString string;
  string.position = token_.position;
  const char* const from = cursor_;
  const char* line_end = nullptr;   // of the string's first line
  const char* statement = nullptr;  // end of the line before the first that looks like one
  const char* closing = nullptr;
  const char* at = from;
  for (; at != end_; ++at) {
    const char c = *at;
    if (!is(c, kStringMark)) continue;
    if (c == '"') {
      if (quoting == DbcQuoting::kComment ? is_comment_end(at)
                                          : at + 1 == end_ || at[1] != '"' ||
                                                (at == from && (at + 2 == end_ || at[2] != '"'))) {
        closing = at;
        break;
      }
      // A quote that is none of ours, behind a line that looks like a statement: we are in it.
      if (statement != nullptr) break;
      string.has_marks = true;
      if (at + 1 != end_ && at[1] == '"' && quoting == DbcQuoting::kPlain) ++at;
    } else if (c == '\\') {
      string.has_marks = true;
      if (at + 1 != end_ && (at[1] == '"' || at[1] == '\\')) ++at;
    } else if (is(c, kLineEnd)) {
      if (c == '\r' && at + 1 != end_ && at[1] == '\n') continue;
      if (line_end == nullptr) line_end = at;
      if (vain_bytes_left_ == 0) break;
      if (statement == nullptr && begins_statement(at + 1)) statement = at;
    } else {
      string.has_high_bytes = true;
    }
  }
  // Plain strings hardly ever have several lines: one with a statement within has lost its quote.
  if (closing != nullptr && statement != nullptr && quoting == DbcQuoting::kPlain) {
    closing = nullptr;
  }
  if (closing != nullptr) {
    string.text = {from, static_cast<std::size_t>(closing - from)};
    move_to(closing + 1, line_end != nullptr);
    return string;
  }
  string.is_terminated = false;
  const char* cut = quoting == DbcQuoting::kComment ? statement : line_end;
  if (cut == nullptr) cut = line_end != nullptr && at == end_ ? line_end : at;
  vain_bytes_left_ -= std::min(vain_bytes_left_, static_cast<std::size_t>(at - cut));
  const char* text_end = cut;
  while (text_end != from && is(text_end[-1], kBlank | kLineEnd)) --text_end;
  if (text_end != from && text_end[-1] == ';') --text_end;
  if (text_end != from && text_end[-1] == '"') --text_end;  // "...\";": a path's last backslash
  string.text = {from, static_cast<std::size_t>(text_end - from)};
  move_to(cut, true);
  return string;
}

}  // namespace faultline
