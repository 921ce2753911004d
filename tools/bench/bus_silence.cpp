#include "tools/bench/bus_silence.h"

#include <algorithm>

#include <fmt/format.h>

namespace faultline {

BusSilence::BusSilence(std::chrono::nanoseconds period)
    : limit_(std::max<std::chrono::nanoseconds>(20 * period, std::chrono::milliseconds(500))) {}

std::optional<std::string> BusSilence::look(std::uint64_t received, Time now) {
  if (!last_) last_ = now;
  const std::chrono::duration<double> silence = now - *last_;
  if (received != received_) {
    received_ = received;
    last_ = now;
    if (!is_silent_) return std::nullopt;
    is_silent_ = false;
    return fmt::format("bus is back: a frame came after {:.2f} s", silence.count());
  }
  if (is_silent_ || silence <= limit_) return std::nullopt;
  is_silent_ = true;
  return fmt::format("bus silent: no frame for {:.2f} s", silence.count());
}

}  // namespace faultline
