#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can/can_bus.h"
#include "drivers/can/can_frame.h"
#include "drivers/can/input_backlog.h"

namespace faultline {

/// When to end listening; nothing given: at SIGINT or SIGTERM.
struct SessionLimits {
  std::optional<double> seconds;
  std::optional<std::uint64_t> frames;
  std::optional<double> idle_s{};  ///< no frame for so long
};

/// Names of the buses of a list as candump would write them: "vcan0" of "can:vcan0", "udp1" of a
/// UDP group that is the second. @throws std::invalid_argument as split_bus_names.
[[nodiscard]] std::vector<std::string> short_bus_names(std::string_view list);

/// What an endpoint counted, for people: "received 10, dropped 0, malformed 0", and error frames,
/// bus-offs, restarts and outages where there were any.
[[nodiscard]] std::string counters_text(const BusCounters& counters);

/// Listens to one or more buses until a limit or a signal. Outages, and at the end what the kernel
/// lost before the sockets, are told on stderr.
class BusSession {
 public:
  /// @param names each as open_bus takes it. @throws as open_bus.
  explicit BusSession(const std::vector<std::string>& names);

  /// Lets only these through (CanBus::set_filters). @throws BusError.
  void set_filters(std::span<const IdFilter> filters) { bus_->set_filters(filters); }

  /// Calls `on_frame` for each frame, and `on_pause` whenever there is none for the moment (at
  /// least every kPause). @return how long it listened.
  std::chrono::duration<double> listen(const SessionLimits& limits,
                                       const std::function<void(const CanFrame&)>& on_frame,
                                       const std::function<void()>& on_pause);

  [[nodiscard]] BusCounters counters() const noexcept { return bus_->counters(); }
  /// Packets lost before the sockets since this session began (input_backlog.h).
  [[nodiscard]] std::uint64_t backlog_drops() const { return backlog_.drops(); }
  /// Short name of the bus that a frame came from, as candump would write it: "vcan0", "udp1".
  [[nodiscard]] std::string_view name_of(const CanFrame& frame) const noexcept;
  /// Full names: "can:vcan0".
  [[nodiscard]] const std::vector<std::string>& names() const noexcept { return names_; }

  static constexpr std::chrono::milliseconds kPause{100};

 private:
  void report_outages();

  std::vector<std::string> names_, short_names_;
  std::unique_ptr<CanBus> bus_;
  InputBacklogWatch backlog_;
  bool is_down_ = false;
};

}  // namespace faultline
