#include "tools/can/bus_load.h"

#include <algorithm>
#include <chrono>

#include "drivers/can/frame_bits.h"

namespace faultline {

void BusLoad::add(const CanFrame& frame) {
  if (!first_) first_ = frame.stamp;
  first_ = std::min(*first_, frame.stamp);
  last_ = std::max(last_.value_or(frame.stamp), frame.stamp);
  if (frame.is_error) return;
  if (frame.bus >= loads_.size()) {
    loads_.resize(frame.bus + std::size_t{1});
    second_s_.resize(loads_.size());
    current_second_.resize(loads_.size());
  }
  const FrameBits bits = frame_bits(frame);
  const double time_s =
      std::chrono::duration<double>(frame_time(bits, rates_.nominal, rates_.data)).count();
  const std::int64_t second =
      std::chrono::floor<std::chrono::seconds>(frame.stamp - *first_).count();
  Load& load = loads_[frame.bus];
  if (second != current_second_[frame.bus]) {
    current_second_[frame.bus] = second;
    second_s_[frame.bus] = 0.0;
  }
  second_s_[frame.bus] += time_s;
  load.peak_second_s = std::max(load.peak_second_s, second_s_[frame.bus]);
  load.busy_s += time_s;
  ++load.frames;
}

double BusLoad::span_s() const noexcept {
  return first_ ? std::chrono::duration<double>(*last_ - *first_).count() : 0.0;
}

}  // namespace faultline
