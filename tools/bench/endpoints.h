#pragma once

#include <memory>
#include <string>

#include "drivers/can/can_bus.h"
#include "drivers/can/loop_bus.h"
#include "drivers/signal/signal_map.h"
#include "sim/frame_faults.h"

namespace faultline {

/// The three nodes' places on one bus. Each lets through only the messages its node reads.
struct Endpoints {
  std::unique_ptr<LoopBus> loop;  ///< the bus itself where it is in-process, else null
  std::unique_ptr<CanBus> plant, controller, diagnosis;
  std::unique_ptr<CanBus> probe;  ///< hears what the diagnosis hears; null where none was asked for
};

/// What a bench runs on, for help and messages.
inline constexpr char kBusNamesHelp[] =
    "loop (in-process), can:IFACE (SocketCAN), udp:GROUP:PORT (python-can's udp_multicast), or "
    "several of the latter two with commas between them";

/// One node's place on `bus`, where the other nodes are other processes.
/// @throws BusError it cannot be opened; std::invalid_argument it is none that others can be on.
[[nodiscard]] std::unique_ptr<CanBus> open_node(const std::string& bus, const SignalMap& map,
                                                BenchNode node);

/// Whether `bus` reads as "loop" or as what `open_bus` opens.
[[nodiscard]] bool is_bus_name(const std::string& bus) noexcept;

/// Opens `bus`: "loop", or what `open_bus` opens. Of several buses the nodes send on the first.
/// @throws BusError it cannot be opened; std::invalid_argument no such kind of bus.
[[nodiscard]] Endpoints open_endpoints(const std::string& bus, const SignalMap& map,
                                       bool has_probe = false);

}  // namespace faultline
