#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

namespace faultline {

/// Reads a text line by line from a file, a pipe or a terminal, as its lines come; the last one may
/// lack its newline. Memory: one buffer of fixed size, however long a line. One thread at a time.
class LineReader {
 public:
  enum class Status {
    kLine,
    kTooLong,  ///< a line of more than `longest_line` bytes was passed over
    kEnd,      ///< the end of the file
    kFailed,   ///< the system refused to read; `error()` tells
  };

  /// @param fd an open file descriptor, which stays the caller's; blocking.
  LineReader(int fd, std::size_t longest_line);

  /// The next line without its newline, valid until the next call. Does not allocate.
  Status next(std::string_view& line) noexcept;

  /// Whether `next` has a line to return without reading, which on a pipe may take its time.
  [[nodiscard]] bool has_line() const noexcept;

  /// Up to `count` bytes of what comes next, without taking them; fewer at the end of the file.
  /// Waits for them.
  [[nodiscard]] std::string_view peek(std::size_t count) noexcept;

  /// Of the line that `next` returned last, from 1.
  [[nodiscard]] std::uint64_t line_number() const noexcept { return line_number_; }
  /// `errno` of the read that failed, else 0.
  [[nodiscard]] int error() const noexcept { return error_; }

 private:
  /// Reads more behind what is unread. @return false at the end, or if the system refused.
  bool fill() noexcept;

  int fd_;
  int error_ = 0;
  bool is_at_end_ = false;
  std::uint64_t line_number_ = 0;
  std::size_t longest_line_;
  std::vector<char> buffer_;
  std::size_t begin_ = 0, end_ = 0;  ///< what has been read and not yet been returned
};

}  // namespace faultline
