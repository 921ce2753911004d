#pragma once

#include <memory>
#include <string>

#include "drivers/can/can_bus.h"
#include "drivers/can/loop_bus.h"
#include "drivers/signal/signal_map.h"

namespace faultline {

/// The three nodes' places on one bus. Each lets through only the messages its node reads.
struct Endpoints {
  std::unique_ptr<LoopBus> loop;  ///< the bus itself where it is in-process, else null
  std::unique_ptr<CanBus> plant, controller, diagnosis;
};

/// Whether `bus` reads as "loop" or "can:IFACE".
[[nodiscard]] bool is_bus_name(const std::string& bus) noexcept;

/// Opens `bus`: "loop", or "can:IFACE".
/// @throws BusError it cannot be opened; std::invalid_argument no such kind of bus.
[[nodiscard]] Endpoints open_endpoints(const std::string& bus, const SignalMap& map);

}  // namespace faultline
