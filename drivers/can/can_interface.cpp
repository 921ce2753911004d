#include "drivers/can/can_interface.h"

#include <array>
#include <cerrno>
#include <cstring>

#include <linux/can.h>
#include <linux/can/raw.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/socket.h>

#include "drivers/can/can_bus.h"

namespace faultline {
namespace {

/// A request for the state of one interface by its name (rtnetlink(7), RTM_GETLINK).
struct LinkRequest {
  nlmsghdr header{};
  ifinfomsg link{};
  rtattr name_header{};
  std::array<char, IFNAMSIZ> name{};
};

/// Room for the front of an answer, which is all that is read of it.
constexpr std::size_t kAnswerBytes = 4096;

/// "vcan0, vcan1", or a sentence how to make one.
std::string list_can_interfaces() {
  std::string names;
  struct if_nameindex* const interfaces = ::if_nameindex();
  for (const struct if_nameindex* entry = interfaces; entry != nullptr && entry->if_index != 0;
       ++entry) {
    if (!read_interface(entry->if_name).is_can) continue;
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

InterfaceState read_interface(const std::string& interface_name) noexcept {
  // Not by ioctl: that has the kernel run modprobe for each name it does not know.
  const Socket socket(::socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE));
  LinkRequest request;
  request.header.nlmsg_len = sizeof request;
  request.header.nlmsg_type = RTM_GETLINK;
  request.header.nlmsg_flags = NLM_F_REQUEST;
  request.name_header.rta_len = sizeof request.name_header + sizeof request.name;
  request.name_header.rta_type = IFLA_IFNAME;
  interface_name.copy(request.name.data(), request.name.size() - 1);
  if (::send(socket.fd(), &request, sizeof request, 0) != static_cast<ssize_t>(sizeof request)) {
    return {};
  }
  alignas(nlmsghdr) std::array<char, kAnswerBytes> answer{};
  const ssize_t size = ::recv(socket.fd(), answer.data(), answer.size(), 0);
  nlmsghdr header{};
  ifinfomsg link{};
  if (size < static_cast<ssize_t>(NLMSG_LENGTH(sizeof link))) return {};
  std::memcpy(&header, answer.data(), sizeof header);
  if (header.nlmsg_type != RTM_NEWLINK) return {};  // NLMSG_ERROR: no such interface
  std::memcpy(&link, answer.data() + NLMSG_HDRLEN, sizeof link);
  return {link.ifi_index, link.ifi_type == ARPHRD_CAN, (link.ifi_flags & IFF_UP) != 0};
}

int require_interface(const std::string& bus, const std::string& interface_name) {
  if (interface_name.empty() || interface_name.size() >= IFNAMSIZ) {
    throw BusError(bus + ": interface name of " + std::to_string(interface_name.size()) +
                   " characters, expected 1 to " + std::to_string(IFNAMSIZ - 1));
  }
  const InterfaceState interface = read_interface(interface_name);
  if (interface.index == 0) {
    throw BusError(bus + ": no such interface; " + list_can_interfaces());
  }
  if (!interface.is_can) {
    throw BusError(bus + ": not a CAN interface; " + list_can_interfaces());
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
