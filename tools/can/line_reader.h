#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace faultline {

/// Reads a text line by line in bounded memory, from a file or (`-`) from stdin as it comes.
class LineReader {
 public:
  /// Longer lines are cut: no line of a log is anywhere near that long.
  static constexpr std::size_t kLongestLine = std::size_t{1} << 20;

  /// @param on_pause called before each read, which on a pipe may take its time.
  /// @throws std::system_error the file cannot be opened, or is a directory.
  explicit LineReader(
      const std::string& file, std::function<void()> on_pause = [] {});
  ~LineReader();
  LineReader(const LineReader&) = delete;
  LineReader& operator=(const LineReader&) = delete;

  /// The first bytes of what is still to be read, up to `count`, without reading them.
  [[nodiscard]] std::string_view peek(std::size_t count);

  /// The next line without its end (LF or CR LF), valid until the next call; nothing at the end.
  /// @throws std::system_error reading failed.
  [[nodiscard]] std::optional<std::string_view> next();

  /// Number of the line that `next` returned last, from 1.
  [[nodiscard]] std::size_t line() const noexcept { return line_; }
  /// Whether it was longer than kLongestLine, and cut there.
  [[nodiscard]] bool is_cut() const noexcept { return is_cut_; }
  /// Name for messages: the file's, or "stdin".
  [[nodiscard]] const std::string& source() const noexcept { return source_; }

 private:
  /// Reads more behind what is there. @return false at the end of the file.
  bool fill();
  void skip_rest_of_line();

  std::string source_;
  std::function<void()> on_pause_;
  int fd_ = -1;
  std::vector<char> buffer_;
  std::size_t begin_ = 0, end_ = 0;  ///< what is read and not yet returned
  std::size_t line_ = 0;
  bool is_at_end_ = false;
  bool is_cut_ = false;
};

}  // namespace faultline
