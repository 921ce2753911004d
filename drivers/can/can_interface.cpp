#include "drivers/can/can_interface.h"

#include <cerrno>

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include "drivers/can/can_bus.h"

namespace faultline {
namespace {

ifreq request_for(const std::string& interface_name) noexcept {
  ifreq request{};
  interface_name.copy(request.ifr_name, IFNAMSIZ - 1);
  return request;
}

bool is_can_interface(const Socket& socket, const std::string& interface_name) noexcept {
  ifreq request = request_for(interface_name);
  return ::ioctl(socket.fd(), SIOCGIFHWADDR, &request) == 0 &&
         request.ifr_hwaddr.sa_family == ARPHRD_CAN;
}

/// "vcan0, vcan1", or a sentence how to make one.
std::string list_can_interfaces(const Socket& socket) {
  std::string names;
  struct if_nameindex* const interfaces = ::if_nameindex();
  for (const struct if_nameindex* entry = interfaces; entry != nullptr && entry->if_index != 0;
       ++entry) {
    if (!is_can_interface(socket, entry->if_name)) continue;
    if (!names.empty()) names += ", ";
    names += entry->if_name;
  }
  if (interfaces != nullptr) ::if_freenameindex(interfaces);
  if (names.empty()) {
    return "there is no CAN interface at all (make a virtual one: ip link add dev vcan0 type vcan)";
  }
  return "CAN interfaces here: " + names;
}

}  // namespace

Socket open_can_socket(const std::string& bus) {
  Socket socket(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW));
  if (socket.fd() >= 0) return socket;
  const int error = errno;
  switch (error) {
    case EAFNOSUPPORT:
    case EPROTONOSUPPORT:
    case ESOCKTNOSUPPORT:
      throw BusError(bus + ": this kernel has no CAN sockets (" + errno_text(error) +
                     "): run it inside tools/with-vcan, or load the module can_raw");
    case EPERM:
    case EACCES:
      throw BusError(bus + ": not permitted to open a CAN socket (" + errno_text(error) +
                     "): run it as a user, or in a container, that may");
    default:
      throw BusError(bus + ": cannot open a CAN socket: " + errno_text(error));
  }
}

InterfaceState read_interface(const Socket& socket, const std::string& interface_name) noexcept {
  ifreq request = request_for(interface_name);
  if (::ioctl(socket.fd(), SIOCGIFINDEX, &request) != 0) return {};
  const int index = request.ifr_ifindex;
  if (!is_can_interface(socket, interface_name)) return {};
  request = request_for(interface_name);
  if (::ioctl(socket.fd(), SIOCGIFFLAGS, &request) != 0) return {};
  return {index, (request.ifr_flags & IFF_UP) != 0};
}

int require_interface(const Socket& socket, const std::string& bus,
                      const std::string& interface_name) {
  if (interface_name.empty() || interface_name.size() >= IFNAMSIZ) {
    throw BusError(bus + ": interface name of " + std::to_string(interface_name.size()) +
                   " characters, expected 1 to " + std::to_string(IFNAMSIZ - 1));
  }
  ifreq request = request_for(interface_name);
  if (::ioctl(socket.fd(), SIOCGIFINDEX, &request) != 0) {
    throw BusError(bus + ": no such interface; " + list_can_interfaces(socket));
  }
  const InterfaceState interface = read_interface(socket, interface_name);
  if (interface.index == 0) {
    throw BusError(bus + ": not a CAN interface; " + list_can_interfaces(socket));
  }
  if (!interface.is_up) {
    throw BusError(bus + ": the interface is down: ip link set " + interface_name + " up");
  }
  return interface.index;
}

bool bind_to_interface(const Socket& socket, int interface_index) noexcept {
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = interface_index;
  return ::bind(socket.fd(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
}

int bound_interface(const Socket& socket) noexcept {
  sockaddr_can address{};
  socklen_t size = sizeof address;
  if (::getsockname(socket.fd(), reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  return address.can_ifindex;
}

}  // namespace faultline
