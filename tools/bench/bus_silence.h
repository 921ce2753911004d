#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

namespace faultline {

/// The watchdog of a run in real time: says once that a bus has fallen silent, and once that it is
/// back. By the wall clock, and so no part of the diagnosis, which is a function of the frames.
class BusSilence {
 public:
  using Time = std::chrono::steady_clock::time_point;

  /// Silent is a bus without a frame for 20 periods, and for half a second at least.
  explicit BusSilence(std::chrono::nanoseconds period);

  /// @param received frames so far. @return what there is to say; nothing most of the time.
  [[nodiscard]] std::optional<std::string> look(std::uint64_t received, Time now);

 private:
  std::chrono::nanoseconds limit_;
  std::uint64_t received_ = 0;
  std::optional<Time> last_;  ///< when the number of frames was last seen to grow
  bool is_silent_ = false;
};

}  // namespace faultline
