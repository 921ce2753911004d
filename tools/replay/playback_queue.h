#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <vector>

#include "drivers/can/can_frame.h"

namespace faultline {

/// What is sent at one time: frames of one stamp, or one message.
struct PlaybackItem {
  std::int64_t at_ns = 0;     ///< since the begin of the playback, at the log's own pace
  std::uint32_t begin = 0;    ///< first frame in `frames`, or first byte of the message in `bytes`
  std::uint32_t count = 0;    ///< of frames or bytes
  std::uint32_t channel = 0;  ///< messages: where the channel's name begins in `bytes`, with a NUL
};

/// Items read ahead, and all that is needed to send them.
struct PlaybackChunk {
  std::vector<PlaybackItem> items;
  std::vector<CanFrame> frames;
  std::vector<std::uint8_t> bytes;

  void clear() noexcept {
    items.clear();
    frames.clear();
    bytes.clear();
  }
};

/// Chunks from the thread that reads a log to the one that plays it. Chunks come back and are
/// filled again, so that a long playback does not allocate.
class PlaybackQueue {
 public:
  /// Chunks read ahead at most.
  static constexpr std::size_t kCapacity = 16;

  /// Reader: an empty chunk, once there is room for it. Nothing if the playback was stopped.
  std::optional<PlaybackChunk> take_empty();
  /// Reader: a filled one.
  void push(PlaybackChunk chunk);
  /// Reader: there are no more.
  void finish();

  /// Player: gives the last chunk back and takes the next, waiting for it. Nothing at the end, or
  /// when it was stopped.
  std::optional<PlaybackChunk> next(PlaybackChunk done);
  /// Anyone: ends both sides.
  void stop();

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<PlaybackChunk> filled_;
  std::vector<PlaybackChunk> empty_;
  bool is_finished_ = false;
  bool is_stopped_ = false;
};

}  // namespace faultline
