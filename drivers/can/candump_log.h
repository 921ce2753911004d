#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

#include "drivers/can/can_frame.h"

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
  std::size_t column = 1;     ///< from 1, in bytes
  const char* expected = "";  ///< "a hexadecimal identifier"
};

/// Longest line that `format_candump_line` writes, with its newline.
inline constexpr std::size_t kLongestCandumpLine = 256;

/// Reads one line, without its newline (a carriage return at its end is a blank):
///
///   (1436509052.249713) vcan0 123#11223344        classic          (12345678#.. 29 bits)
///   (1436509052.249713) vcan0 123#R8              remote           (R: length 0)
///   (1436509052.249713) vcan0 123##311223344      FD, flags 3: BRS and ESI
///   (1436509052.249713) vcan0 20000080#00..00     error frame, class 0x80
///
/// One to nine digits of a fraction of a second; a trailing ` R` or ` T` and a DLC after `_` are
/// read over. Does not allocate. `record` and `problem` are written as the status says.
[[nodiscard]] CandumpStatus parse_candump_line(std::string_view line, CandumpRecord& record,
                                               CandumpProblem& problem) noexcept;

/// Writes `frame` as one line with its newline; microseconds, as candump and canplayer have them.
/// @return characters written; 0 if `out` is too small or the name longer than 15 characters.
std::size_t format_candump_line(const CanFrame& frame, std::string_view interface_name,
                                std::span<char> out) noexcept;

}  // namespace faultline
