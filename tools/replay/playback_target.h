#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "tools/replay/playback_queue.h"

namespace faultline {

/// Where a playback goes.
class PlaybackTarget {
 public:
  virtual ~PlaybackTarget() = default;
  /// Sends an item. @return how many of its units (frames; a message) were taken.
  virtual std::size_t send(const PlaybackChunk& chunk, const PlaybackItem& item) noexcept = 0;
  /// What it said when it refused one, for people; empty: it never did.
  [[nodiscard]] virtual std::string refusal() const = 0;
};

/// Buses as open_bus takes them: items are frames. @throws BusError, std::invalid_argument.
[[nodiscard]] std::unique_ptr<PlaybackTarget> open_bus_target(const std::string& buses);

/// Live LCM: items are messages. @throws MessageSinkError, std::invalid_argument.
[[nodiscard]] std::unique_ptr<PlaybackTarget> open_lcm_target(const std::string& url);

}  // namespace faultline
