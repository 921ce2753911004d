#pragma once

#include <string>

#include "drivers/can/bus_socket.h"

namespace faultline {

/// A CAN socket (CAN_RAW), not bound. @throws BusError no CAN in this kernel, no permission.
[[nodiscard]] Socket open_can_socket(const std::string& bus);

/// How an interface stands.
struct InterfaceState {
  int index = 0;        ///< 0: there is no interface of that name
  bool is_can = false;  ///< it is a CAN interface
  bool is_up = false;   ///< administratively
};

/// Asks the kernel. Does not allocate.
[[nodiscard]] InterfaceState read_interface(const std::string& interface_name) noexcept;

/// Index of a CAN interface that is up. @throws BusError there is none, and what to do.
[[nodiscard]] int require_interface(const std::string& bus, const std::string& interface_name);

/// Binds `socket` to the interface. @return false with errno set. Does not allocate.
[[nodiscard]] bool bind_to_interface(const Socket& socket, int interface_index) noexcept;

/// Index of the interface that `socket` is bound to; 0 once that interface is gone.
[[nodiscard]] int bound_interface(const Socket& socket) noexcept;

}  // namespace faultline
