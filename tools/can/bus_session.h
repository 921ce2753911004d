#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can/can_bus.h"
#include "drivers/can/can_frame.h"

namespace faultline {

/// When to end listening; nothing given: at SIGINT or SIGTERM.
struct SessionLimits {
  std::optional<double> seconds;
  std::optional<std::uint64_t> frames;
};

/// Listens to one or more buses until a limit or a signal. Outages and bus errors are told on
/// stderr; at the end so is what was lost.
class BusSession {
 public:
  /// @param names each as open_bus takes it. @throws as open_bus.
  explicit BusSession(const std::vector<std::string>& names);

  /// Calls `on_frame` for each frame, and `on_pause` whenever there is none for the moment (at
  /// least every kPause). @return how long it listened.
  std::chrono::duration<double> listen(const SessionLimits& limits,
                                       const std::function<void(const CanFrame&)>& on_frame,
                                       const std::function<void()>& on_pause);

  [[nodiscard]] BusCounters counters() const noexcept { return bus_->counters(); }
  /// Short name of the bus that a frame came from, as candump would write it: "vcan0", "udp1".
  [[nodiscard]] std::string_view name_of(const CanFrame& frame) const noexcept;
  /// Full names: "can:vcan0".
  [[nodiscard]] const std::vector<std::string>& names() const noexcept { return names_; }

  static constexpr std::chrono::milliseconds kPause{100};

 private:
  void report_status(ReceiveStatus status);

  std::vector<std::string> names_, short_names_;
  std::unique_ptr<CanBus> bus_;
  bool is_down_ = false;
};

}  // namespace faultline
