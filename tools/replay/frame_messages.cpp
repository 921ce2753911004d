#include "tools/replay/frame_messages.h"

#include <chrono>

#include "tools/lcm/channels.h"
#include "tools/lcm/frame_message.h"

namespace faultline {

bool FrameMessages::add(std::int64_t at_ns, const CanFrame& frame) {
  const bool belongs = batch_.frames.empty() || (at_ns == at_ns_ && frame.bus == batch_.bus &&
                                                 batch_.frames.size() < kMostFrames);
  const bool goes_on = belongs || flush();
  at_ns_ = at_ns;
  batch_.bus = frame.bus;
  batch_.utime =
      std::chrono::floor<std::chrono::microseconds>(frame.stamp.time_since_epoch()).count();
  batch_.frames.push_back(to_message(frame));
  return goes_on;
}

bool FrameMessages::flush() {
  if (batch_.frames.empty()) return true;
  batch_.frame_count = static_cast<std::int32_t>(batch_.frames.size());
  buffer_.resize(static_cast<std::size_t>(batch_.getEncodedSize()));
  batch_.encode(buffer_.data(), 0, static_cast<int>(buffer_.size()));
  const bool goes_on = on_message_(at_ns_, kCanChannel, buffer_);
  ++batch_.sequence;
  batch_.first_frame += batch_.frame_count;
  batch_.frames.clear();
  return goes_on;
}

}  // namespace faultline
