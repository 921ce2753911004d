#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace faultline {

/// LCM cannot be listened to (exit code 3).
class MessageSourceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A message that came over live LCM. Views, valid during the call they are handed to.
struct LiveMessage {
  std::string_view channel;
  std::int64_t utime = 0;              ///< when it was received, µs since 1970
  std::span<const std::uint8_t> data;  ///< encoded, from outside: not to be trusted
};

/// Messages from live LCM. liblcm reads its socket on a thread of its own, and here hands over what
/// it has queued. It never says that a message was lost: their own sequence numbers do.
class LcmSource {
 public:
  /// Messages that wait for `receive` at most; liblcm's own 30 are gone in 30 ms of a 1 kHz bench.
  static constexpr int kQueue = 65536;

  /// @param channels regular expression that a channel's whole name must match
  /// @param queue messages that wait for `receive` at most
  /// @throws std::invalid_argument the URL does not read as one to listen to;
  /// @throws MessageSourceError it cannot be opened, with what to do.
  LcmSource(const std::string& url, const std::string& channels, int queue = kQueue);
  ~LcmSource();
  LcmSource(const LcmSource&) = delete;
  LcmSource& operator=(const LcmSource&) = delete;

  /// Waits up to `timeout` for a message, then hands over those that are there, up to kBatch.
  /// @return how many. @throws MessageSourceError; whatever `on_message` throws.
  std::size_t receive(std::chrono::milliseconds timeout,
                      const std::function<void(const LiveMessage&)>& on_message);
  static constexpr std::size_t kBatch = 256;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace faultline
