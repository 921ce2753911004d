#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can/can_bus.h"

namespace faultline {

/// An endpoint on the bus that `spec` names:
///
///   can:IFACE          SocketCAN                                 can:vcan0
///   udp:GROUP:PORT     python-can's udp_multicast frames         udp:239.74.163.2:43113
///                                                                udp:[ff15::1]:43113
///   A,B,...            several buses as one (BusGroup): received frames carry the index of theirs
///                      in `bus`, sent ones go to the bus they name
///
/// `loop` is refused: it has no other end outside its LoopBus.
/// @throws std::invalid_argument `spec` is none of these, with what was found and expected;
/// @throws BusError the bus cannot be opened.
[[nodiscard]] std::unique_ptr<CanBus> open_bus(std::string_view spec);

/// Whether `spec` reads as what `open_bus` opens, without opening anything.
/// @throws std::invalid_argument as open_bus.
void check_bus_names(std::string_view spec);

/// The buses of a list, one name each: "can:vcan0,udp:[ff15::1]:43113" gives two.
/// @throws std::invalid_argument one of them is empty.
[[nodiscard]] std::vector<std::string> split_bus_names(std::string_view spec);

}  // namespace faultline
