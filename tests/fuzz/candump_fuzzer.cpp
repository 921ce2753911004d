// Fuzz target: candump text, as single lines and through CandumpReader. Any bytes may come; what is
// taken for a frame must be one, and reading back what is written must change nothing.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include <unistd.h>

#include <sys/mman.h>

#include "drivers/can/candump_log.h"

namespace {

using namespace faultline;

void require(bool holds) {
  if (!holds) std::abort();
}

void check_problem(const CandumpProblem& problem, std::size_t line_length) {
  require(problem.column >= 1 && problem.column <= line_length + 1);
  require(problem.expected != nullptr && *problem.expected != '\0');
}

/// The frame is well-formed, and format → parse → format comes to the same text.
void check_record(const CandumpRecord& record, std::string_view line) {
  const CanFrame& frame = record.frame;
  require(is_well_formed(frame));
  require(frame.bus == 0);
  require(std::all_of(frame.data.begin() + (frame.is_remote ? 0 : frame.length), frame.data.end(),
                      [](std::uint8_t byte) { return byte == 0; }));
  require(record.interface_name.data() >= line.data() &&
          record.interface_name.data() + record.interface_name.size() <= line.data() + line.size());
  std::array<char, kLongestCandumpLine> text;
  const std::size_t size = format_candump_line(frame, record.interface_name, text);
  require((size > 0) == (record.interface_name.size() <= kLongestInterfaceName));
  if (size == 0) return;
  require(text[size - 1] == '\n');
  CandumpRecord again;
  CandumpProblem problem;
  require(parse_candump_line({text.data(), size - 1}, again, problem) == CandumpStatus::kRecord);
  require(same_on_wire(again.frame, frame));
  require(again.interface_name == record.interface_name);
  require(frame.stamp - again.frame.stamp < std::chrono::microseconds(1));
  require(frame.stamp >= again.frame.stamp);
  std::array<char, kLongestCandumpLine> text_again;
  const std::size_t size_again = format_candump_line(again.frame, again.interface_name, text_again);
  require(std::string_view(text.data(), size) == std::string_view(text_again.data(), size_again));
}

void check_line(std::string_view line) {
  CandumpRecord record;
  CandumpProblem problem;
  switch (parse_candump_line(line, record, problem)) {
    case CandumpStatus::kRecord:
      check_record(record, line);
      break;
    case CandumpStatus::kMalformed:
      check_problem(problem, line.size());
      break;
    case CandumpStatus::kBlank:
      break;
  }
}

/// @return lines that were a frame or a problem.
std::size_t count_by_reader(std::string_view text) {
  static const int fd = ::memfd_create("candump", 0);
  require(::ftruncate(fd, 0) == 0 && ::lseek(fd, 0, SEEK_SET) == 0);
  require(::write(fd, text.data(), text.size()) == static_cast<::ssize_t>(text.size()));
  require(::lseek(fd, 0, SEEK_SET) == 0);
  CandumpReader reader(fd);
  CandumpRecord record;
  CandumpProblem problem;
  std::size_t count = 0;
  std::uint64_t last_line = 0;
  for (;;) {
    const CandumpReader::Status status = reader.next(record, problem);
    if (status == CandumpReader::Status::kEnd) return count;
    require(status != CandumpReader::Status::kFailed);
    require(reader.line_number() > last_line);
    last_line = reader.line_number();
    ++count;
    if (status == CandumpReader::Status::kMalformed) {
      check_problem(problem, CandumpReader::kLongestLine);
    } else {
      require(is_well_formed(record.frame));
    }
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  check_line(text);
  std::size_t count = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string_view line = text.substr(begin, end - begin);
    check_line(line);
    CandumpRecord record;
    CandumpProblem problem;
    if (line.size() > CandumpReader::kLongestLine ||
        parse_candump_line(line, record, problem) != CandumpStatus::kBlank) {
      ++count;
    }
    begin = end + 1;
  }
  require(count_by_reader(text) == count);
  return 0;
}
