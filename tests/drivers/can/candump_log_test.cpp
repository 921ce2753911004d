#include "drivers/can/candump_log.h"

#include <array>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <unistd.h>

#include <gtest/gtest.h>
#include <sys/mman.h>

#include "tests/support/allocation_guard.h"
#include "tests/support/random_can_frame.h"

namespace faultline {
namespace {

using namespace std::chrono_literals;

CandumpRecord parse(std::string_view line) {
  CandumpRecord record;
  CandumpProblem problem;
  EXPECT_EQ(parse_candump_line(line, record, problem), CandumpStatus::kRecord)
      << line << ": column " << problem.column << ", expected " << problem.expected;
  EXPECT_TRUE(is_well_formed(record.frame)) << line;
  return record;
}

/// "7: expected a decimal point", or "" if the line is none that is wrong.
std::string problem_of(std::string_view line) {
  CandumpRecord record;
  CandumpProblem problem;
  if (parse_candump_line(line, record, problem) != CandumpStatus::kMalformed) return "";
  EXPECT_GE(problem.column, 1u) << line;
  EXPECT_LE(problem.column, line.size() + 1) << line;
  return std::to_string(problem.column) + ": expected " + problem.expected;
}

std::string format(const CanFrame& frame, std::string_view name = "vcan0") {
  std::array<char, kLongestCandumpLine> out;
  return {out.data(), format_candump_line(frame, name, out)};
}

CanFrame data_frame(std::uint32_t id, const std::vector<std::uint8_t>& data) {
  CanFrame frame;
  frame.id = id;
  frame.length = static_cast<std::uint8_t>(data.size());
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

Timestamp at(std::chrono::nanoseconds since_1970) { return Timestamp(since_1970); }

TEST(CandumpLog, ReadsAClassicFrame) {
  const CandumpRecord record = parse("(1436509052.249713) vcan0 123#11223344");
  EXPECT_EQ(record.interface_name, "vcan0");
  EXPECT_EQ(record.frame.stamp, at(1436509052s + 249713us));
  EXPECT_TRUE(same_on_wire(record.frame, data_frame(0x123, {0x11, 0x22, 0x33, 0x44})));
  EXPECT_EQ(record.frame.bus, 0);
}

TEST(CandumpLog, ReadsTheIdentifiersFormatFromItsDigits) {
  EXPECT_FALSE(parse("(1.0) can0 7FF#").frame.is_extended);
  const CanFrame extended = parse("(1.0) can0 00000123#").frame;
  EXPECT_TRUE(extended.is_extended);
  EXPECT_EQ(extended.id, 0x123u);
  EXPECT_EQ(parse("(1.0) can0 1FFFFFFF#").frame.id, kMaxExtendedId);
}

TEST(CandumpLog, ReadsRemoteFramesWithAndWithoutLength) {
  const CanFrame without = parse("(1.0) can0 123#R").frame;
  EXPECT_TRUE(without.is_remote);
  EXPECT_EQ(without.length, 0);
  const CanFrame with = parse("(1.0) can0 1234567A#r8").frame;
  EXPECT_TRUE(with.is_remote && with.is_extended);
  EXPECT_EQ(with.length, 8);
}

TEST(CandumpLog, ReadsFdFramesWithTheirFlags) {
  const CanFrame frame = parse("(1.0) can0 123##311223344").frame;
  EXPECT_TRUE(frame.is_fd && frame.is_bit_rate_switched && frame.is_error_state);
  EXPECT_EQ(frame.length, 4);
  EXPECT_FALSE(parse("(1.0) can0 123##0").frame.is_bit_rate_switched);
  EXPECT_TRUE(parse("(1.0) can0 123##1").frame.is_bit_rate_switched);
  EXPECT_TRUE(parse("(1.0) can0 123##2").frame.is_error_state);
  // Newer kernels mark FD frames with a flag of their own, 4.
  EXPECT_TRUE(same_on_wire(parse("(1.0) can0 123##5AA").frame, parse("(1.0) can0 123##1AA").frame));
  EXPECT_EQ(parse("(1.0) can0 123##0" + std::string(128, 'a')).frame.length, 64);
}

TEST(CandumpLog, ReadsErrorFramesAsTheirClass) {
  const CanFrame frame = parse("(1.0) can0 20000080#0000000000000000").frame;
  EXPECT_TRUE(frame.is_error);
  EXPECT_FALSE(frame.is_extended);
  EXPECT_EQ(frame.id, 0x80u);
  EXPECT_EQ(frame.length, 8);
  EXPECT_EQ(parse("(1.0) can0 3FFFFFFF#").frame.id, kMaxExtendedId);
}

TEST(CandumpLog, ReadsOverTheRawDlcBehindEightBytes) {
  const CanFrame frame = parse("(1.0) can0 123#1122334455667788_9").frame;
  EXPECT_TRUE(same_on_wire(frame, parse("(1.0) can0 123#1122334455667788").frame));
  EXPECT_EQ(parse("(1.0) can0 123#1122334455667788_f R").frame.length, 8);
  EXPECT_EQ(parse("(1.0) can0 123#R8_E").frame.length, 8);
  EXPECT_EQ(problem_of("(1.0) can0 123#11_9"),
            "18: expected a hexadecimal digit, a blank or the line's end");
  EXPECT_EQ(problem_of("(1.0) can0 123#1122334455667788_8"), "33: expected a raw DLC from 9 to F");
  EXPECT_EQ(problem_of("(1.0) can0 123#1122334455667788_"), "33: expected a raw DLC from 9 to F");
}

TEST(CandumpLog, ReadsDotsBetweenBytesAsCansendDoes) {
  EXPECT_TRUE(
      same_on_wire(parse("(1.0) can0 123#11.22.33").frame, data_frame(0x123, {0x11, 0x22, 0x33})));
  EXPECT_EQ(parse("(1.0) can0 123##01122.33").frame.length, 3);
}

TEST(CandumpLog, ReadsDirectionsBlanksCarriageReturnsAndBothCases) {
  const CanFrame plain = parse("(1.5) can0 1ab#deadBEEF").frame;
  for (const char* line :
       {"(1.5) can0 1AB#DEADBEEF R", "(1.5) can0 1AB#DEADBEEF T", "(1.5) can0 1AB#DEADBEEF\r",
        "(1.5)\tcan0\t\t1AB#DEADBEEF \t", "  (1.5)   can0  1AB#deadbeef  t \r"}) {
    EXPECT_TRUE(same_on_wire(parse(line).frame, plain)) << line;
    EXPECT_EQ(parse(line).interface_name, "can0") << line;
  }
}

TEST(CandumpLog, ReadsOneToNineDigitsOfAFraction) {
  EXPECT_EQ(parse("(0.1) a 1FF#").frame.stamp, at(100ms));
  EXPECT_EQ(parse("(0.000001) a 1FF#").frame.stamp, at(1us));
  EXPECT_EQ(parse("(7.123456789) a 1FF#").frame.stamp, at(7s + 123456789ns));
  EXPECT_EQ(parse("(0000000007.5) a 1FF#").frame.stamp, at(7s + 500ms));
  EXPECT_EQ(problem_of("(7.1234567890) a 1FF#"),
            "13: expected ) after at most nine digits of a fraction");
}

TEST(CandumpLog, TellsBlankLinesAndCommentsFromFrames) {
  for (const char* line : {"", " ", "\t \r", "\r", "# a comment", "  #(1.0) can0 123#"}) {
    CandumpRecord record;
    CandumpProblem problem;
    EXPECT_EQ(parse_candump_line(line, record, problem), CandumpStatus::kBlank) << line;
  }
}

TEST(CandumpLog, SaysWhereALineIsWrongAndWhatWasExpected) {
  EXPECT_EQ(problem_of("123#"), "1: expected ( and seconds since 1970");
  EXPECT_EQ(problem_of("("), "2: expected decimal digits of seconds since 1970");
  EXPECT_EQ(problem_of("(-1.0) can0 123#"), "2: expected decimal digits of seconds since 1970");
  EXPECT_EQ(problem_of("(12"), "4: expected a decimal point and a fraction of a second");
  EXPECT_EQ(problem_of("(12)"), "4: expected a decimal point and a fraction of a second");
  EXPECT_EQ(problem_of("(1.) can0 123#"), "4: expected one to nine decimal digits");
  EXPECT_EQ(problem_of("(1.0 can0 123#"), "5: expected )");
  EXPECT_EQ(problem_of("(1.0)can0 123#"), "6: expected a blank and the name of an interface");
  EXPECT_EQ(problem_of("(1.0)"), "6: expected a blank and the name of an interface");
  EXPECT_EQ(problem_of("(1.0) can0"), "11: expected a blank and an identifier");
  EXPECT_EQ(problem_of("(1.0) \x01 123#"), "7: expected the name of an interface");
  constexpr const char* kIdentifier =
      ": expected 3 or 8 hexadecimal digits of an identifier, then #";
  EXPECT_EQ(problem_of("(1.0) can0 12#"), std::string("14") + kIdentifier);
  EXPECT_EQ(problem_of("(1.0) can0 1234#"), std::string("16") + kIdentifier);
  EXPECT_EQ(problem_of("(1.0) can0 123456789#"), std::string("20") + kIdentifier);
  EXPECT_EQ(problem_of("(1.0) can0 123"), std::string("15") + kIdentifier);
  EXPECT_EQ(problem_of("(1.0) can0 12G#"), std::string("14") + kIdentifier);
  EXPECT_EQ(problem_of("(1.0) can0 800#"), "12: expected an 11-bit identifier, at most 7FF");
  EXPECT_EQ(problem_of("(1.0) can0 40000000#"),
            "12: expected a 29-bit identifier, at most 1FFFFFFF (3FFFFFFF for an error frame)");
  EXPECT_EQ(problem_of("(1.0) can0 FFFFFFFF#"),
            "12: expected a 29-bit identifier, at most 1FFFFFFF (3FFFFFFF for an error frame)");
  EXPECT_EQ(problem_of("(1.0) can0 123#1"), "17: expected the second hexadecimal digit of a byte");
  EXPECT_EQ(problem_of("(1.0) can0 123#11 22"), "19: expected R, T or the line's end");
  EXPECT_EQ(problem_of("(1.0) can0 123#112G"),
            "19: expected the second hexadecimal digit of a byte");
  EXPECT_EQ(problem_of("(1.0) can0 123#11."), "19: expected two hexadecimal digits of a byte");
  EXPECT_EQ(problem_of("(1.0) can0 123#11..22"), "19: expected two hexadecimal digits of a byte");
  EXPECT_EQ(problem_of("(1.0) can0 123#.11"),
            "16: expected a hexadecimal digit, a blank or the line's end");
  EXPECT_EQ(problem_of("(1.0) can0 123#112233445566778899"), "32: expected at most 8 bytes");
  EXPECT_EQ(problem_of("(1.0) can0 123##0" + std::string(130, '0')),
            "146: expected at most 64 bytes");
  EXPECT_EQ(problem_of("(1.0) can0 123##"), "17: expected a hexadecimal digit of CAN FD flags");
  EXPECT_EQ(problem_of("(1.0) can0 123#R9"), "17: expected a length from 0 to 8");
  EXPECT_EQ(problem_of("(1.0) can0 123#R11"),
            "18: expected a hexadecimal digit, a blank or the line's end");
  EXPECT_EQ(problem_of("(1.0) can0 20000080#R"), "21: expected the bytes of an error frame");
  EXPECT_EQ(problem_of("(1.0) can0 20000080##0"), "21: expected the bytes of an error frame");
  EXPECT_EQ(problem_of("(1.0) can0 123#11 R x"), "20: expected the line's end");
  EXPECT_EQ(problem_of("(1.0) can0 123#11 X"), "19: expected R, T or the line's end");
  EXPECT_EQ(problem_of(std::string_view("(1.0) can0 123#\0", 16)),
            "16: expected a hexadecimal digit, a blank or the line's end");
}

TEST(CandumpLog, RefusesTimesThatNoStampCanHold) {
  EXPECT_EQ(parse("(9223372035.999999999) a 1FF#").frame.stamp, at(9223372035s + 999999999ns));
  constexpr const char* kTooLate = "2: expected seconds since 1970, at most 9223372035";
  EXPECT_EQ(problem_of("(9223372036.0) a 1FF#"), kTooLate);
  EXPECT_EQ(problem_of("(" + std::string(5000, '9') + ".0) a 1FF#"), kTooLate);
}

TEST(CandumpLog, WritesEveryKindOfFrameAsCandumpDoes) {
  CanFrame frame = data_frame(0x123, {0xDE, 0xAD});
  frame.stamp = at(1436509052s + 249713999ns);
  EXPECT_EQ(format(frame), "(1436509052.249713) vcan0 123#DEAD\n");
  frame.stamp = at(1us);
  frame.is_extended = true;
  EXPECT_EQ(format(frame), "(0000000000.000001) vcan0 00000123#DEAD\n");
  frame.is_fd = frame.is_bit_rate_switched = frame.is_error_state = true;
  EXPECT_EQ(format(frame), "(0000000000.000001) vcan0 00000123##3DEAD\n");
  CanFrame remote;
  remote.id = 7;
  remote.is_remote = true;
  EXPECT_EQ(format(remote), "(0000000000.000000) vcan0 007#R\n");
  remote.length = 8;
  EXPECT_EQ(format(remote), "(0000000000.000000) vcan0 007#R8\n");
  CanFrame error = data_frame(0x80, {0, 1});
  error.is_error = true;
  EXPECT_EQ(format(error), "(0000000000.000000) vcan0 20000080#0001\n");
}

TEST(CandumpLog, WritesNothingThatItCouldNotRead) {
  CanFrame frame = data_frame(0x123, {1, 2});
  const std::string line = format(frame, "fifteen_letters");
  ASSERT_FALSE(line.empty());
  std::vector<char> out(line.size());
  EXPECT_EQ(format_candump_line(frame, "fifteen_letters", out), line.size());
  out.pop_back();
  EXPECT_EQ(format_candump_line(frame, "fifteen_letters", out), 0u);
  EXPECT_EQ(format(frame, "sixteen_letters_"), "");
  EXPECT_EQ(format(frame, ""), "");
  EXPECT_EQ(format(frame, "two words"), "");
  EXPECT_EQ(format(frame, "new\nline"), "");
  frame.stamp = at(-1ns);
  EXPECT_EQ(format(frame), "");
  frame.stamp = Timestamp::max();
  EXPECT_EQ(format(frame), "");
  frame = data_frame(0x800, {});
  EXPECT_EQ(format(frame), "");
}

TEST(CandumpLog, ReadsBackWhateverItWrites) {
  std::mt19937_64 generator(20261122);
  for (int n = 0; n < 100'000; ++n) {
    CanFrame frame = random_can_frame(generator);
    frame.stamp = at(std::chrono::microseconds(generator() % 9'223'372'036'000'000u));
    const std::string line = format(frame, "can" + std::to_string(generator() % 1000));
    ASSERT_FALSE(line.empty()) << n;
    ASSERT_EQ(line.back(), '\n');
    const CandumpRecord record = parse(std::string_view(line).substr(0, line.size() - 1));
    ASSERT_TRUE(same_on_wire(record.frame, frame)) << line;
    ASSERT_EQ(record.frame.stamp, frame.stamp) << line;
    ASSERT_EQ(format(record.frame, record.interface_name), line);
  }
}

TEST(CandumpLog, SurvivesEveryMutationOfAGoodLine) {
  std::mt19937_64 generator(7);
  constexpr std::string_view kLikely = "()#.RT_ \t\r0189AFafx\0\xFF";
  for (int n = 0; n < 300'000; ++n) {
    std::string line = format(random_can_frame(generator));
    line.pop_back();
    for (std::uint64_t changes = 1 + generator() % 3; changes > 0; --changes) {
      const std::size_t place = generator() % (line.size() + 1);
      const char character = kLikely[generator() % kLikely.size()];
      switch (generator() % 3) {
        case 0:
          line.insert(place, 1, character);
          break;
        case 1:
          line.resize(place);
          break;
        default:
          if (place < line.size()) line[place] = character;
      }
    }
    CandumpRecord record;
    CandumpProblem problem;
    const CandumpStatus status = parse_candump_line(line, record, problem);
    if (status == CandumpStatus::kMalformed) {
      ASSERT_GE(problem.column, 1u) << line;
      ASSERT_LE(problem.column, line.size() + 1) << line;
      ASSERT_STRNE(problem.expected, "") << line;
    } else if (status == CandumpStatus::kRecord) {
      ASSERT_TRUE(is_well_formed(record.frame)) << line;
      for (std::size_t k = record.frame.length; k < kMaxPayload; ++k) {
        ASSERT_EQ(record.frame.data[k], 0) << line;
      }
    }
  }
}

TEST(CandumpLog, DoesNotAllocate) {
  const std::string line = "(1436509052.249713) vcan0 123##1" + std::string(128, 'A');
  std::array<char, kLongestCandumpLine> out;
  CandumpRecord record;
  CandumpProblem problem;
  std::size_t written = 0;
  const AllocationGuard guard;
  for (int step = 0; step < 1000; ++step) {
    static_cast<void>(parse_candump_line(line, record, problem));
    written += format_candump_line(record.frame, record.interface_name, out);
    static_cast<void>(parse_candump_line("(1.0) can0 12", record, problem));
  }
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(written, 1000 * (line.size() + 1));
}

/// A file descriptor to read `text` from, written in pieces of `piece` bytes.
class TextPipe {
 public:
  TextPipe(std::string text, std::size_t piece) : text_(std::move(text)) {
    EXPECT_EQ(::pipe(ends_.data()), 0);
    writer_ = std::thread([this, piece] {
      for (std::size_t at = 0; at < text_.size(); at += piece) {
        const std::size_t size = std::min(piece, text_.size() - at);
        if (::write(ends_[1], text_.data() + at, size) != static_cast<ssize_t>(size)) break;
      }
      ::close(ends_[1]);
    });
  }
  ~TextPipe() {
    writer_.join();
    ::close(ends_[0]);
  }
  TextPipe(const TextPipe&) = delete;
  TextPipe& operator=(const TextPipe&) = delete;
  [[nodiscard]] int fd() const { return ends_[0]; }

 private:
  std::string text_;
  std::array<int, 2> ends_{-1, -1};
  std::thread writer_;
};

/// "1 7FF", "3!12" and so on: line number and identifier, or ! and the problem's column.
std::vector<std::string> read_all(const std::string& text, std::size_t piece = 4096) {
  const TextPipe pipe(text, piece);
  CandumpReader reader(pipe.fd());
  CandumpRecord record;
  CandumpProblem problem;
  std::vector<std::string> found;
  for (;;) {
    const CandumpReader::Status status = reader.next(record, problem);
    if (status == CandumpReader::Status::kEnd) return found;
    const std::string line = std::to_string(reader.line_number());
    if (status == CandumpReader::Status::kRecord) {
      found.push_back(line + " " + std::string(record.interface_name) + " " +
                      std::to_string(record.frame.id));
    } else {
      EXPECT_EQ(status, CandumpReader::Status::kMalformed);
      found.push_back(line + "!" + std::to_string(problem.column));
    }
  }
}

using Lines = std::vector<std::string>;

TEST(CandumpReader, ReadsFramesAndReportsProblemsByLineAndGoesOn) {
  const std::string text =
      "(1.0) can0 001#\n"
      "\n"
      "# comment\n"
      "(1.0) can0 xyz#\r\n"
      "(1.0) can1 002#11\r\n"
      "(1.0) can0 003#";  // no newline at the end
  const Lines expected{"1 can0 1", "4!12", "5 can1 2", "6 can0 3"};
  for (const std::size_t piece : {std::size_t{1}, std::size_t{7}, std::size_t{4096}}) {
    EXPECT_EQ(read_all(text, piece), expected) << piece;
  }
  EXPECT_EQ(read_all(""), Lines{});
  EXPECT_EQ(read_all("\n\n"), Lines{});
}

TEST(CandumpReader, PassesOverLinesOfAnyLength) {
  const std::string good = "(1.0) can0 001#\n";
  for (const std::size_t length :
       {CandumpReader::kLongestLine + 1, std::size_t{70'000}, std::size_t{1 << 20}}) {
    const std::string text = good + std::string(length, ' ') + "\n" + good;
    EXPECT_EQ(read_all(text), (Lines{"1 can0 1", "2!4097", "3 can0 1"})) << length;
  }
  EXPECT_EQ(read_all(good + std::string(CandumpReader::kLongestLine, ' ') + "\n" + good),
            (Lines{"1 can0 1", "3 can0 1"}));
  EXPECT_EQ(read_all(std::string(100'000, 'x')), Lines{"1!4097"});
}

TEST(CandumpReader, HandsOutALineAsSoonAsItIsThere) {
  std::array<int, 2> ends{-1, -1};
  ASSERT_EQ(::pipe(ends.data()), 0);
  constexpr std::string_view kLine = "(1.0) can0 001#\n(2.0)";
  ASSERT_EQ(::write(ends[1], kLine.data(), kLine.size()), static_cast<ssize_t>(kLine.size()));
  CandumpReader reader(ends[0]);
  CandumpRecord record;
  CandumpProblem problem;
  EXPECT_EQ(reader.next(record, problem), CandumpReader::Status::kRecord);  // the pipe is open yet
  ::close(ends[1]);
  EXPECT_EQ(reader.next(record, problem), CandumpReader::Status::kMalformed);
  EXPECT_EQ(reader.next(record, problem), CandumpReader::Status::kEnd);
  EXPECT_EQ(reader.next(record, problem), CandumpReader::Status::kEnd);
  ::close(ends[0]);
}

TEST(CandumpReader, SaysWhyItCannotRead) {
  CandumpReader reader(-1);
  CandumpRecord record;
  CandumpProblem problem;
  EXPECT_EQ(reader.next(record, problem), CandumpReader::Status::kFailed);
  EXPECT_EQ(reader.error(), EBADF);
}

TEST(CandumpReader, DoesNotAllocateAfterConstruction) {
  std::string text;
  for (int n = 0; n < 1000; ++n) text += "(1436509052.249713) vcan0 123#1122334455667788\n";
  const int fd = ::memfd_create("candump", 0);
  ASSERT_GE(fd, 0);
  ASSERT_EQ(::write(fd, text.data(), text.size()), static_cast<ssize_t>(text.size()));
  ASSERT_EQ(::lseek(fd, 0, SEEK_SET), 0);
  CandumpReader reader(fd);
  CandumpRecord record;
  CandumpProblem problem;
  std::size_t count = 0;
  const AllocationGuard guard;
  while (reader.next(record, problem) == CandumpReader::Status::kRecord) ++count;
  const auto calls = guard.heap_calls();
  EXPECT_EQ(calls, 0u);
  EXPECT_EQ(count, 1000u);
  ::close(fd);
}

}  // namespace
}  // namespace faultline
