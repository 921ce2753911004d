#include "drivers/can/candump_log.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstring>
#include <limits>

namespace faultline {
namespace {

/// Bit of a candump identifier that marks an error frame (CAN_ERR_FLAG of linux/can.h).
constexpr std::uint32_t kErrorFlag = 0x2000'0000;
/// FD flags (CANFD_BRS and CANFD_ESI of linux/can.h).
constexpr std::uint8_t kBitRateSwitch = 1;
constexpr std::uint8_t kErrorStateIndicator = 2;

constexpr std::size_t kStandardIdDigits = 3;
constexpr std::size_t kExtendedIdDigits = 8;
constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;
/// Whole seconds of which every nanosecond is a Timestamp.
constexpr std::int64_t kLastSecond =
    std::numeric_limits<std::int64_t>::max() / kNanosecondsPerSecond - 1;
constexpr std::uint8_t kNoDigit = 0xFF;

constexpr std::array<std::uint8_t, 256> make_hex_values() {
  std::array<std::uint8_t, 256> values{};
  for (std::uint8_t& value : values) value = kNoDigit;
  for (std::uint8_t digit = 0; digit < 10; ++digit) {
    values[static_cast<std::size_t>('0') + digit] = digit;
  }
  for (std::uint8_t digit = 0; digit < 6; ++digit) {
    values[static_cast<std::size_t>('A') + digit] = static_cast<std::uint8_t>(10 + digit);
    values[static_cast<std::size_t>('a') + digit] = static_cast<std::uint8_t>(10 + digit);
  }
  return values;
}

constexpr std::array<std::uint8_t, 256> kHexValues = make_hex_values();

/// @return 0 to 15, or kNoDigit.
std::uint8_t hex_value(char character) noexcept {
  return kHexValues[static_cast<unsigned char>(character)];
}

bool is_blank(char character) noexcept { return character == ' ' || character == '\t'; }
bool is_decimal(char character) noexcept { return character >= '0' && character <= '9'; }
bool is_name_character(char character) noexcept {
  const auto value = static_cast<unsigned char>(character);
  return value > 0x20 && value != 0x7F;
}

/// Where parsing has come to in a line. A parse function returns false after `fail`.
class LineCursor {
 public:
  explicit LineCursor(std::string_view line) noexcept
      : begin_(line.data()), at_(line.data()), end_(line.data() + line.size()) {}

  [[nodiscard]] bool is_at_end() const noexcept { return at_ == end_; }
  [[nodiscard]] bool is_at(char character) const noexcept {
    return at_ != end_ && *at_ == character;
  }
  [[nodiscard]] std::size_t left() const noexcept { return static_cast<std::size_t>(end_ - at_); }
  /// @pre ahead < left().
  [[nodiscard]] char peek(std::size_t ahead = 0) const noexcept { return at_[ahead]; }
  void skip(std::size_t count = 1) noexcept { at_ += count; }
  bool take(char character) noexcept {
    if (!is_at(character)) return false;
    ++at_;
    return true;
  }
  /// @return whether there was one at least.
  bool take_blanks() noexcept {
    const char* const before = at_;
    while (at_ != end_ && is_blank(*at_)) ++at_;
    return at_ != before;
  }
  bool fail(const char* expected) noexcept {
    problem_ = {static_cast<std::size_t>(at_ - begin_) + 1, expected};
    return false;
  }
  [[nodiscard]] const CandumpProblem& problem() const noexcept { return problem_; }
  [[nodiscard]] const char* position() const noexcept { return at_; }

 private:
  const char* begin_;
  const char* at_;
  const char* end_;
  CandumpProblem problem_;
};

bool parse_stamp(LineCursor& cursor, Timestamp& stamp) noexcept {
  if (!cursor.take('(')) return cursor.fail("( and seconds since 1970");
  const LineCursor first_digit = cursor;
  std::int64_t seconds = 0;
  bool has_digit = false;
  for (; !cursor.is_at_end() && is_decimal(cursor.peek()); cursor.skip()) {
    seconds = seconds * 10 + (cursor.peek() - '0');
    has_digit = true;
    if (seconds > kLastSecond) {
      cursor = first_digit;
      return cursor.fail("seconds since 1970, at most 9223372035");
    }
  }
  if (!has_digit) return cursor.fail("decimal digits of seconds since 1970");
  if (!cursor.take('.')) return cursor.fail("a decimal point and a fraction of a second");
  std::int64_t nanoseconds = 0;
  std::int64_t unit = kNanosecondsPerSecond;
  for (; !cursor.is_at_end() && is_decimal(cursor.peek()); cursor.skip()) {
    if (unit == 1) return cursor.fail(") after at most nine digits of a fraction");
    nanoseconds = nanoseconds * 10 + (cursor.peek() - '0');
    unit /= 10;
  }
  if (unit == kNanosecondsPerSecond) return cursor.fail("one to nine decimal digits");
  if (!cursor.take(')')) return cursor.fail(")");
  stamp = Timestamp(std::chrono::nanoseconds(seconds * kNanosecondsPerSecond + nanoseconds * unit));
  return true;
}

bool parse_identifier(LineCursor& cursor, CanFrame& frame) noexcept {
  const LineCursor first_digit = cursor;
  std::uint32_t value = 0;
  std::size_t digits = 0;
  for (; digits < kExtendedIdDigits && digits < cursor.left(); ++digits) {
    const std::uint8_t digit = hex_value(cursor.peek(digits));
    if (digit == kNoDigit) break;
    value = value << 4 | digit;
  }
  cursor.skip(digits);
  if ((digits != kStandardIdDigits && digits != kExtendedIdDigits) || !cursor.take('#')) {
    return cursor.fail("3 or 8 hexadecimal digits of an identifier, then #");
  }
  if (digits == kStandardIdDigits) {
    if (value > kMaxStandardId) {
      cursor = first_digit;
      return cursor.fail("an 11-bit identifier, at most 7FF");
    }
  } else if (value <= kMaxExtendedId) {
    frame.is_extended = true;
  } else if (value <= (kErrorFlag | kMaxExtendedId)) {
    frame.is_error = true;
    value &= kMaxExtendedId;
  } else {
    cursor = first_digit;
    return cursor.fail("a 29-bit identifier, at most 1FFFFFFF (3FFFFFFF for an error frame)");
  }
  frame.id = value;
  return true;
}

/// Bytes of two hexadecimal digits, up to `most`, single dots between them allowed.
bool parse_payload(LineCursor& cursor, std::size_t most, const char* too_long,
                   CanFrame& frame) noexcept {
  std::size_t length = 0;
  for (;;) {
    if (cursor.left() > 0 && cursor.peek() == '.' && length > 0) {
      cursor.skip();
      if (cursor.is_at_end() || hex_value(cursor.peek()) == kNoDigit) {
        return cursor.fail("two hexadecimal digits of a byte");
      }
    }
    if (cursor.is_at_end()) break;
    const std::uint8_t high = hex_value(cursor.peek());
    if (high == kNoDigit) break;
    if (length == most) return cursor.fail(too_long);
    const std::uint8_t low = cursor.left() > 1 ? hex_value(cursor.peek(1)) : kNoDigit;
    if (low == kNoDigit) {
      cursor.skip();
      return cursor.fail("the second hexadecimal digit of a byte");
    }
    frame.data[length++] = static_cast<std::uint8_t>(high << 4 | low);
    cursor.skip(2);
  }
  frame.length = static_cast<std::uint8_t>(length);
  return true;
}

/// `_` and the DLC as it was on the wire, 9 to F, of a frame of eight bytes.
bool parse_raw_dlc(LineCursor& cursor, const CanFrame& frame) noexcept {
  if (frame.length != kMaxClassicPayload || !cursor.take('_')) return true;
  const std::uint8_t dlc = cursor.is_at_end() ? kNoDigit : hex_value(cursor.peek());
  if (dlc == kNoDigit || dlc <= kMaxClassicPayload) return cursor.fail("a raw DLC from 9 to F");
  cursor.skip();
  return true;
}

bool parse_remote(LineCursor& cursor, CanFrame& frame) noexcept {
  if (frame.is_error) return cursor.fail("the bytes of an error frame");
  cursor.skip();  // R
  frame.is_remote = true;
  if (!cursor.is_at_end() && is_decimal(cursor.peek())) {
    const auto length = static_cast<std::uint8_t>(cursor.peek() - '0');
    if (length > kMaxClassicPayload) return cursor.fail("a length from 0 to 8");
    frame.length = length;
    cursor.skip();
  }
  return parse_raw_dlc(cursor, frame);
}

bool parse_fd(LineCursor& cursor, CanFrame& frame) noexcept {
  if (frame.is_error) return cursor.fail("the bytes of an error frame");
  cursor.skip();  // the second #
  const std::uint8_t flags = cursor.is_at_end() ? kNoDigit : hex_value(cursor.peek());
  if (flags == kNoDigit) return cursor.fail("a hexadecimal digit of CAN FD flags");
  cursor.skip();
  frame.is_fd = true;
  frame.is_bit_rate_switched = (flags & kBitRateSwitch) != 0;
  frame.is_error_state = (flags & kErrorStateIndicator) != 0;
  return parse_payload(cursor, kMaxPayload, "at most 64 bytes", frame);
}

bool parse_frame(LineCursor& cursor, CanFrame& frame) noexcept {
  if (!parse_identifier(cursor, frame)) return false;
  if (cursor.is_at('R') || cursor.is_at('r')) return parse_remote(cursor, frame);
  if (cursor.is_at('#')) return parse_fd(cursor, frame);
  return parse_payload(cursor, kMaxClassicPayload, "at most 8 bytes", frame) &&
         parse_raw_dlc(cursor, frame);
}

bool parse_interface_name(LineCursor& cursor, std::string_view& name) noexcept {
  const char* const first = cursor.position();
  while (!cursor.is_at_end() && is_name_character(cursor.peek())) cursor.skip();
  name = {first, static_cast<std::size_t>(cursor.position() - first)};
  return !name.empty() || cursor.fail("the name of an interface");
}

bool parse_end(LineCursor& cursor) noexcept {
  if (cursor.is_at_end()) return true;
  if (!cursor.take_blanks()) return cursor.fail("a hexadecimal digit, a blank or the line's end");
  if (cursor.is_at_end()) return true;
  constexpr std::string_view kDirections = "RTrt";
  if (kDirections.find(cursor.peek()) == std::string_view::npos) {
    return cursor.fail("R, T or the line's end");
  }
  cursor.skip();
  return cursor.is_at_end() || cursor.fail("the line's end");
}

bool parse_record(LineCursor& cursor, CandumpRecord& record) noexcept {
  record.frame = {};
  return parse_stamp(cursor, record.frame.stamp) &&
         (cursor.take_blanks() || cursor.fail("a blank and the name of an interface")) &&
         parse_interface_name(cursor, record.interface_name) &&
         (cursor.take_blanks() || cursor.fail("a blank and an identifier")) &&
         parse_frame(cursor, record.frame) && parse_end(cursor);
}

/// Writes into a span that was checked to be long enough.
class LineWriter {
 public:
  explicit LineWriter(std::span<char> out) noexcept : begin_(out.data()), at_(out.data()) {}

  void put(char character) noexcept { *at_++ = character; }
  void put(std::string_view text) noexcept {
    std::memcpy(at_, text.data(), text.size());
    at_ += text.size();
  }
  void put_decimal(std::int64_t value, std::size_t digits) noexcept {
    for (std::size_t n = digits; n-- > 0; value /= 10) at_[n] = static_cast<char>('0' + value % 10);
    at_ += digits;
  }
  void put_hex(std::uint32_t value, std::size_t digits) noexcept {
    for (std::size_t n = digits; n-- > 0; value >>= 4) at_[n] = "0123456789ABCDEF"[value & 0xF];
    at_ += digits;
  }
  [[nodiscard]] std::size_t size() const noexcept { return static_cast<std::size_t>(at_ - begin_); }

 private:
  char* begin_;
  char* at_;
};

bool can_be_written(const CanFrame& frame, std::string_view interface_name) noexcept {
  return is_well_formed(frame) && frame.stamp.time_since_epoch().count() >= 0 &&
         frame.stamp.time_since_epoch() < std::chrono::seconds(kLastSecond + 1) &&
         !interface_name.empty() && interface_name.size() <= kLongestInterfaceName &&
         std::all_of(interface_name.begin(), interface_name.end(), is_name_character);
}

}  // namespace

CandumpStatus parse_candump_line(std::string_view line, CandumpRecord& record,
                                 CandumpProblem& problem) noexcept {
  while (!line.empty() && (is_blank(line.back()) || line.back() == '\r')) line.remove_suffix(1);
  LineCursor cursor(line);
  cursor.take_blanks();
  if (cursor.is_at_end() || cursor.is_at('#')) return CandumpStatus::kBlank;
  if (parse_record(cursor, record)) return CandumpStatus::kRecord;
  problem = cursor.problem();
  return CandumpStatus::kMalformed;
}

std::size_t format_candump_line(const CanFrame& frame, std::string_view interface_name,
                                std::span<char> out) noexcept {
  if (!can_be_written(frame, interface_name)) return 0;
  std::array<char, kLongestCandumpLine> line;
  LineWriter writer(line);
  const std::int64_t stamp_us =
      std::chrono::duration_cast<std::chrono::microseconds>(frame.stamp.time_since_epoch()).count();
  writer.put('(');
  writer.put_decimal(stamp_us / 1'000'000, 10);  // enough for every Timestamp
  writer.put('.');
  writer.put_decimal(stamp_us % 1'000'000, 6);
  writer.put(") ");
  writer.put(interface_name);
  writer.put(' ');
  const bool is_long = frame.is_extended || frame.is_error;
  writer.put_hex(frame.id | (frame.is_error ? kErrorFlag : 0u),
                 is_long ? kExtendedIdDigits : kStandardIdDigits);
  writer.put('#');
  if (frame.is_fd) {
    writer.put('#');
    writer.put_hex((frame.is_bit_rate_switched ? kBitRateSwitch : 0u) |
                       (frame.is_error_state ? kErrorStateIndicator : 0u),
                   1);
  }
  if (frame.is_remote) {
    writer.put('R');
    if (frame.length > 0) writer.put_hex(frame.length, 1);
  } else {
    for (const std::uint8_t byte : frame.payload()) writer.put_hex(byte, 2);
  }
  writer.put('\n');
  if (writer.size() > out.size()) return 0;
  std::memcpy(out.data(), line.data(), writer.size());
  return writer.size();
}

CandumpReader::CandumpReader(int fd) : lines_(fd, kLongestLine) {}

CandumpReader::Status CandumpReader::next(CandumpRecord& record, CandumpProblem& problem) noexcept {
  for (;;) {
    std::string_view line;
    switch (lines_.next(line)) {
      case LineReader::Status::kEnd:
        return Status::kEnd;
      case LineReader::Status::kFailed:
        return Status::kFailed;
      case LineReader::Status::kTooLong:
        problem = {kLongestLine + 1, "the line's end"};
        return Status::kMalformed;
      case LineReader::Status::kLine:
        break;
    }
    switch (parse_candump_line(line, record, problem)) {
      case CandumpStatus::kRecord:
        return Status::kRecord;
      case CandumpStatus::kMalformed:
        return Status::kMalformed;
      case CandumpStatus::kBlank:
        break;
    }
  }
}

}  // namespace faultline
