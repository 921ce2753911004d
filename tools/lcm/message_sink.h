#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>

namespace faultline {

/// An LCM transport or log cannot be opened or written (exit code 3).
class MessageSinkError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Takes encoded LCM messages. Not for the diagnosis thread: sinks allocate, lock and write.
class MessageSink {
 public:
  virtual ~MessageSink() = default;
  /// @param utime µs since 1970. @throws MessageSinkError it could not be written.
  virtual void publish(const char* channel, std::int64_t utime,
                       std::span<const std::uint8_t> message) = 0;
  /// What was published is safe from now on (log: handed to the kernel).
  virtual void flush() = 0;
  /// Flushes and closes; nothing may be published afterwards. @throws MessageSinkError.
  virtual void close() = 0;
};

/// @throws std::invalid_argument `file` exists, is not empty and no LCM log: nothing that a log may
///   replace.
void require_replaceable(const std::filesystem::path& file);

/// An LCM log file, in the format of lcm-logger. An existing log at `file` is replaced; a file that
/// is no LCM log is not.
/// @throws MessageSinkError it cannot be written; std::invalid_argument it exists and is no log.
[[nodiscard]] std::unique_ptr<MessageSink> open_log(const std::filesystem::path& file);

/// Live LCM at `url` (e.g. udpm://239.255.76.67:7667?ttl=0).
/// @throws std::invalid_argument the URL does not read as one (lcm_url.h);
/// @throws MessageSinkError it cannot be opened: there is no route for it.
[[nodiscard]] std::unique_ptr<MessageSink> open_live(const std::string& url);

}  // namespace faultline
