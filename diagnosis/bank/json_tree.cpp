#include "diagnosis/bank/json_tree.h"

#include <algorithm>
#include <iterator>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/bank/bank_file.h"

namespace faultline {
namespace {

// A bank nests file > filters > filter > observer > nonlinearities > term > function > list: 8; the
// rest is slack.
constexpr std::size_t kMaxDepth = 16;
// A bank's largest object has 17 keys; the bound keeps the search for repeated keys cheap.
constexpr std::size_t kMaxKeys = 64;

// Reads characters and counts them, so that a parser's event can be placed in the text.
class CountingIterator {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  CountingIterator(const char* at, const char** furthest) : at_(at), furthest_(furthest) {}
  reference operator*() const { return *at_; }
  CountingIterator& operator++() {
    *furthest_ = ++at_;
    return *this;
  }
  CountingIterator operator++(int) {
    CountingIterator before = *this;
    ++*this;
    return before;
  }
  friend bool operator==(const CountingIterator& a, const CountingIterator& b) {
    return a.at_ == b.at_;
  }
  friend bool operator!=(const CountingIterator& a, const CountingIterator& b) { return !(a == b); }

 private:
  const char* at_;
  const char** furthest_;
};

// Builds the tree from the parser's events (nlohmann::json_sax).
class TreeBuilder {
 public:
  using Kind = JsonValue::Kind;

  TreeBuilder(std::string_view text, const std::string& source)
      : text_(text), source_(source), furthest_(text.data()) {}

  const char** furthest() { return &furthest_; }
  JsonValue take() { return std::move(root_); }

  // The parser's interface: its names, its signatures.
  bool null() { return scalar(Kind::kNull, 0.0, "null", Lookahead::kNone); }
  bool boolean(bool value) {
    return scalar(Kind::kBoolean, 0.0, value ? "true" : "false", Lookahead::kNone);
  }
  bool number_integer(std::int64_t value) {
    return scalar(Kind::kInteger, static_cast<double>(value), fmt::to_string(value),
                  Lookahead::kOne);
  }
  bool number_unsigned(std::uint64_t value) {
    return scalar(Kind::kInteger, static_cast<double>(value), fmt::to_string(value),
                  Lookahead::kOne);
  }
  bool number_float(double value, const std::string& digits) {
    return scalar(Kind::kNumber, value, digits, Lookahead::kOne);
  }
  bool string(std::string& value) { return scalar(Kind::kString, 0.0, value, Lookahead::kNone); }
  bool binary(std::vector<std::uint8_t>&) { return false; }  // JSON text has none
  bool start_object(std::size_t) { return open(Kind::kObject); }
  bool start_array(std::size_t) { return open(Kind::kArray); }
  bool end_object() { return close(); }
  bool end_array() { return close(); }
  bool key(std::string& name) {
    const std::size_t offset = begin_token();
    JsonValue& object = *open_.back();
    if (std::find(object.keys.begin(), object.keys.end(), name) != object.keys.end()) {
      fail(offset, fmt::format("found key \"{}\" twice, expected it once", name));
    }
    if (object.keys.size() == kMaxKeys) {
      fail(offset, fmt::format("found an object with more than {} keys", kMaxKeys));
    }
    object.keys.push_back(name);
    object.key_offsets.push_back(offset);
    end_token(Lookahead::kNone);
    return true;
  }
  template <class Exception>
  bool parse_error(std::size_t position, const std::string&, const Exception& exception) {
    const std::string text = exception.what();
    // The parser's own "[json...] parse error at line 1, column 2: " says less than our position.
    const std::size_t start = text.find(": ");
    fail(position == 0 ? 0 : position - 1,
         "not JSON: " + (start == std::string::npos ? text : text.substr(start + 2)));
  }

 private:
  // The lexer knows the end of a number only from the character behind it.
  enum class Lookahead { kNone, kOne };

  [[noreturn]] void fail(std::size_t offset, const std::string& text) const {
    const TextPosition position = text_position(text_, offset);
    throw BankFileError(source_, position.line, position.column, text);
  }

  // Between two tokens there is only white space and , or : so the token begins behind those.
  std::size_t begin_token() {
    const std::size_t start = text_.find_first_not_of(" \t\r\n,:", previous_end_);
    return start == std::string_view::npos ? text_.size() : start;
  }

  void end_token(Lookahead lookahead) {
    const auto read = static_cast<std::size_t>(furthest_ - text_.data());
    const bool is_one_too_far = lookahead == Lookahead::kOne && !ends_in_number(read);
    previous_end_ = is_one_too_far ? read - 1 : read;
  }

  // A number at the very end of the text has no character behind it.
  [[nodiscard]] bool ends_in_number(std::size_t read) const {
    return read == text_.size() && read > 0 && text_[read - 1] >= '0' && text_[read - 1] <= '9';
  }

  JsonValue& add(Kind kind) {
    JsonValue* value = &root_;
    if (!open_.empty()) {
      value = &open_.back()->children.emplace_back();
    }
    value->kind = kind;
    value->offset = begin_token();
    return *value;
  }

  bool scalar(Kind kind, double number, std::string text, Lookahead lookahead) {
    JsonValue& value = add(kind);
    value.number = number;
    value.text = std::move(text);
    end_token(lookahead);
    return true;
  }

  bool open(Kind kind) {
    JsonValue& value = add(kind);
    if (open_.size() == kMaxDepth) {
      fail(value.offset, fmt::format("found lists or objects nested deeper than {}", kMaxDepth));
    }
    open_.push_back(&value);  // stays put: its parent grows only after it is closed
    end_token(Lookahead::kNone);
    return true;
  }

  bool close() {
    open_.pop_back();
    end_token(Lookahead::kNone);
    return true;
  }

  std::string_view text_;
  const std::string& source_;
  const char* furthest_;
  std::size_t previous_end_ = 0;
  JsonValue root_;
  std::vector<JsonValue*> open_;
};

}  // namespace

JsonValue parse_json(std::string_view text, const std::string& source) {
  TreeBuilder builder(text, source);
  const char* end = text.data() + text.size();
  // Every refusal leaves the builder as a BankFileError, so the parser's answer is always true.
  static_cast<void>(nlohmann::json::sax_parse(CountingIterator(text.data(), builder.furthest()),
                                              CountingIterator(end, builder.furthest()), &builder));
  return builder.take();
}

TextPosition text_position(std::string_view text, std::size_t offset) {
  const std::string_view before = text.substr(0, std::min(offset, text.size()));
  const std::size_t line_start = before.rfind('\n');
  const std::size_t column =
      line_start == std::string_view::npos ? before.size() : before.size() - line_start - 1;
  return {static_cast<int>(std::count(before.begin(), before.end(), '\n')) + 1,
          static_cast<int>(column) + 1};
}

std::string json_string(const std::string& text) {
  // Names come from UTF-8 files; a stray byte is replaced rather than refused.
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string json_number(double number) { return nlohmann::json(number).dump(); }

}  // namespace faultline
