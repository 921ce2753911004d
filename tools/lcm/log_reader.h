#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tools/lcm/log_event.h"

namespace faultline {

/// A stretch of a log that holds no event that can be read.
struct LogDamage {
  std::uint64_t offset = 0;  ///< its first byte
  std::uint64_t bytes = 0;
  std::string what;     ///< "an event is cut off", "no event begins here"
  bool is_end = false;  ///< it reaches to the end of the log
};

/// "FILE: byte 1200: an event that is cut off; 80 bytes passed over".
[[nodiscard]] std::string describe(const std::string& file, const LogDamage& damage);

/// Reads an LCM log, ours or lcm-logger's, event by event, whatever is wrong with it: what is no
/// event is passed over to the next one that is whole (its lengths lead to another event, or to the
/// end, or to damage with no event before it), and listed as damage. An LCM log has no checksums:
/// what changed inside a payload, or was put into one, shows only where the message is decoded.
/// Time: linear in the log's length, damaged or not. Memory: a buffer of a megabyte, more only for
/// longer events and for damage that claims to be some (a few times kLongestMessage).
class LogReader {
 public:
  /// Longest channel name and message taken for real; liblcm writes 63 and far below a megabyte.
  static constexpr std::size_t kLongestChannel = 255;
  static constexpr std::size_t kLongestMessage = std::size_t{64} << 20;

  /// @param file "-": stdin.
  /// @throws std::system_error it cannot be read; std::invalid_argument no event begins in its
  ///   first megabyte: it is no LCM log.
  explicit LogReader(const std::filesystem::path& file);
  ~LogReader();
  LogReader(const LogReader&) = delete;
  LogReader& operator=(const LogReader&) = delete;

  /// The next event, valid until the next call; nullptr at the end.
  /// @throws std::system_error the system failed to read.
  [[nodiscard]] const LogEvent* next();

  /// What was passed over so far.
  [[nodiscard]] const std::vector<LogDamage>& damages() const noexcept { return damages_; }
  [[nodiscard]] const std::string& name() const noexcept { return name_; }
  /// Bytes of the log read so far, and in all if that is known (a file's).
  [[nodiscard]] std::uint64_t position() const noexcept { return offset_; }
  [[nodiscard]] std::optional<std::uint64_t> size() const noexcept { return size_; }

 private:
  /// The lengths of an event that seems to begin `at` bytes behind the position.
  struct Header {
    std::size_t channel_bytes = 0, data_bytes = 0;
    [[nodiscard]] std::size_t total() const noexcept;
  };

  /// Whether `count` bytes are there; reads until they are or the log ends.
  bool has(std::size_t count);
  [[nodiscard]] const std::uint8_t* at(std::size_t index) const noexcept {
    return buffer_.data() + begin_ + index;
  }
  [[nodiscard]] std::size_t held() const noexcept { return end_ - begin_; }
  void consume(std::size_t count) noexcept;

  [[nodiscard]] std::optional<Header> header_at(std::size_t index);
  [[nodiscard]] bool is_magic_at(std::size_t index) const noexcept;
  /// Whether an event begins there, is whole, and is followed by another or the end.
  [[nodiscard]] bool is_event_at(std::size_t index);
  /// Whether all of the event is there and its channel has a name that could be one.
  [[nodiscard]] bool is_plausible_at(std::size_t index, const Header& header);
  /// Index of the first magic, or event, that begins in [from, until).
  [[nodiscard]] std::optional<std::size_t> find_magic(std::size_t from, std::size_t until);
  [[nodiscard]] std::optional<std::size_t> find_event(std::size_t from, std::size_t until);
  void skip_damage();

  std::string name_;
  int fd_ = -1;
  std::optional<std::uint64_t> size_;
  std::vector<std::uint8_t> buffer_;
  std::size_t begin_ = 0, end_ = 0;  ///< what has been read and not been returned
  bool is_at_end_ = false;
  std::uint64_t offset_ = 0;     ///< of begin_ in the log
  std::size_t event_bytes_ = 0;  ///< of the event returned last, still in the buffer
  LogEvent event_;
  std::vector<LogDamage> damages_;
};

}  // namespace faultline
