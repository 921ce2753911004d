#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include <faultline/can_t.hpp>

#include "drivers/can/can_frame.h"

namespace faultline {

/// Frames of a log as FAULTLINE_CAN messages: those of one stamp and one bus together, so that each
/// can be sent at its own time.
class FrameMessages {
 public:
  using OnMessage = std::function<bool(std::int64_t at_ns, std::string_view channel,
                                       std::span<const std::uint8_t> data)>;
  explicit FrameMessages(OnMessage on_message) : on_message_(std::move(on_message)) {}

  /// @return false: enough.
  bool add(std::int64_t at_ns, const CanFrame& frame);
  bool flush();

 private:
  static constexpr std::size_t kMostFrames = 64;

  OnMessage on_message_;
  can_t batch_{};
  std::int64_t at_ns_ = 0;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace faultline
