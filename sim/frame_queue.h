#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "drivers/can/can_frame.h"

namespace faultline {

/// A frame on its way through a node's output.
struct QueuedFrame {
  CanFrame frame;
  std::size_t message = 0;    ///< index in the SignalMap
  std::uint32_t copies = 0;   ///< how often more it is sent
  bool is_reordered = false;  ///< it goes behind the next frame of its node
  std::uint32_t due = 0;      ///< the cycle it is held back for
};

/// Frames held back until a later cycle, in the order in which they came. Does not allocate after
/// construction.
class FrameQueue {
 public:
  explicit FrameQueue(std::size_t capacity) { frames_.reserve(capacity); }

  /// @return false if it is full.
  bool push(const QueuedFrame& frame) noexcept {
    if (frames_.size() == frames_.capacity()) return false;
    frames_.push_back(frame);
    return true;
  }
  /// Takes out, and gives to `pass`, the frames that `is_wanted`, oldest first.
  template <class IsWanted, class Pass>
  void release(const IsWanted& is_wanted, const Pass& pass) noexcept {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      if (is_wanted(frames_[i])) {
        pass(frames_[i]);
      } else {
        if (kept != i) frames_[kept] = frames_[i];
        ++kept;
      }
    }
    frames_.resize(kept);
  }
  [[nodiscard]] bool is_empty() const noexcept { return frames_.empty(); }
  [[nodiscard]] std::size_t size() const noexcept { return frames_.size(); }

 private:
  std::vector<QueuedFrame> frames_;
};

}  // namespace faultline
