#include "drivers/can/multicast_group.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include <ifaddrs.h>
#include <netdb.h>

#include <arpa/inet.h>
#include <linux/filter.h>
#include <net/if.h>
#include <sys/socket.h>

#include "drivers/can/can_bus.h"

namespace faultline {
namespace {

/// One hop: to the hosts of the same network, as python-can's default.
constexpr int kHops = 1;

Socket open_udp_socket(const MulticastAddress& group, const std::string& bus) {
  Socket socket(::socket(group.any.sa_family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (socket.fd() < 0) throw BusError(bus + ": cannot open a UDP socket: " + errno_text(errno));
  return socket;
}

/// Where its route, or `interface_index` if not 0, leads out to the group.
/// @return 0, or errno if nowhere.
int connect_to(const Socket& socket, const MulticastAddress& group, unsigned interface_index) {
  const int level = group.is_v6() ? IPPROTO_IPV6 : IPPROTO_IP;
  if (interface_index != 0) {
    const ip_mreqn v4{
        .imr_multiaddr = {}, .imr_address = {}, .imr_ifindex = static_cast<int>(interface_index)};
    const int v6 = static_cast<int>(interface_index);
    const int status = group.is_v6()
                           ? ::setsockopt(socket.fd(), level, IPV6_MULTICAST_IF, &v6, sizeof v6)
                           : ::setsockopt(socket.fd(), level, IP_MULTICAST_IF, &v4, sizeof v4);
    if (status != 0) return errno;
  }
  return ::connect(socket.fd(), &group.any, group.size) == 0 ? 0 : errno;
}

/// The address that `socket` sends from. @throws BusError.
MulticastAddress local_address(const Socket& socket, const std::string& bus) {
  MulticastAddress local;
  local.size = sizeof local.v6;
  if (::getsockname(socket.fd(), &local.any, &local.size) != 0) {
    throw BusError(bus + ": cannot read a socket's address: " + errno_text(errno));
  }
  return local;
}

bool is_same_host_address(const sockaddr& a, const MulticastAddress& b) noexcept {
  if (a.sa_family != b.any.sa_family) return false;
  if (b.is_v6()) {
    sockaddr_in6 address{};
    std::memcpy(&address, &a, sizeof address);
    return std::memcmp(&address.sin6_addr, &b.v6.sin6_addr, sizeof b.v6.sin6_addr) == 0;
  }
  sockaddr_in address{};
  std::memcpy(&address, &a, sizeof address);
  return address.sin_addr.s_addr == b.v4.sin_addr.s_addr;
}

/// Index of the interface that has the address `local`; 0 if none has.
unsigned interface_with(const MulticastAddress& local) {
  if (local.is_v6() && local.v6.sin6_scope_id != 0) return local.v6.sin6_scope_id;
  ifaddrs* addresses = nullptr;
  if (::getifaddrs(&addresses) != 0) return 0;
  unsigned index = 0;
  for (const ifaddrs* entry = addresses; entry != nullptr && index == 0; entry = entry->ifa_next) {
    if (entry->ifa_addr == nullptr || !is_same_host_address(*entry->ifa_addr, local)) continue;
    index = ::if_nametoindex(entry->ifa_name);
  }
  ::freeifaddrs(addresses);
  return index;
}

/// Index of `lo` if it is up and carries multicast, else 0.
unsigned multicast_loopback() {
  ifaddrs* addresses = nullptr;
  if (::getifaddrs(&addresses) != 0) return 0;
  unsigned index = 0;
  constexpr unsigned kWanted = IFF_UP | IFF_LOOPBACK | IFF_MULTICAST;
  for (const ifaddrs* entry = addresses; entry != nullptr && index == 0; entry = entry->ifa_next) {
    if ((entry->ifa_flags & kWanted) == kWanted) index = ::if_nametoindex(entry->ifa_name);
  }
  ::freeifaddrs(addresses);
  return index;
}

[[noreturn]] void throw_no_route(const MulticastAddress& group, const std::string& bus, int error) {
  const std::string cure =
      group.is_v6() ? "ip link set lo up multicast on; ip -6 route add local ff00::/8 dev lo"
                    : "ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo";
  throw BusError(bus + ": no interface carries multicast to this group (" + errno_text(error) +
                 "); within this host: " + cure);
}

/// Connects `sending` to the group. @return the index of the interface it leaves by.
unsigned find_way(const Socket& sending, const MulticastAddress& group, const std::string& bus) {
  const int error = connect_to(sending, group, 0);
  if (error == 0) {
    const unsigned index = interface_with(local_address(sending, bus));
    if (index != 0) return index;
  }
  const unsigned loopback = multicast_loopback();
  if (loopback == 0 || connect_to(sending, group, loopback) != 0) {
    throw_no_route(group, bus, error != 0 ? error : ENETUNREACH);
  }
  return loopback;
}

void limit_reach(const Socket& sending, const MulticastAddress& group, const std::string& bus) {
  const int on = 1;
  if (group.is_v6()) {
    set_socket_option(sending, bus, IPPROTO_IPV6, IPV6_MULTICAST_HOPS, kHops,
                      "IPV6_MULTICAST_HOPS");
    set_socket_option(sending, bus, IPPROTO_IPV6, IPV6_MULTICAST_LOOP, on, "IPV6_MULTICAST_LOOP");
  } else {
    set_socket_option(sending, bus, IPPROTO_IP, IP_MULTICAST_TTL, kHops, "IP_MULTICAST_TTL");
    set_socket_option(sending, bus, IPPROTO_IP, IP_MULTICAST_LOOP, on, "IP_MULTICAST_LOOP");
  }
}

void join(const Socket& receiving, const MulticastAddress& group, unsigned interface_index,
          const std::string& bus) {
  const int off = 0;
  int status = 0;
  if (group.is_v6()) {
    ipv6_mreq request{};
    request.ipv6mr_multiaddr = group.v6.sin6_addr;
    request.ipv6mr_interface = interface_index;
    status = ::setsockopt(receiving.fd(), IPPROTO_IPV6, IPV6_JOIN_GROUP, &request, sizeof request);
  } else {
    // Else the kernel gives it every group that any process of this host has joined.
    set_socket_option(receiving, bus, IPPROTO_IP, IP_MULTICAST_ALL, off, "IP_MULTICAST_ALL");
    const ip_mreqn request{.imr_multiaddr = group.v4.sin_addr,
                           .imr_address = {},
                           .imr_ifindex = static_cast<int>(interface_index)};
    status = ::setsockopt(receiving.fd(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &request, sizeof request);
  }
  if (status != 0) throw BusError(bus + ": cannot join the group: " + errno_text(errno));
}

sock_filter load_word(std::uint32_t offset) { return BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offset); }

/// Keeps what `own` sends out of the queue of `receiving`: a datagram whose source port and address
/// are both that socket's.
void filter_own(const Socket& receiving, const MulticastAddress& own, const std::string& bus) {
  std::array<std::uint32_t, 4> address{};
  std::size_t words = 1;
  std::uint32_t offset = 12;  // of the source address in the header of IPv4
  std::uint16_t port = 0;
  if (own.is_v6()) {
    std::memcpy(address.data(), &own.v6.sin6_addr, sizeof own.v6.sin6_addr);
    words = 4;
    offset = 8;
    port = ntohs(own.v6.sin6_port);
  } else {
    address[0] = own.v4.sin_addr.s_addr;
    port = ntohs(own.v4.sin_port);
  }
  constexpr auto kNetworkHeader = static_cast<std::uint32_t>(SKF_NET_OFF);
  std::vector<sock_filter> program;
  // The filter sees the datagram from the UDP header on, which begins with the source port. On any
  // difference it jumps to the end, where the datagram is let through.
  const auto jump_if_different = [&program, words](std::uint32_t value) {
    const std::size_t end = 2 * (words + 1) + 1;  // a load and a jump each, and the refusal
    const std::size_t distance = end - program.size() - 1;
    program.push_back(
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, static_cast<std::uint8_t>(distance)));
  };
  program.push_back(BPF_STMT(BPF_LD | BPF_H | BPF_ABS, 0));
  jump_if_different(port);
  for (std::size_t n = 0; n < words; ++n) {
    program.push_back(load_word(kNetworkHeader + offset + static_cast<std::uint32_t>(4 * n)));
    jump_if_different(ntohl(address[n]));
  }
  program.push_back(BPF_STMT(BPF_RET | BPF_K, 0));
  program.push_back(BPF_STMT(BPF_RET | BPF_K, 0xFFFF'FFFFu));
  const sock_fprog filter{.len = static_cast<unsigned short>(program.size()),
                          .filter = program.data()};
  set_socket_option(receiving, bus, SOL_SOCKET, SO_ATTACH_FILTER, filter, "SO_ATTACH_FILTER");
}

}  // namespace

std::optional<MulticastAddress> parse_multicast_address(const std::string& group,
                                                        std::uint16_t port) {
  addrinfo hints{};
  hints.ai_flags = AI_NUMERICHOST;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (::getaddrinfo(group.c_str(), nullptr, &hints, &found) != 0) return std::nullopt;
  MulticastAddress address;
  address.size = found->ai_addrlen;
  std::memcpy(&address.any, found->ai_addr,
              std::min<std::size_t>(found->ai_addrlen, sizeof address.v6));
  ::freeaddrinfo(found);
  if (address.is_v6()) {
    address.v6.sin6_port = htons(port);
    if (!IN6_IS_ADDR_MULTICAST(&address.v6.sin6_addr)) return std::nullopt;
  } else {
    address.v4.sin_port = htons(port);
    if (!IN_MULTICAST(ntohl(address.v4.sin_addr.s_addr))) return std::nullopt;
    if (std::count(group.begin(), group.end(), '.') != 3) return std::nullopt;  // not "239.1"
  }
  return address;
}

MulticastSockets join_group(const MulticastAddress& group, const std::string& bus) {
  MulticastSockets sockets{open_udp_socket(group, bus), open_udp_socket(group, bus)};
  limit_reach(sockets.sending, group, bus);
  const unsigned interface_index = find_way(sockets.sending, group, bus);
  // Before the socket is bound: nothing of its own may come in.
  filter_own(sockets.receiving, local_address(sockets.sending, bus), bus);
  const int on = 1;
  set_socket_option(sockets.receiving, bus, SOL_SOCKET, SO_REUSEADDR, on, "SO_REUSEADDR");
  if (::bind(sockets.receiving.fd(), &group.any, group.size) != 0) {
    throw BusError(bus + ": cannot bind: " + errno_text(errno));
  }
  join(sockets.receiving, group, interface_index, bus);
  return sockets;
}

}  // namespace faultline
