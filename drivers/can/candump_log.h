#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

#include "drivers/can/can_frame.h"
#include "drivers/can/line_reader.h"

namespace faultline {

/// One line of a candump log (`candump -L`): frame.stamp is its time, `interface_name` a view into
/// the line.
struct CandumpRecord {
  CanFrame frame;
  std::string_view interface_name;
};

enum class CandumpStatus {
  kRecord,     ///< a frame
  kBlank,      ///< nothing but blanks, or a comment (`#` first)
  kMalformed,  ///< see CandumpProblem
};

/// Why a line is no candump line.
struct CandumpProblem {
  std::size_t column = 1;     ///< from 1, in bytes; one past the line's end where something lacks
  const char* expected = "";  ///< "3 or 8 hexadecimal digits of an identifier, then #"
};

/// Longest line that `format_candump_line` writes, with its newline.
inline constexpr std::size_t kLongestCandumpLine = 256;
/// Longest interface name that `format_candump_line` takes: Linux has no longer ones.
inline constexpr std::size_t kLongestInterfaceName = 15;

/// Reads one line, without its newline (a carriage return at its end is a blank):
///
///   (1436509052.249713) vcan0 123#11223344        classic          (12345678#.. 29 bits)
///   (1436509052.249713) vcan0 123#11.22.33.44     the same, as cansend takes it
///   (1436509052.249713) vcan0 123#R8              remote           (R: length 0)
///   (1436509052.249713) vcan0 123##311223344      FD, flags 3: BRS and ESI
///   (1436509052.249713) vcan0 20000080#00..00     error frame, class 0x80
///
/// Blanks are spaces and tabs, any number; hexadecimal digits of either case. One to nine digits of
/// a fraction of a second. Read over are: a trailing ` R` or ` T` (direction), the raw DLC 9 to F
/// after `_` behind eight bytes, FD flags other than BRS and ESI. The frame is well-formed
/// (`is_well_formed`), its `bus` 0. Does not allocate. `record` and `problem` are written as the
/// status says.
///
/// Source: can-utils, lib.h and lib.c (parse_canframe, sprint_canframe).
[[nodiscard]] CandumpStatus parse_candump_line(std::string_view line, CandumpRecord& record,
                                               CandumpProblem& problem) noexcept;

/// Writes `frame` as one line with its newline; microseconds, as candump and canplayer have them
/// (the rest of the stamp is cut off). Reading the line gives the frame back.
/// @return characters written; 0 if `out` is too small, the name empty, longer than
/// kLongestInterfaceName or with blanks or control characters in it, the stamp not between
/// 1970 and 2262, or the frame not well-formed.
std::size_t format_candump_line(const CanFrame& frame, std::string_view interface_name,
                                std::span<char> out) noexcept;

/// Reads a candump log line by line from a file, a pipe or a terminal, as its lines come; the last
/// one may lack its newline. Memory: one buffer of fixed size, however long a line. A line longer
/// than kLongestLine is malformed; reading goes on behind it. One thread at a time.
class CandumpReader {
 public:
  /// Twenty times the longest line that candump writes.
  static constexpr std::size_t kLongestLine = 4096;

  enum class Status {
    kRecord,     ///< `record` is the next frame
    kMalformed,  ///< line `line_number()` is none, `problem` says why; go on with the next call
    kEnd,        ///< the end of the file
    kFailed,     ///< the system refused to read; `error()` tells
  };

  /// @param fd an open file descriptor, which stays the caller's; blocking.
  explicit CandumpReader(int fd);

  /// The next frame or problem; blank lines and comments are passed over. `record.interface_name`
  /// is valid until the next call. Does not allocate.
  Status next(CandumpRecord& record, CandumpProblem& problem) noexcept;

  /// Of the line that `next` returned last, from 1.
  [[nodiscard]] std::uint64_t line_number() const noexcept { return lines_.line_number(); }
  /// `errno` of the read that failed, else 0.
  [[nodiscard]] int error() const noexcept { return lines_.error(); }

 private:
  LineReader lines_;
};

}  // namespace faultline
