#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <netinet/in.h>

#include "drivers/can/bus_socket.h"

namespace faultline {

/// A multicast address with its port, of either version of IP.
struct MulticastAddress {
  union {
    sockaddr_in v4;
    sockaddr_in6 v6;
    sockaddr any;
  };
  socklen_t size = 0;

  MulticastAddress() : v6{} {}
  [[nodiscard]] bool is_v6() const noexcept { return any.sa_family == AF_INET6; }
};

/// @param group numeric; IPv6 may end in `%INTERFACE`. @return nothing if it is no multicast
/// address.
[[nodiscard]] std::optional<MulticastAddress> parse_multicast_address(const std::string& group,
                                                                      std::uint16_t port);

/// The sockets of one member of a group: one to receive, which never gets what the other sends.
struct MulticastSockets {
  Socket receiving;  ///< bound to the group, joined; own datagrams filtered out in the kernel
  Socket sending;    ///< connected to the group; TTL 1, heard on this host too
};

/// Joins `group`. Datagrams from the sending socket that reach the receiving one are dropped by the
/// kernel and appear in its drop counter.
/// @throws BusError no interface carries multicast to it, or the system refuses.
[[nodiscard]] MulticastSockets join_group(const MulticastAddress& group, const std::string& bus);

}  // namespace faultline
